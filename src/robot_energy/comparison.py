"""Predicted beside measured power, over exactly the same covered intervals.

A meter has its own rate and its own meaning. Its readings become pieces of a curve:
straight between instantaneous readings, level over the interval of a mean or between
two readings of a counter. The predicted power is straight between samples. Both are
integrated over the intersection of what is covered by both, cut at every breakpoint of
either, so the result does not depend on how the input is cut into blocks.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import (
    NANOSECOND,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    differences,
)
from robot_energy.registers import ExactSum

SECOND_NS = 1_000_000_000
MAX_PIECES = 1_000_000
ALONE_NS = 10 * SECOND_NS  # a jump of the meter that the prediction does not follow by then
BACKWARD_JUMP_NS = SECOND_NS  # older readings than this are a new epoch, not late ones


@dataclass(frozen=True)
class Pieces:
    """Straight pieces of a power curve, in time order, not overlapping.

    Attributes:
        start_ns: Shape (N,). [ns]
        end_ns: Shape (N,). [ns]
        start_power: Shape (N,). [W]
        end_power: Shape (N,). [W]
    """

    start_ns: Int
    end_ns: Int
    start_power: Float
    end_power: Float

    def __len__(self) -> int:
        return len(self.start_ns)

    def __getitem__(self, rows: NDArray[np.bool_] | slice) -> Pieces:
        return Pieces(
            self.start_ns[rows], self.end_ns[rows], self.start_power[rows], self.end_power[rows]
        )

    @classmethod
    def empty(cls) -> Pieces:
        """No pieces."""
        none = np.empty(0, dtype=np.int64)
        return cls(none, none, np.empty(0), np.empty(0))

    def join(self, later: Pieces) -> Pieces:
        """Return these pieces followed by later ones."""
        if not len(self):
            return later
        return Pieces(
            np.concatenate([self.start_ns, later.start_ns]),
            np.concatenate([self.end_ns, later.end_ns]),
            np.concatenate([self.start_power, later.start_power]),
            np.concatenate([self.end_power, later.end_power]),
        )

    @property
    def edges(self) -> Int:
        """Every start and end, those that touch only once. [ns]"""
        apart = np.ones(len(self), dtype=np.int64)  # the first piece touches none
        apart[1:] = self.start_ns[1:] - self.end_ns[:-1]
        return np.concatenate([self.start_ns[apart != 0], self.end_ns])

    def index(self, start_ns: Int, end_ns: Int) -> tuple[Int, NDArray[np.bool_]]:
        """Return which piece holds each interval, and whether one does."""
        if not len(self):
            return np.zeros(len(start_ns), dtype=np.int64), np.zeros(len(start_ns), dtype=np.bool_)
        row = np.maximum(np.searchsorted(self.start_ns, start_ns, side="right") - 1, 0)
        return row, (self.start_ns[row] <= start_ns) & (end_ns <= self.end_ns[row])

    def value(self, row: Int, time_ns: Int) -> Float:
        """Return the power at a time inside the piece ``row``. [W]"""
        start = self.start_ns[row]
        share = (time_ns - start) / (self.end_ns[row] - start)
        low = self.start_power[row]
        return low + (self.end_power[row] - low) * share


@dataclass(frozen=True)
class Compared:
    """Elementary intervals on which both powers are known.

    Attributes:
        available_ns: When the meter had reported the interval, shape (K,). [ns]
        duration_ns: Shape (K,). [ns]
        measured: Measured energy, shape (K,). [J]
        predicted: Predicted energy at the meter's place, shape (K,). [J]
    """

    available_ns: Int
    duration_ns: Int
    measured: Float
    predicted: Float


class MeterCurve:
    """Turns readings into pieces and counts what it cannot use.

    Args:
        max_gap: Longest time between readings that is bridged. [s]
    """

    def __init__(self, max_gap: float) -> None:
        self.received = 0
        self.accepted = 0
        self.rejected: Counter[str] = Counter()
        self._max_gap_ns = round(max_gap / NANOSECOND)
        self.left_ns = 0  # newest reading before the last backward jump
        self._last: tuple[int, float] | None = None  # stamp, power or energy

    def step(self, block: MeterBlock) -> tuple[list[Pieces], int]:
        """Take readings.

        Args:
            block: Readings in order of arrival.

        Returns:
            Pieces, one list entry for each epoch touched, and the number of backward
            jumps met; the first entry continues the running epoch.
        """
        self.received += len(block)
        cumulative = block.meaning is MeterMeaning.CUMULATIVE
        value = block.energy if cumulative else block.power
        good = np.isfinite(value)
        if block.meaning is MeterMeaning.MEAN_OVER_INTERVAL:
            good &= np.isfinite(block.interval) & (block.interval > 0)
        self.rejected["meter_not_finite"] += int((~good).sum())
        epochs: list[list[int]] = [[]]
        stamps = block.stamp_ns.tolist()
        newest = self._last[0] if self._last else None
        for row in np.flatnonzero(good).tolist():
            stamp = stamps[row]
            if newest is None or stamp > newest:
                epochs[-1].append(row)
            elif stamp <= newest - BACKWARD_JUMP_NS:
                epochs.append([row])
                self.left_ns = newest
            else:
                self.rejected["meter_not_newer"] += 1
                continue
            newest = stamp
        pieces: list[Pieces] = []
        for number, rows in enumerate(epochs):
            if number:
                self._last = None
            self.accepted += len(rows)
            index = np.asarray(rows, dtype=np.int64)
            pieces.append(self._pieces(block, index, value) if rows else Pieces.empty())
        return pieces, len(epochs) - 1

    def _pieces(self, block: MeterBlock, rows: Int, value: Float) -> Pieces:
        stamp, power = block.stamp_ns[rows], value[rows]
        previous, before = np.empty_like(stamp), np.empty_like(power)
        previous[1:], before[1:] = stamp[:-1], power[:-1]
        known = np.ones(len(rows), dtype=np.bool_)
        known[0] = self._last is not None
        previous[0], before[0] = self._last if self._last is not None else (stamp[0] - 1, 0.0)
        self._last = (int(stamp[-1]), float(power[-1]))
        if block.meaning is MeterMeaning.INSTANTANEOUS:
            keep = known & (stamp - previous <= self._max_gap_ns)
            return Pieces(previous, stamp, before, power)[keep]
        if block.meaning is MeterMeaning.CUMULATIVE:
            rising = known & (power >= before)
            fell = int((known & ~rising).sum())  # the counter was reset: it starts anew here
            self.rejected["meter_counter_fell"] += fell
            self.accepted -= fell
            mean = (power - before) / ((stamp - previous) * NANOSECOND)
            keep = rising & (stamp - previous <= self._max_gap_ns)
            return Pieces(previous, stamp, mean, mean)[keep]
        start = stamp - np.rint(block.interval[rows] / NANOSECOND).astype(np.int64)
        start = np.where(known, np.maximum(start, previous), start)
        return Pieces(start, stamp, power, power)


@dataclass
class _Epoch:
    predicted: Pieces = field(default_factory=Pieces.empty)
    measured: Pieces = field(default_factory=Pieces.empty)
    done_ns: int | None = None


class Comparison:
    """Accumulates predicted and measured energy over what both cover.

    Args:
        max_gap: Longest time between meter readings that is bridged. [s]
        patience: How long predicted power waits for the meter. [s]
    """

    def __init__(self, max_gap: float = 2.0, patience: float = 60.0) -> None:
        self.curve = MeterCurve(max_gap)
        self.location = MeterLocation.UNKNOWN
        self.compared_ns = 0
        self._patience_ns = round(max(patience, 3 * max_gap) / NANOSECOND)
        self._sum = ExactSum(2)
        self._epochs: dict[int, _Epoch] = {0: _Epoch()}
        self._measured_epoch = 0
        self._predicted_epoch = 0
        self._last: tuple[int, int, float] | None = None  # stamp, segment, power

    @property
    def patience_ns(self) -> int:
        """How long predicted power waits for the meter. [ns]"""
        return self._patience_ns

    @property
    def measured_energy(self) -> float:
        """Measured energy over the compared intervals. [J]"""
        return float(self._sum.joule[0])

    @property
    def predicted_energy(self) -> float:
        """Predicted energy at the meter's place over the same intervals. [J]"""
        return float(self._sum.joule[1])

    def measure(self, block: MeterBlock) -> None:
        """Take meter readings; they wait for the prediction to catch up."""
        self.location = block.location
        pieces, _ = self.curve.step(block)
        for number, part in enumerate(pieces):
            self._measured_epoch += number > 0
            epoch = self._epochs.setdefault(self._measured_epoch, _Epoch())
            epoch.measured = epoch.measured.join(part)[slice(-MAX_PIECES, None)]

    def predict(self, stamp_ns: Int, segment: Int, power: Float) -> Compared:
        """Take predicted power and compare as far as both are known.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            power: Predicted power at the meter's place, shape (N,). [W]

        Returns:
            The elementary intervals that became comparable.
        """
        done: list[Compared] = []
        alone = int(stamp_ns[-1]) - self.curve.left_ns > ALONE_NS
        if self._measured_epoch > self._predicted_epoch and alone:
            for number in range(self._predicted_epoch, self._measured_epoch):
                self._epochs.pop(number, None)  # the meter's clock alone jumped
            self._predicted_epoch = self._measured_epoch
        previous = stamp_ns[0] if self._last is None else self._last[0]
        jumps = np.flatnonzero(differences(stamp_ns, int(previous)) < 0).tolist()
        for start, stop in zip([0, *jumps], [*jumps, len(stamp_ns)], strict=True):
            if stop > start:
                rows = slice(start, stop)
                self._extend(stamp_ns[rows], segment[rows], power[rows])
            if stop < len(stamp_ns):
                done.append(self._advance())
                self._last = None
                self._epochs.pop(self._predicted_epoch, None)
                self._predicted_epoch += 1
        done.append(self._advance())
        return Compared(
            *(
                np.concatenate([getattr(part, name) for part in done])
                for name in ("available_ns", "duration_ns", "measured", "predicted")
            )
        )

    def _extend(self, stamp_ns: Int, segment: Int, power: Float) -> None:
        last = self._last or (int(stamp_ns[0]), int(segment[0]), float(power[0]))
        stamp = np.concatenate([[last[0]], stamp_ns])
        part = np.concatenate([[last[1]], segment])
        value = np.concatenate([[last[2]], power])
        self._last = (int(stamp[-1]), int(part[-1]), float(value[-1]))
        keep = (np.diff(part) == 0) & (np.diff(stamp) > 0)
        keep &= np.isfinite(value[1:]) & np.isfinite(value[:-1])
        pieces = Pieces(stamp[:-1], stamp[1:], value[:-1], value[1:])[keep]
        epoch = self._epochs.setdefault(self._predicted_epoch, _Epoch())
        epoch.predicted = epoch.predicted.join(pieces)

    def _advance(self) -> Compared:
        epoch = self._epochs.setdefault(self._predicted_epoch, _Epoch())
        predicted, measured = epoch.predicted, epoch.measured
        none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
        result = Compared(none, none, nothing, nothing)
        if len(predicted) and len(measured):
            until = int(min(predicted.end_ns[-1], measured.end_ns[-1]))
            start = int(max(predicted.start_ns[0], measured.start_ns[0]))
            start = start if epoch.done_ns is None else max(start, epoch.done_ns)
            if until > start:
                result = self._integrate(predicted, measured, start, until)
                epoch.done_ns = until
                epoch.measured = measured[measured.end_ns > until]
                epoch.predicted = predicted = predicted[predicted.end_ns > until]
        if len(predicted):
            oldest = predicted.end_ns[-1] - self._patience_ns
            if predicted.end_ns[0] < oldest:
                epoch.predicted = predicted[predicted.end_ns >= oldest]
        return result

    def _integrate(self, predicted: Pieces, measured: Pieces, start: int, until: int) -> Compared:
        edges = np.concatenate([predicted.edges, measured.edges, [start, until]])
        edges = np.sort(edges[(edges >= start) & (edges <= until)], kind="stable")
        edges = edges[differences(edges, start - 1) > 0]
        low, high = edges[:-1], edges[1:]
        row_p, in_p = predicted.index(low, high)
        row_m, in_m = measured.index(low, high)
        both = in_p & in_m
        low, high, row_p, row_m = low[both], high[both], row_p[both], row_m[both]
        half = 0.5 * NANOSECOND * (high - low)
        energy = np.stack(
            [
                (measured.value(row_m, low) + measured.value(row_m, high)) * half,
                (predicted.value(row_p, low) + predicted.value(row_p, high)) * half,
            ],
            axis=1,
        )
        self._sum.add(energy)
        self.compared_ns += int((high - low).sum())
        return Compared(measured.end_ns[row_m], high - low, energy[:, 0], energy[:, 1])
