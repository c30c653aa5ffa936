"""Robots on one supply: their starts within a common cycle are shifted, to the least of a figure.

The power of the supply is the sum of the powers of the robots, each over its own cycle of equal
length. The figure is its peak, or on one DC bus what the rectifiers give, ``max(sum_i D_i, 0)``:
braking of one robot then meets acceleration of another. Of two robots every shift is looked at. Of
more, one robot after the other takes its best shift until none improves, from several beginnings:
that finds a good choice, not surely the best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float, Int

STEP = 0.02  # s between shifts
BEGINNINGS, SEED = 8, 0  # for more than two robots
MAX_SWEEPS = 50
MAX_STEPS = 5000  # of a cycle
Figure = Callable[[Float], Float]
"""Power of the supply over a cycle, shape (..., N) -> what shall be least, shape (...). [W]"""


def peak(power: Float) -> Float:
    """Return the greatest power, shape (...). [W]

    Args:
        power: Shape (..., N). [W]
    """
    return np.asarray(power.max(axis=-1))


def drawn(power: Float) -> Float:
    """Return the mean power that rectifiers give one bus, which return nothing, shape (...). [W]

    Args:
        power: Demand of all robots, shape (..., N). [W]
    """
    return np.asarray(np.maximum(power, 0.0).mean(axis=-1))


class Levelling(Described):
    """Starts of the robots within the common cycle."""

    start: Annotated[
        Float, "After the beginning of the cycle; 0 for the first robot, shape (R,). [s]"
    ]
    together: Annotated[float, "The figure with all starts at once. [W]"]
    least: Annotated[float, "With these starts. [W]"]
    any_start: Annotated[float, "Its mean over starts that fall anywhere. [W]"]
    mean: Annotated[float, "Power of the supply, whatever the starts. [W]"]


def level_starts(power: Sequence[Float], cycle_time: float, figure: Figure = peak) -> Levelling:
    """Return the starts with the least of a figure.

    Args:
        power: Of each robot over one cycle, at equal steps, all of one length, shape (N,). [W]
        cycle_time: Of all. [s]
    """
    curves = np.stack(power)
    count, size = curves.shape
    shifted = [  # row k of each: the power when the robot starts k samples later
        sliding_window_view(np.concatenate([one, one]), size)[:size][(-np.arange(size)) % size]
        for one in curves
    ]
    random = np.random.default_rng(SEED)
    best = np.zeros(count, dtype=np.int64)
    least = together = float(figure(curves.sum(axis=0)))
    for turn in range(1 if count == 2 else BEGINNINGS):
        begin = np.zeros(count, dtype=np.int64)
        if turn:
            begin[1:] = random.integers(size, size=count - 1)
        start, found = _descend(shifted, begin, figure)
        if found < least * (1 - 1e-9):
            best, least = start, found
    anywhere = random.integers(size, size=(size, count - 1))
    anywhere[:, 0] = np.arange(size)  # of two robots, every shift once
    total = curves[0] + sum(one[rows] for one, rows in zip(shifted[1:], anywhere.T, strict=True))
    return Levelling(
        best * (cycle_time / size),
        together,
        least,
        float(figure(total).mean()),
        float(curves.sum(axis=0).mean()),
    )


def _descend(shifted: Sequence[Float], start: Int, figure: Figure) -> tuple[Int, float]:
    """Give one robot after the other its best shift until none improves."""
    least = np.inf
    for _ in range(MAX_SWEEPS):
        before = least
        for robot in range(1, len(start)):
            others = sum(
                (shifted[k][start[k]] for k in range(len(start)) if k != robot),
                np.zeros(len(shifted[0])),
            )
            values = figure(shifted[robot] + others)
            start[robot] = int(np.argmin(values))
            least = float(values[start[robot]])
        if least >= before * (1 - 1e-9):
            break
    return start, least


def samples_of(cycle_time: float) -> int:
    """Return how many samples the power over one cycle has.

    Args:
        cycle_time: [s]
    """
    return int(np.clip(round(cycle_time / STEP), 2, MAX_STEPS))
