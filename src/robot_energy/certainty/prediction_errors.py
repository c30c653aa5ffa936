"""RMS of predicted minus measured power at a meter, from blocks in any cutting."""

from __future__ import annotations

import numpy as np

from robot_energy.timeline.blocks import NANOSECOND, Int, differences
from robot_energy.timeline.pieces import Compared

NO_READING = -(2**62)  # ns, before all stamps
UNITS = 2.0**36  # of a joule: energies are whole numbers of them, which add up exactly


class PowerErrorSums:
    """Error of the mean power from reading to reading, each reading weighted by its time.

    ``rms = sqrt(sum(E_i^2 / t_i) / sum(t_i))`` with the energy error ``E_i`` over the time
    ``t_i`` that reading ``i`` covers. The cutting of the input makes no difference.
    """

    def __init__(self) -> None:
        self._squares = np.zeros(2)  # of predicted - measured, and of measured [W^2 s]
        self._time_ns = 0
        self._open_ns = NO_READING
        self._open: Int = np.zeros(3, dtype=np.int64)  # of the newest reading, see `_close`

    def step(self, compared: Compared) -> None:
        """Take what became comparable."""
        if not len(compared):
            return
        first = np.flatnonzero(differences(compared.stamp_ns, self._open_ns))
        if not len(first) or first[0] > 0:
            first = np.concatenate([np.zeros(1, dtype=np.int64), first])
            begun = self._open
        else:
            self._close(self._open[:, None])
            begun = np.zeros(3, dtype=np.int64)
        values = np.empty((3, len(compared)), dtype=np.int64)
        values[0] = np.rint((compared.predicted - compared.measured) * UNITS)
        values[1] = np.rint(compared.measured * UNITS)
        values[2] = compared.duration_ns
        readings = np.add.reduceat(values, first, axis=1)
        readings[:, 0] += begun
        self._close(readings[:, :-1])
        self._open, self._open_ns = readings[:, -1], int(compared.stamp_ns[-1])

    def _close(self, readings: Int) -> None:
        """Add readings, shape (3, K): energy error and energy [1/UNITS J], time [ns]."""
        used = readings[:, readings[2] > 0]
        squares = (used[:2] / UNITS) ** 2 / (used[2] * NANOSECOND)
        rows = np.concatenate([self._squares[:, None], squares], axis=1)
        self._squares = np.add.accumulate(rows, axis=1)[:, -1]  # in their order
        self._time_ns += int(used[2].sum())

    def add(self, other: PowerErrorSums) -> None:
        """Take all readings of another recording."""
        self._close(np.stack([self._open, other._open], axis=1))
        self._open, self._open_ns = np.zeros(3, dtype=np.int64), NO_READING
        self._squares = self._squares + other._squares
        self._time_ns += other._time_ns

    @property
    def rms(self) -> float:
        """Of predicted minus measured power; NaN where nothing was compared. [W]"""
        return self._root(0)

    @property
    def measured_rms(self) -> float:
        """Of the measured power: the error of a prediction of 0 W. [W]"""
        return self._root(1)

    def _root(self, part: int) -> float:
        open_s = float(self._open[2]) * NANOSECOND
        time, square = self._time_ns * NANOSECOND + open_s, float(self._squares[part])
        if open_s > 0:
            square += (float(self._open[part]) / UNITS) ** 2 / open_s
        return float(np.sqrt(square / time)) if time > 0 else float("nan")
