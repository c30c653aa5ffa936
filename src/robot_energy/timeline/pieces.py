"""Straight pieces of a power curve, and the intervals on which two curves meet."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int


class CoveredPieces(Block):
    """Straight pieces of a power curve, in time order, not overlapping."""

    stamp_ns: Annotated[Int, "Where each begins, shape (N,). [ns]"]
    end_ns: Annotated[Int, "Shape (N,). [ns]"]
    start_power: Annotated[Float, "Shape (N,). [W]"]
    end_power: Annotated[Float, "Shape (N,). [W]"]

    @property
    def duration(self) -> Float:
        """How long each piece is, shape (N,). [s]"""
        return (self.end_ns - self.stamp_ns) * NANOSECOND

    @property
    def mean_power(self) -> Float:
        """Mean power of each piece, shape (N,). [W]"""
        return 0.5 * (self.start_power + self.end_power)

    @property
    def edges(self) -> Int:
        """Every start and end, those that touch only once. [ns]"""
        apart = self.stamp_ns[1:] != self.end_ns[:-1]
        lonely = [self.stamp_ns[1:][apart]] if apart.any() else []
        return np.concatenate([self.stamp_ns[:1], *lonely, self.end_ns])

    def index(self, start_ns: Int, end_ns: Int) -> tuple[Int, NDArray[np.bool_]]:
        """Return the last piece begun at each interval, and whether it holds it, shape (M,) each.

        Args:
            start_ns: Where each interval begins, shape (M,). [ns]
            end_ns: Where each ends, shape (M,). [ns]
        """
        if not len(self):
            return np.zeros(len(start_ns), dtype=np.int64), np.zeros(len(start_ns), dtype=np.bool_)
        row = np.maximum(np.searchsorted(self.stamp_ns, start_ns, side="right") - 1, 0)
        return row, (self.stamp_ns[row] <= start_ns) & (end_ns <= self.end_ns[row])

    def value(self, row: Int, time_ns: Int) -> Float:
        """Return the power at times within pieces, shape (..., M). [W]

        Args:
            row: Number of the piece of each time, shape (M,).
            time_ns: Within that piece, shape (..., M). [ns]
        """
        start = self.stamp_ns[row]
        share = (time_ns - start) / (self.end_ns[row] - start)
        low = self.start_power[row]
        return low + (self.end_power[row] - low) * share


class Compared(Block):
    """Elementary intervals on which both powers are known."""

    stamp_ns: Annotated[Int, "When the meter had reported the interval, shape (K,). [ns]"]
    duration_ns: Annotated[Int, "Shape (K,). [ns]"]
    measured: Annotated[Float, "Measured energy, shape (K,). [J]"]
    predicted: Annotated[
        Float,
        "Predicted energy at the meter's place, as the meter shows it with its delay and low "
        "pass, shape (K,). [J]",
    ]
    drawn: Annotated[Float, "Predicted energy that is drawn there meanwhile, shape (K,). [J]"]


_TIMES, _VALUES = np.empty(0, dtype=np.int64), np.empty(0)
NO_PIECES = CoveredPieces(_TIMES, _TIMES, _VALUES, _VALUES)
NO_INTERVALS = Compared(_TIMES, _TIMES, _VALUES, _VALUES, _VALUES)
