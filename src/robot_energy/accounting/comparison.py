"""Predicted and measured power, over exactly the same covered intervals.

A meter has its own rate and its own meaning: straight between instantaneous readings, level over
the interval of a mean or between two changes of a counter. Predicted power is straight between
samples. Both are integrated where both are known, cut at every breakpoint of either, so the result
does not depend on how the input is cut into blocks. Powers are compared with what a meter with a
delay and a low pass shows (`robot_energy.accounting.meter_response`); energies count what is drawn.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite, nan, sqrt
from operator import add
from typing import Annotated

import numpy as np

from robot_energy.accounting.exact_sum import ExactSum
from robot_energy.accounting.meter_response import (
    MAX_LAG,
    LagEstimate,
    MeterResponse,
    NewestMinute,
    ShownPower,
)
from robot_energy.accounting.power_curve import MAX_POWER, MeterCurve
from robot_energy.accounting.registers import NO_SEGMENT
from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.units import NANOJOULE_PER_JOULE, SECOND_NS
from robot_energy.physics import kernels
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    differences,
)
from robot_energy.timeline.pieces import (
    NO_INTERVALS,
    NO_PIECES,
    Compared,
    CoveredPieces,
)

MAX_PIECES = 1_000_000
MAX_BEGINNING = 2  # readings of a first epoch that may have been none
MAX_EPOCHS = 8  # of the meter that wait for the prediction to follow
EARLY_NS = 5 * SECOND_NS  # a reading stamped this much later than the prediction is not a delay
ALONE_NS = 10 * SECOND_NS  # a jump of one side that the other does not follow by then
ALONE_READINGS = 3  # of the meter that must have come meanwhile
MAX_LATE = 0.02  # of the measured energy that the lag of the meter may make
MILLIWATT = 1e-3  # [W]
NEAR_NS = 60 * SECOND_NS  # pieces that much later may still be of the same clock


class Idle(Described):
    """A stretch in which power was predicted and nothing could be compared."""

    since_ns: Annotated[int, "Predicted stamp at which it began. [ns]"]
    until_ns: int
    readings: int
    gaps: int
    ahead_ns: Annotated[
        int | None, "Newest reading minus newest predicted stamp; None without a reading. [ns]"
    ]


@dataclass
class _Epoch:
    """Both curves of one epoch, as far as they are not compared."""

    shown: ShownPower
    predicted: CoveredPieces = NO_PIECES
    measured: CoveredPieces = NO_PIECES
    done_ns: int | None = None
    newest_ns: Annotated[int | None, "Newest reading of the meter; None before the first. [ns]"] = (
        None
    )


class Comparison(ExactSum):
    """Accumulates measured and predicted energy over what both cover.

    Args:
        max_gap: Longest time between meter readings that is bridged. [s]
        patience: How long predicted power waits for the meter. [s]
        max_power: Readings that say or imply more, either way, are refused. [W]
        wraps_at: Reading at which a counter starts again from zero; None: it never does. [J]
        response: Delay and low pass of the meter; None: they are found from its readings.

    Attributes:
        lag: How late the meter shows what is drawn, where nothing is stated.
        minute: Sums over the newest minute.
        swing: Of the predicted power over what was compared, as whole numbers: time [ns], energy
            [nJ], power squared over time [mW^2 s]; replaced, never changed.
        compared_ns: Time over which both were integrated. [ns]
        patience_ns: How long predicted power waits for the meter. [ns]
        early_since_ns: Predicted stamp since which readings are stamped more than
            ``EARLY_NS`` later than what is predicted; None if they are not. [ns]
    """

    def __init__(
        self,
        max_gap: float = 2.0,
        patience: float = 60.0,
        max_power: float = MAX_POWER,
        wraps_at: float | None = None,
        response: MeterResponse | None = None,
    ) -> None:
        super().__init__(2)  # measured, predicted
        self._stated = response
        self.lag, self.minute = LagEstimate(), NewestMinute()
        self.swing = [0, 0, 0]
        self.curve = MeterCurve(max_gap, max_power, wraps_at)
        self.location = MeterLocation.UNKNOWN
        self.meaning = MeterMeaning.UNKNOWN
        self.compared_ns = 0
        self.idle: Idle | None = None
        self.early_since_ns: int | None = None
        self.patience_ns = round(max(patience, 3 * max_gap) / NANOSECOND)
        self._epochs = defaultdict[int, _Epoch](self._epoch)
        self._measured_epoch = 0
        self._predicted_epoch = 0
        self._last: tuple[int, int, float] | None = None  # stamp, segment, power
        self._beginning = True  # whether the meter has sent a few readings only
        self._led: tuple[int, int] | None = None  # jump of the prediction alone: stamp, readings

    def _epoch(self) -> _Epoch:
        return _Epoch(ShownPower(self._stated.delay if self._stated else 0.0))

    @property
    def response(self) -> MeterResponse:
        """Delay and low pass of the meter: as stated, else as found from its readings until now."""
        if self.meaning is MeterMeaning.CUMULATIVE:
            return MeterResponse(stated=self._stated is not None)
        return self._stated or MeterResponse(self.lag.lags[-1])

    @property
    def late_energy(self) -> float:
        """What the lag of the meter makes of the compared energies, +- in nine of ten cases. [J]

        A meter that is late by T shows T dP less than is drawn, dP the change of the power from the
        first reading to the last. Until its lag is known it may be as late as any that is found; a
        counter is not late.
        """
        known = self.meaning is MeterMeaning.CUMULATIVE or self._stated or self.lag.known
        lag = abs(self.response.time_constant + self.response.delay) if known else MAX_LAG
        time_ns, drawn, squares = self.swing
        time = max(time_ns, 1) * NANOSECOND
        variance = squares * MILLIWATT**2 / time - (drawn / NANOJOULE_PER_JOULE / time) ** 2
        return lag * Z90 * sqrt(2.0 * max(variance, 0.0))

    @property
    def comparable_energy(self) -> float:
        """Predicted energy to be set against the measured one; NaN while the lag matters. [J]"""
        sure = self.late_energy <= MAX_LATE * abs(self.measured_energy)
        return self.predicted_energy if self.compared_ns and sure else nan

    @property
    def measured_energy(self) -> float:
        """Measured energy over the compared intervals. [J]"""
        return float(self.joule[0])

    @property
    def predicted_energy(self) -> float:
        """Predicted energy at the meter's place over the same intervals. [J]"""
        return float(self.joule[1])

    def reset(self) -> None:
        """Begin at zero; what still waits for the meter is compared later."""
        super().reset()
        self.compared_ns, self.swing = 0, [0, 0, 0]

    def interrupt(self) -> None:
        """Compare nothing between the last and the next sample."""
        if self._last is not None:
            self._last = (self._last[0], NO_SEGMENT, np.nan)

    def measure(self, block: MeterBlock) -> None:
        """Take meter readings; they wait until power is predicted for their time."""
        self.location, self.meaning = block.location, block.meaning
        for number, part in enumerate(self.curve.step(block)):
            if number:
                self._beginning &= self.curve.left[number - 1] <= MAX_BEGINNING
                if self._beginning:  # the first stamps were wrong
                    first = self._epochs[self._measured_epoch]
                    first.measured, first.newest_ns = NO_PIECES, None
                else:
                    self._measured_epoch += 1
            if self._measured_epoch - self._predicted_epoch >= MAX_EPOCHS:
                self._adopt()
            epoch = self._epochs[self._measured_epoch]
            whole = CoveredPieces.concatenate([epoch.measured, part])
            epoch.measured = whole[slice(-MAX_PIECES, None)]
            if len(part):
                epoch.newest_ns = int(part.end_ns[-1])

    def predict(self, stamp_ns: Int, segment: Int, power: Float) -> Compared:
        """Return the intervals that become comparable with more predicted power.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            power: Predicted power at the meter's place, shape (N,). [W]
        """
        before = int(stamp_ns[0]) if self._last is None else self._last[0]
        steps = differences(stamp_ns, before)
        jumps, seconds = np.flatnonzero(steps < 0).tolist(), list[int]()
        if jumps or self._measured_epoch != self._predicted_epoch:
            # Epochs are matched at whole seconds, so that the cutting of the input does not matter.
            second = differences(stamp_ns // SECOND_NS, before // SECOND_NS)
            seconds = np.flatnonzero(second).tolist()
        done: list[Compared] = []
        for start, stop in pairwise(sorted({0, *seconds, *jumps, len(stamp_ns)})):
            now_ns, found = int(stamp_ns[start]), list[Compared]()
            if start in seconds:
                self._match(now_ns // SECOND_NS * SECOND_NS)
            if start in jumps:
                found.append(self._advance())
                self.lag.jump()
                self._last = None
                self._epochs.pop(self._predicted_epoch, None)
                self._predicted_epoch += 1
                self._led = now_ns, self.curve.rejections.accepted
            rows = slice(start, stop)
            self._extend(stamp_ns[rows], segment[rows], power[rows])
            found.append(self._advance())
            self._note_idle(now_ns, int(stamp_ns[stop - 1]), any(map(len, found)))
            done += found
        return Compared.concatenate(done)

    def _match(self, now_ns: int) -> None:
        """Go on with the meter's readings where only one side's clock has jumped back."""
        while self._measured_epoch > self._predicted_epoch and self._meter_alone(now_ns):
            self._adopt()
        if self._measured_epoch >= self._predicted_epoch or self._led is None:
            return
        since_ns, readings = self._led
        newest = self.curve.newest_ns
        waited = (
            now_ns - since_ns > ALONE_NS
            and self.curve.rejections.accepted - readings >= ALONE_READINGS
        )
        if waited and newest is not None and abs(newest - now_ns) < NEAR_NS:
            epoch = self._epochs[self._predicted_epoch]
            epoch.measured = self._epochs.pop(self._measured_epoch, self._epoch()).measured
            self._measured_epoch, self._led = self._predicted_epoch, None

    def _meter_alone(self, now_ns: int) -> bool:
        """Whether the meter jumped back and the prediction will not follow."""
        before = self._epochs.get(self._predicted_epoch, self._epoch())
        after = self._epochs.get(self._predicted_epoch + 1, self._epoch()).measured
        left_ns = before.newest_ns
        if left_ns is None or now_ns - left_ns > ALONE_NS:
            return True
        if left_ns - now_ns < NEAR_NS or not len(after):
            return False
        pieces = before.measured
        near = (pieces.end_ns > now_ns - ALONE_NS) & (pieces.stamp_ns < now_ns + NEAR_NS)
        return not near.any() and now_ns - int(after.stamp_ns[0]) > ALONE_NS

    def _adopt(self) -> None:
        """Compare what is predicted with the next epoch of the meter."""
        old = self._epochs.pop(self._predicted_epoch, self._epoch())
        self._predicted_epoch += 1
        epoch = self._epochs[self._predicted_epoch]
        epoch.predicted, epoch.done_ns, epoch.shown = old.predicted, old.done_ns, old.shown

    def _note_idle(self, first_ns: int, newest_ns: int, compared: bool) -> None:
        """Keep account of a stretch in which nothing is compared, from the first sample on."""
        curve = self.curve
        idle = self.idle or Idle(first_ns, first_ns, 0, 0, None)
        ahead_ns = None if curve.newest_ns is None else curve.newest_ns - newest_ns
        if compared or newest_ns < idle.since_ns:
            self.idle = Idle(newest_ns, newest_ns, curve.rejections.accepted, curve.gaps, ahead_ns)
        else:
            self.idle = replace(idle, until_ns=newest_ns, ahead_ns=ahead_ns)
        if ahead_ns is None or ahead_ns <= EARLY_NS:
            self.early_since_ns = None
        elif self.early_since_ns is None or newest_ns < self.early_since_ns:
            self.early_since_ns = newest_ns

    def _extend(self, stamp_ns: Int, segment: Int, power: Float) -> None:
        last = self._last or (int(stamp_ns[0]), int(segment[0]), float(power[0]))
        stamp, value = np.empty(len(power) + 1, dtype=np.int64), np.empty(len(power) + 1)
        stamp[0], stamp[1:], value[0], value[1:] = last[0], stamp_ns, last[2], power
        self._last = (int(stamp[-1]), int(segment[-1]), float(value[-1]))
        keep = stamp[1:] > stamp[:-1]
        keep[0] &= int(segment[0]) == last[1]
        keep[1:] &= segment[1:] == segment[:-1]
        if not isfinite(float(value.sum())):
            keep &= np.isfinite(value[1:]) & np.isfinite(value[:-1])
        pieces = CoveredPieces(stamp[:-1], stamp[1:], value[:-1], value[1:])
        begins = ~keep & (stamp[1:] > stamp[:-1])
        if not keep.all():
            pieces = pieces[keep]
        epoch = self._epochs[self._predicted_epoch]
        epoch.predicted = CoveredPieces.concatenate([epoch.predicted, pieces])
        if self.meaning is not MeterMeaning.CUMULATIVE:
            epoch.shown.waiting.append((stamp_ns, power, begins))

    def _advance(self) -> Compared:
        epoch = self._epochs[self._predicted_epoch]
        predicted, measured = epoch.predicted, epoch.measured
        result, end_ns = NO_INTERVALS, None
        if len(predicted) and len(measured):
            until = int(min(predicted.end_ns[-1], measured.end_ns[-1]))
            start = int(max(predicted.stamp_ns[0], measured.stamp_ns[0]))
            start = start if epoch.done_ns is None else max(start, epoch.done_ns)
            if until > start:
                result, end_ns = self._integrate(predicted, measured, start, until)
                epoch.done_ns = until
                epoch.measured = _after(measured, until)
                epoch.predicted = predicted = _after(predicted, until)
        shows = self.meaning is not MeterMeaning.CUMULATIVE
        if self._stated is not None:
            epoch.shown.follow([], [self._stated.time_constant])
        else:
            if shows and len(result):
                self.lag.take(result)
            epoch.shown.follow(self.lag.since_ns, self.lag.lags)
            if self.lag.since_ns and self._last is not None:
                self.lag.forget(self._last[0])
        if end_ns is not None:
            if shows:
                energy = epoch.shown.energy(result.drawn, end_ns - result.duration_ns, end_ns)
                result = replace(result, predicted=energy)
            self.minute.take(result)
        if len(predicted):
            oldest = predicted.end_ns[-1] - self.patience_ns
            if predicted.end_ns[0] < oldest:
                epoch.predicted = predicted = _after(predicted, int(oldest) - 1)
            epoch.shown.needed_ns = int(predicted.stamp_ns[0])
        elif self._last is not None:  # the meter is ahead: what follows begins at the last sample
            epoch.shown.needed_ns = self._last[0]
        return result

    def _integrate(
        self, predicted: CoveredPieces, measured: CoveredPieces, start: int, until: int
    ) -> tuple[Compared, Int]:
        """Return the intervals that both curves cover, and where each ends. [ns]"""
        found = None
        if kernels.compiled is not None:
            result, energy = _compiled(kernels.compiled, predicted, measured, start, until)
            if int(result.duration_ns.sum()) == until - start:  # they follow each other
                found = result, energy, start + np.cumsum(result.duration_ns)
        result, energy, end_ns = found or _compared(predicted, measured, start, until)
        self.add(energy)
        drawn, time = result.drawn, result.duration_ns * NANOSECOND
        swing = np.stack(
            [result.duration_ns, drawn * NANOJOULE_PER_JOULE, (drawn / MILLIWATT) ** 2 / time]
        )
        more = np.rint(swing).astype(np.int64).sum(axis=1).tolist()
        self.swing = [*map(add, self.swing, more)]
        self.compared_ns += int(result.duration_ns.sum())
        return result, end_ns


def _after(pieces: CoveredPieces, time_ns: int) -> CoveredPieces:
    """The pieces that end after a time."""
    return pieces[slice(int(np.searchsorted(pieces.end_ns, time_ns, side="right")), None)]


def _compiled(
    compiled: kernels.Compiled,
    predicted: CoveredPieces,
    measured: CoveredPieces,
    start: int,
    until: int,
) -> tuple[Compared, Float]:
    """Return the same as `_compared`, but for the ends."""
    room = 2 * (len(predicted) + len(measured)) + 2
    available, duration = np.empty((2, room), dtype=np.int64)
    energy = np.empty((2, room)).T
    found = compiled.compare(
        tuple(map(np.ascontiguousarray, vars(measured).values())),
        tuple(map(np.ascontiguousarray, vars(predicted).values())),
        start,
        until,
        available,
        duration,
        energy,
    )
    energy = energy[:found].copy(order="F")  # without the rest of the room
    times = available[:found].copy(), duration[:found].copy()
    return Compared(*times, energy[:, 0], energy[:, 1], energy[:, 1]), energy


def _compared(
    predicted: CoveredPieces, measured: CoveredPieces, start: int, until: int
) -> tuple[Compared, Float, Int]:
    """Return the intervals that both curves cover, their energies in one array, and their ends."""
    edges = np.concatenate([predicted.edges, measured.edges, [start, until]])
    np.maximum(edges, start, out=edges)
    np.minimum(edges, until, out=edges)
    edges.sort(kind="stable")
    edges = edges[differences(edges, start - 1) > 0]
    bounds = np.stack([edges[:-1], edges[1:]])
    row_p, in_p = predicted.index(*bounds)
    row_m, in_m = measured.index(*bounds)
    both = in_p & in_m
    if not both.all():
        bounds, row_p, row_m = bounds[:, both], row_p[both], row_m[both]
    duration_ns = bounds[1] - bounds[0]
    energy = np.empty((len(duration_ns), 2))
    for column, (pieces, row) in enumerate(((measured, row_m), (predicted, row_p))):
        low, high = pieces.value(row, bounds)
        energy[:, column] = (low + high) * (0.5 * NANOSECOND * duration_ns)
    times = measured.end_ns[row_m], duration_ns
    return Compared(*times, energy[:, 0], energy[:, 1], energy[:, 1]), energy, bounds[1]
