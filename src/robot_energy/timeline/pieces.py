"""Straight pieces of a power curve, and the intervals on which two curves meet."""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import NANOJOULE_PER_JOULE, SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int, differences

WINDOW = 60  # of the rolling residual [s]
MAX_WAITING = 4096  # intervals whose sums are made together

Sums = list[int]  # compared time [ns], measured energy [nJ], predicted energy [nJ]


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


class NewestMinute:
    """Sums over the newest minute that was compared, and of energy fed back since the start.

    Sums are integers, so that they do not depend on how the input is cut; few intervals wait for
    others.
    """

    def __init__(self) -> None:
        self.seconds: deque[tuple[int, Sums]] = deque()  # as of the last `sums`
        self._sums: Sums = [0, 0, 0]
        self._waiting: list[Compared] = []
        self._rows = 0  # of them
        self._drawn = self._returned = self._predicted_returned = 0  # since the start [nJ]

    def take(self, compared: Compared) -> None:
        """Take what became comparable."""
        self._waiting.append(compared)
        self._rows += len(compared)
        if self._rows >= MAX_WAITING:
            self._settle()

    @property
    def sums(self) -> Sums:
        """Over the newest minute."""
        self._settle()
        return self._sums

    @property
    def returned_share(self) -> float:
        """Energy fed back over energy drawn, by the meter; 0 where a prediction gives some. [-]"""
        self._settle()
        return 0.0 if self._predicted_returned or not self._drawn else self._returned / self._drawn

    @property
    def time(self) -> float:
        """Compared time within it. [s]"""
        return self.sums[0] * NANOSECOND

    @property
    def residual_share(self) -> float:
        """Predicted minus measured energy, relative to measured. [-]

        NaN where nothing was compared or measured.
        """
        _, measured, predicted = self.sums
        return (predicted - measured) / abs(measured) if measured else math.nan

    def _settle(self) -> None:
        """Count what waits; how it was cut makes no difference."""
        if not self._rows:
            return
        compared = Compared.concatenate(self._waiting)
        self._waiting.clear()
        self._rows = 0
        second = compared.stamp_ns // SECOND_NS
        measured = np.rint(compared.measured * NANOJOULE_PER_JOULE).astype(np.int64)
        predicted = np.rint(compared.drawn * NANOJOULE_PER_JOULE).astype(np.int64)
        self._drawn += int(measured[measured > 0].sum())
        self._returned -= int(measured[measured < 0].sum())
        self._predicted_returned -= int(predicted[predicted < 0].sum())
        starts = np.concatenate([[0], np.flatnonzero(np.diff(second)) + 1])
        table = np.stack([compared.duration_ns, measured, predicted], axis=1)
        sums = np.add.reduceat(table, starts, axis=0)
        for number, row in zip(second[starts].tolist(), sums.tolist(), strict=True):
            self._add(number, row)

    def _add(self, second: int, sums: Sums) -> None:
        seconds = self.seconds
        if seconds and second < seconds[-1][0]:
            seconds.clear()  # the recording loops
            self._sums = [0, 0, 0]
        if seconds and second == seconds[-1][0]:
            seconds[-1][1][:] = [a + b for a, b in zip(seconds[-1][1], sums, strict=True)]
        else:
            seconds.append((second, list(sums)))
        self._sums = [a + b for a, b in zip(self._sums, sums, strict=True)]
        while seconds[0][0] <= second - WINDOW:
            _, old = seconds.popleft()
            self._sums = [a - b for a, b in zip(self._sums, old, strict=True)]


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
