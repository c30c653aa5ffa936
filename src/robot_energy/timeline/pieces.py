"""Straight pieces of a power curve, and the intervals on which two curves meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int, differences


@dataclass(frozen=True)
class CoveredPieces(Block):
    """Straight pieces of a power curve, in time order, not overlapping.

    Attributes:
        stamp_ns: Where each begins, shape (N,). [ns]
        end_ns: Shape (N,). [ns]
        start_power: Shape (N,). [W]
        end_power: Shape (N,). [W]
    """

    end_ns: Int
    start_power: Float
    end_power: Float

    @classmethod
    def empty(cls) -> CoveredPieces:
        """No pieces."""
        none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(none, none, nothing, nothing)

    def join(self, later: CoveredPieces) -> CoveredPieces:
        """Return these pieces followed by later ones."""
        return CoveredPieces.concatenate([self, later]) if len(self) else later

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

    def after(self, time_ns: int) -> CoveredPieces:
        """Return the pieces that end after a time."""
        return self[slice(int(np.searchsorted(self.end_ns, time_ns, side="right")), None)]

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


@dataclass(frozen=True)
class Compared(Block):
    """Elementary intervals on which both powers are known.

    Attributes:
        stamp_ns: When the meter had reported the interval, shape (K,). [ns]
        duration_ns: Shape (K,). [ns]
        measured: Measured energy, shape (K,). [J]
        predicted: Predicted energy at the meter's place, as the meter shows it with its delay
            and low pass, shape (K,). [J]
        drawn: Predicted energy that is drawn there meanwhile, shape (K,). [J]
    """

    duration_ns: Int
    measured: Float
    predicted: Float
    drawn: Float

    @classmethod
    def empty(cls) -> Compared:
        """No intervals."""
        none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(none, none, nothing, nothing, nothing)


def starts_of(number: Int) -> Int:
    """Return where runs of equal numbers begin, shape (runs,).

    Args:
        number: Shape (N,), N > 0.
    """
    return np.flatnonzero(differences(number, int(number[0]) - 1))


def closed_sums(begun: Int, table: Int, length_ns: int) -> tuple[Int, Int, Int]:
    """Sum rows by the time of their first column.

    Args:
        begun: The sum that may go on, shape (0 or 1, columns).
        table: New rows: time [ns], and what is summed; shape (N, columns), N > 0.

    Returns:
        The sums; the whole second from which each counts, as it is known to be complete when the
        next one begins [ns]; and the sum that may go on.
    """
    rows = np.concatenate([begun[:, : table.shape[1]], table])
    starts = starts_of(rows[:, 0] // length_ns)
    sums = np.add.reduceat(rows, starts, axis=0)
    sums[:, 0] = rows[np.append(starts[1:], len(rows)) - 1, 0]
    return sums[:-1], -(-rows[starts[1:], 0] // SECOND_NS) * SECOND_NS, sums[-1:]
