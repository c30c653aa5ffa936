"""Readings of a meter -> pieces of its power curve, and what could not be used."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.inputs.meter.energy_counter import EnergyCounterDecoder
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterBlock, MeterMeaning
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces
from robot_energy.timeline.stamps import BACKWARD_JUMP_NS

BEGIN_NS = 100_000_000  # the same at first, when a reading before may be the wrong one
MAX_POWER = 1e6  # no robot draws a megawatt, and the exact sums hold up to there [W]
MAX_INTERVAL = 86_400.0  # of a mean [s]


class MeterLimits(Described):
    """What the user says of the readings of one meter."""

    max_gap: Annotated[float, "Longest time between readings that is bridged. [s]"] = 2.0
    max_power: Annotated[float, "Readings that say or imply more, either way, are refused. [W]"] = (
        MAX_POWER
    )
    wraps_at: Annotated[
        float | None, "Reading at which a counter starts again from zero; None: it never does. [J]"
    ] = None

    def pieces(self, block: MeterBlock) -> list[CoveredPieces]:
        """Return the pieces of a whole recording's readings, epoch by epoch."""
        return MeterCurve(self.max_gap, self.max_power, self.wraps_at).step(block)


class MeterCurve:
    """Turns readings into pieces and counts what it cannot use.

    Args:
        max_gap: Longest time between readings that is bridged. [s]
        max_power: Readings that say or imply more, either way, are refused. [W]
        wraps_at: Reading at which a counter starts again from zero; None: it never does. [J]

    Attributes:
        rejections: Readings that arrived, that were used and that were not, by reason.
        gaps: Pairs of readings that lie further apart than is bridged.
        spacing_ns: Time between the two newest readings; None before the second. [ns]
        newest_ns: Stamp of the newest reading; None before the first. [ns]
        left: Readings in each epoch that ended in the last step.
    """

    def __init__(
        self, max_gap: float, max_power: float = MAX_POWER, wraps_at: float | None = None
    ) -> None:
        self.rejections = RejectionLog()
        self.gaps = 0
        self.spacing_ns: int | None = None
        self.newest_ns: int | None = None
        self.left: list[int] = []
        self._readings = 0  # in the running epoch
        self._max_gap_ns = round(max_gap / NANOSECOND)
        self._max_power = max_power
        self.counter = EnergyCounterDecoder(self._max_gap_ns, max_power, wraps_at)
        self._last: tuple[int, float] | None = None  # stamp and power of the epoch's newest

    def step(self, block: MeterBlock) -> list[CoveredPieces]:
        """Take readings.

        Returns:
            Pieces, one list entry for each epoch touched; the first continues the running
            epoch, and each further one follows a backward jump.
        """
        self.rejections.received += len(block)
        cumulative = block.meaning is MeterMeaning.CUMULATIVE
        value = block.energy if cumulative else block.power
        good = self._usable(block, value, cumulative)
        epochs = self._epochs(block.stamp_ns, good)
        pieces: list[CoveredPieces] = []
        for number, rows in enumerate(epochs):
            if number:
                self._last = None
                self.counter.restart()
            if not len(rows):
                pieces.append(NO_PIECES)
            elif cumulative:
                pieces.append(self._counted(block.stamp_ns[rows], value[rows]))
            else:
                self.rejections.accepted += len(rows)
                pieces.append(self._pieces(block, rows, value))
        return pieces

    def _usable(self, block: MeterBlock, value: Float, cumulative: bool) -> NDArray[np.bool_]:
        lost, absurd = ~np.isfinite(value), np.zeros(len(block), dtype=np.bool_)
        mean = block.meaning is MeterMeaning.MEAN_OVER_INTERVAL
        with np.errstate(invalid="ignore"):
            if mean:
                lost |= ~(np.isfinite(block.interval) & (block.interval > 0))
                absurd |= block.interval > MAX_INTERVAL
            if not cumulative:
                absurd |= np.abs(value) > self._max_power
        return self.rejections.refuse({"meter_not_finite": lost, "meter_implausible": absurd})

    def _epochs(self, stamp_ns: Int, good: NDArray[np.bool_]) -> list[Int]:
        """Rows of usable readings that are newer than all before, epoch by epoch."""
        rows = np.flatnonzero(good)
        stamps = stamp_ns[rows]
        self.left = []
        if not len(rows):
            return [rows]
        newest = self.newest_ns
        first = int(stamps[0])
        rising = newest is None or first > newest
        steps = np.diff(stamps)
        if rising and bool((steps > 0).all()):
            self._readings += len(rows)
            self._keep_time(int(stamps[-1]), first if newest is None else newest, steps)
            return [rows]
        epochs: list[list[int]] = [[]]
        for row, stamp in zip(rows.tolist(), stamps.tolist(), strict=True):
            if newest is not None and stamp <= newest:
                reach = BACKWARD_JUMP_NS if self._readings > 1 else BEGIN_NS
                if stamp > newest - reach:
                    self.rejections.reject("meter_not_newer", 1)
                    continue
                epochs.append([])
                self.left.append(self._readings)
                self._readings = 0
            elif newest is not None:
                self.gaps += stamp - newest > self._max_gap_ns
                self.spacing_ns = stamp - newest
            epochs[-1].append(row)
            self._readings += 1
            newest = stamp
        self.newest_ns = newest
        return [np.asarray(rows, dtype=np.int64) for rows in epochs]

    def _keep_time(self, newest: int, before: int, steps: Int) -> None:
        """Note the spacing of readings that all rise."""
        lead = newest - int(steps.sum()) - before
        self.gaps += int((steps > self._max_gap_ns).sum())
        if lead:
            self.gaps += lead > self._max_gap_ns
            self.spacing_ns = lead
        if len(steps):
            self.spacing_ns = int(steps[-1])
        self.newest_ns = newest

    def _counted(self, stamp_ns: Int, energy: Float) -> CoveredPieces:
        counter = self.counter
        low, high = counter.low, counter.high
        pieces = counter.step(stamp_ns, energy)
        self.rejections.reject("meter_counter_low", counter.low - low)
        self.rejections.reject("meter_implausible", counter.high - high)
        self.rejections.accepted += len(stamp_ns) - (counter.low - low) - (counter.high - high)
        return pieces

    def _pieces(self, block: MeterBlock, rows: Int, value: Float) -> CoveredPieces:
        stamp, power = block.stamp_ns[rows], value[rows]
        previous, before = np.empty_like(stamp), np.empty_like(power)
        previous[1:], before[1:] = stamp[:-1], power[:-1]
        known = np.ones(len(rows), dtype=np.bool_)
        known[0] = self._last is not None
        previous[0], before[0] = self._last if self._last is not None else (stamp[0] - 1, 0.0)
        self._last = (int(stamp[-1]), float(power[-1]))
        if block.meaning is MeterMeaning.INSTANTANEOUS:
            keep = known & (stamp - previous <= self._max_gap_ns)
            return CoveredPieces(previous, stamp, before, power)[keep]
        start = stamp - np.rint(block.interval[rows] / NANOSECOND).astype(np.int64)
        start = np.where(known, np.maximum(start, previous), start)
        return CoveredPieces(start, stamp, power, power)
