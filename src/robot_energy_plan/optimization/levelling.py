"""Robots on one supply: their starts within a common cycle are shifted so that the peak is least.

The power of the supply is the sum of the powers of the robots, each over its own cycle of equal
length. Of two robots every shift is looked at. Of more, one robot after the other takes its best
shift until none improves, from several beginnings: that finds a good choice, not surely the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float, Int

STEP = 0.02  # s between shifts
BEGINNINGS, SEED = 8, 0  # for more than two robots
MAX_SWEEPS = 50
MAX_STEPS = 5000  # of a cycle


@dataclass(frozen=True)
class Levelling:
    """Starts of the robots within the common cycle.

    Attributes:
        start: After the beginning of the cycle; 0 for the first robot, shape (R,). [s]
        peak_before: Greatest power of the supply with all starts at once. [W]
        peak: With these starts. [W]
        mean: Of the supply, whatever the starts. [W]
    """

    start: Float
    peak_before: float
    peak: float
    mean: float


def level_starts(power: Sequence[Float], cycle_time: float) -> Levelling:
    """Return the starts with the least peak.

    Args:
        power: Of each robot over one cycle, at equal steps, all of one length, shape (N,). [W]
        cycle_time: Of all. [s]

    Raises:
        MotionError: If there are not at least two robots of one length.
    """
    if len(power) < 2 or len({len(one) for one in power}) != 1:
        raise MotionError(
            f"powers of {[len(one) for one in power]} samples",
            "two robots or more, as many of each",
        )
    curves = np.stack(power)
    count, size = curves.shape
    shifted = [  # row k of each: the power when the robot starts k samples later
        sliding_window_view(np.concatenate([one, one]), size)[:size][(-np.arange(size)) % size]
        for one in curves
    ]
    random = np.random.default_rng(SEED)
    best = np.zeros(count, dtype=np.int64)
    least = before = float(curves.sum(axis=0).max())
    for turn in range(1 if count == 2 else BEGINNINGS):
        begin = np.zeros(count, dtype=np.int64)
        if turn:
            begin[1:] = random.integers(size, size=count - 1)
        start, peak = _descend(shifted, begin)
        if peak < least * (1 - 1e-9):
            best, least = start, peak
    return Levelling(best * (cycle_time / size), before, least, float(curves.sum(axis=0).mean()))


def _descend(shifted: Sequence[Float], start: Int) -> tuple[Int, float]:
    """Give one robot after the other its best shift until none improves."""
    peak = np.inf
    for _ in range(MAX_SWEEPS):
        before = peak
        for robot in range(1, len(start)):
            others = sum(
                (shifted[k][start[k]] for k in range(len(start)) if k != robot),
                np.zeros(len(shifted[0])),
            )
            peaks = (shifted[robot] + others).max(axis=1)
            start[robot] = int(np.argmin(peaks))
            peak = float(peaks[start[robot]])
        if peak >= before * (1 - 1e-9):
            break
    return start, peak


def samples_of(cycle_time: float) -> int:
    """Return how many samples the power over one cycle has.

    Args:
        cycle_time: [s]
    """
    return int(np.clip(round(cycle_time / STEP), 2, MAX_STEPS))
