"""Which candidate of each move: the least energy within a time, and the front of all trade-offs.

One candidate of each move is chosen so that ``sum(E) - P sum(T)`` is least and ``sum(T)`` is at
most the time there is; ``P`` is the power of the wait that the moves shorten. This is a
multiple-choice knapsack, solved exactly by HiGHS through `scipy.optimize.milp`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float, Int
from robot_energy.errors import MotionError
from robot_energy.optimization.plan import Cost, CostTable, CyclePlan

GAP = 1e-5  # of the energy, to the proven optimum [-]
MAX_TIME = 5.0  # s of one solution
PRICES = 41  # of a second, along the front
PEAKS = 7  # limits of the peak, along the front
MAX_FRONT = 40  # points that are kept


def cheapest(
    table: CostTable, allowed: NDArray[np.bool_], time: float, wait_power: float = 0.0
) -> Int:
    """Return the candidate of each move that together cost least.

    Args:
        table: All candidates.
        allowed: Which of them may be used, shape (P,).
        time: For all moves together. [s]
        wait_power: Power of the wait that takes what is left of the time. [W]

    Returns:
        Row of each move, shape (K,).

    Raises:
        MotionError: If the moves cannot be made within the time.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array

    rows = _efficient(table, allowed, wait_power)
    move = table.candidates.move[rows]
    duration = table.use.duration[rows]
    fastest = sum(duration[move == k].min() for k in range(table.moves))
    if fastest > time * (1 + 1e-9) + 1e-9:
        raise MotionError(
            f"the moves need at least {fastest:.4g} s", f"at most {time:.4g} s", "allow more time"
        )
    price = table.use.energy[rows] - wait_power * duration
    size = len(rows)
    one = csr_array((np.ones(size), (move, np.arange(size))), shape=(table.moves, size))
    scale = max(float(np.abs(price).max()), 1e-9)
    solved = milp(
        price / scale,
        integrality=np.ones(size, dtype=np.int64),
        bounds=Bounds(0, 1),
        constraints=[
            LinearConstraint(one, 1, 1),
            LinearConstraint(duration[None, :], -np.inf, max(time, fastest)),
        ],
        options={"mip_rel_gap": GAP, "time_limit": MAX_TIME},
    )
    if solved.x is None:
        raise MotionError(f"no choice of speeds was found ({solved.message})", "one")
    taken = rows[solved.x > 0.5]
    return taken[np.argsort(table.candidates.move[taken])]


def _efficient(table: CostTable, allowed: NDArray[np.bool_], wait_power: float) -> Int:
    """Candidates that are allowed and not both slower and dearer than another one."""
    kept: list[Int] = []
    for move in range(table.moves):
        rows = np.flatnonzero(allowed & (table.candidates.move == move))
        if not len(rows):
            raise MotionError(
                f"move {move + 1} cannot be made within the limits of torque and peak power",
                "a way to make it",
                "raise the peak limit, or check the torque limits of the URDF",
            )
        price = table.use.energy[rows] - wait_power * table.use.duration[rows]
        order = np.lexsort((price, table.use.duration[rows]))
        best = np.minimum.accumulate(price[order])
        first = np.concatenate([[True], price[order][1:] < best[:-1]])
        kept.append(rows[order[first]])
    return np.concatenate(kept)


def uniform(
    table: CostTable, allowed: NDArray[np.bool_], time: float, wait_power: float = 0.0
) -> Int | None:
    """Return the cheapest choice with the same shares for all moves; None if there is none.

    Args:
        table: All candidates.
        allowed: Which of them may be used, shape (P,).
        time: For all moves together. [s]
        wait_power: Power of the wait that takes what is left of the time. [W]
    """
    found = table.candidates
    best: tuple[float, Int] | None = None
    for speed in np.unique(found.speed):
        for rise in np.unique(found.acceleration):
            rows = _with_shares(table, speed, rise)
            if rows is None or not allowed[rows].all():
                continue
            moving = float(table.use.duration[rows].sum())
            if moving > time + 1e-9:
                continue
            energy = float(table.use.energy[rows].sum()) - wait_power * moving
            if best is None or energy < best[0]:
                best = energy, rows
    return None if best is None else best[1]


def _with_shares(table: CostTable, speed: float, rise: float) -> Int | None:
    """Candidate of each move with these shares, or an equal one with less speed."""
    found = table.candidates
    rows = np.flatnonzero((found.acceleration == rise) & (found.speed <= speed))
    rows = rows[np.lexsort((found.speed[rows], found.move[rows]))]
    taken = rows[np.diff(found.move[rows], append=table.moves) > 0]
    return taken if len(taken) == table.moves else None


def front(
    table: CostTable, allowed: NDArray[np.bool_], plan: CyclePlan, most: int = MAX_FRONT
) -> list[tuple[CyclePlan, Cost]]:
    """Return plans of which none is better than another in energy, time and peak at once.

    For each of several limits of the peak, each of many prices of a second gives the choice that
    costs least: the corners of the convex hull.

    Args:
        table: All candidates.
        allowed: Which of them may be used, shape (P,).
        plan: Whose rests are kept.
        most: Number of plans, at most.

    Returns:
        From fast to slow.
    """
    move, use = table.candidates.move, table.use
    lowest = max(use.peak[allowed & (move == k)].min() for k in range(table.moves))
    highest = float(use.peak[allowed].max())
    scale = float(use.energy[plan.row].sum() / max(use.duration[plan.row].sum(), 1e-9))
    prices = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, PRICES - 1)]) * scale
    found: dict[bytes, CyclePlan] = {}
    for limit in np.linspace(lowest, highest, PEAKS):
        usable = np.flatnonzero(allowed & (use.peak <= limit * (1 + 1e-9)))
        cost = use.energy[usable, None] + prices * use.duration[usable, None]
        best = np.empty((table.moves, len(prices)), dtype=np.int64)
        for k in range(table.moves):
            mine = np.flatnonzero(move[usable] == k)
            best[k] = usable[mine[cost[mine].argmin(axis=0)]]
        for rows in best.T:
            found.setdefault(rows.tobytes(), CyclePlan(rows.copy(), plan.rest, plan.state))
    plans = [(one, table.cost(one)) for one in found.values()]
    points = np.array([(cost.energy, cost.duration, cost.peak) for _, cost in plans])
    kept = [plans[k] for k in np.flatnonzero(_not_worse(points))]
    kept.sort(key=lambda pair: pair[1].duration)
    if len(kept) > most:
        kept = [kept[k] for k in np.unique(np.linspace(0, len(kept) - 1, most).astype(int))]
    return kept


def _not_worse(points: Float) -> NDArray[np.bool_]:
    """Whether no other point is at most as great in all columns and less in one."""
    less = (points[:, None, :] <= points[None, :, :] * (1 + 1e-9)).all(axis=2)
    better = (points[:, None, :] < points[None, :, :] * (1 - 1e-6)).any(axis=2)
    return np.asarray(~(less & better).any(axis=0))
