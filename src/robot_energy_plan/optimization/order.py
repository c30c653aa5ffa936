"""Order of independent moves: the cheapest round trip through all configurations.

Each configuration keeps its rest and is visited once; the first stays the first. The energy between
two configurations is that of the move as the program makes it; a move in which the robot would
touch itself is never made. Up to `EXACT` configurations the
best order is found by dynamic programming over sets (Held and Karp); beyond, parts of the order are
turned round as long as that saves energy, which finds a good order, not surely the best.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.physics.collision import SelfCollision
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.optimization.candidates import Candidates, PtpMoves
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.ptp_form import PtpForm

EXACT = 11  # configurations
MAX_CONFIGURATIONS = 60
MIN_CHANGE = 1e-6  # J; less is rounding


def best_order(
    form: PtpForm,
    chain: PowerChain,
    wait_power: float = 0.0,
    collision: SelfCollision | None = None,
) -> Int:
    """Return the cheapest order of the configurations that is not slower, shape (K,).

    Indices of the configurations; as it is if no other order saves energy.

    Args:
        form: The program; its moves have the same shares of speed and acceleration.
        wait_power: Power of the wait that takes what is left of the cycle. [W]
        collision: Shapes of the robot, which touches itself in no move of the program as it is;
            None: not looked at.

    Raises:
        MotionError: If there are too many, or moves have shares of their own.
    """
    via = form.joint_position
    count = len(via)
    own = len(set(form.base.speed.tolist())) + len(set(form.base.acceleration.tolist())) > 2
    if own or count > MAX_CONFIGURATIONS:
        raise MotionError(
            f"an order of {count} configurations{' with shares of their own' if own else ''}",
            f"at most {MAX_CONFIGURATIONS}, and the same shares for all moves",
        )
    start, goal = (index.ravel() for index in np.indices((count, count)))
    every = Candidates(
        np.arange(count**2),
        np.full(count**2, form.base.speed[0]),
        np.full(count**2, form.base.acceleration[0]),
    )
    use = chain.moves(PtpMoves(via[start], via[goal], form.full_limits), every)
    energy = (use.energy - wait_power * use.duration).reshape(count, count)
    if collision is not None:
        for first, second in combinations(range(count), 2):
            if collision.touching_on_the_way(via[first], via[second]) is not None:
                energy[first, second] = energy[second, first] = np.inf
    order = _exact(energy) if count <= EXACT else _turned(energy)
    now = np.arange(count)
    duration = use.duration.reshape(count, count)
    better = _round(energy, order) < _round(energy, now) - MIN_CHANGE
    return order if better and _round(duration, order) <= _round(duration, now) + 1e-9 else now


def _round(cost: Float, order: Int) -> float:
    """Cost of a round trip."""
    return float(cost[order, np.roll(order, -1)].sum())


def _exact(cost: Float) -> Int:
    """Held and Karp: least cost from 0 through a set to its last member."""
    count = len(cost)
    least: dict[tuple[int, int], tuple[float, int]] = {
        (1 << k, k): (float(cost[0, k]), 0) for k in range(1, count)
    }
    for size in range(2, count):
        for members in combinations(range(1, count), size):
            whole = sum(1 << k for k in members)
            for last in members:
                rest = whole ^ (1 << last)
                least[whole, last] = min(
                    (least[rest, k][0] + float(cost[k, last]), k) for k in members if k != last
                )
    whole = (1 << count) - 2
    if not whole:
        return np.arange(count)
    last = min(range(1, count), key=lambda k: least[whole, k][0] + float(cost[k, 0]))
    found: list[int] = []
    while whole:
        found.append(last)
        whole, last = whole ^ (1 << last), least[whole, last][1]
    return np.array([0, *found[::-1]])


def _turned(cost: Float) -> Int:
    """Turn parts of the order round while that saves energy."""
    order, better = np.arange(len(cost)), True
    while better:
        better = False
        for begin, end in combinations(range(1, len(cost) + 1), 2):
            other = np.concatenate([order[:begin], order[begin:end][::-1], order[end:]])
            if _round(cost, other) < _round(cost, order) - MIN_CHANGE:
                order, better = other, True
    return order
