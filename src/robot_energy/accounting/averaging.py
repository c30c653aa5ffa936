"""Means over short periods, for dashboards and for the bag that replay writes."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.accounting.load_curve import COLUMNS, HOLD_NS
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, SampleIntervals
from robot_energy.certainty.deviation import Z90, BandKind, power_std
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Bits,
    Block,
    Float,
    Int,
    Phase,
    PowerBlock,
    differences,
)
from robot_energy.timeline.pieces import NO_INTERVALS, Compared


class MeanBlock(Block):
    """Power averaged over periods; one row per period."""

    stamp_ns: Annotated[Int, "Last sample of the period, shape (W,). [ns]"]
    quality: Annotated[Bits, "All quality bits met, shape (W,)."]
    phase: Annotated[Int, "That held for the largest part of the period, shape (W,)."]
    period: Annotated[Float, "Time integrated, shape (W,). [s]"]
    coverage: Annotated[
        Float, "Integrated share of the time since the last period, shape (W,). [-]"
    ]
    cabinet: Annotated[Float, "Mean of each cabinet register's power, shape (W, 6). [W]"]
    joints: Annotated[Float, "Mean of each joint register's power, shape (W, 5, n). [W]"]
    deviation: Annotated[Float, "Mean of the deviations of the power, shape (W, K). [W]"]
    band_half: Annotated[
        Float, "Half width of the 90 % band about the mean grid power, shape (W,). [W]"
    ]
    band: Annotated[
        Int, "What kind of band it is, `robot_energy.certainty.deviation.BandKind`, shape (W,)."
    ]
    shaft_power_measured: Annotated[
        Float,
        "Mean, shape (W, n); NaN unless the effort covers all of the time integrated, so that it "
        "compares with the predicted mean. [W]",
    ]
    motor_velocity: Annotated[Float, "At the last sample, shape (W, n)."]
    motor_torque: Annotated[Float, "At the last sample, shape (W, n)."]
    motor_torque_measured: Annotated[Float, "At the last sample, shape (W, n)."]
    coulomb: Annotated[Float, "At the last sample, shape (W, n)."]
    viscous: Annotated[Float, "At the last sample, shape (W, n)."]
    motor_temperature_degc: Annotated[Float, "At the last sample, shape (W, n)."]
    payload_mass: Annotated[Float, "At the last sample, shape (W,). [kg]"]
    measured_power: Annotated[Float, "Mean over the newest compared intervals, shape (W,). [W]"]
    predicted_power_at_meter: Annotated[Float, "Mean over the same intervals, shape (W,). [W]"]
    comparison_coverage: Annotated[Float, "Compared share of the time they span, shape (W,). [-]"]
    measurement_age: Annotated[
        Float, "From the newest compared interval to the stamp, shape (W,). [s]"
    ]
    loads: Annotated[
        Float,
        "Of each auxiliary load at the stamp, in the order of "
        "`robot_energy.accounting.load_curve.COLUMNS`, shape (W, loads, 6).",
    ]

    @property
    def predicted_power(self) -> Float:
        """Mean net power from the grid, shape (W,). [W]"""
        return self.cabinet[:, 0] - self.cabinet[:, 1]

    @property
    def powers(self) -> dict[str, Float]:
        """Means by register, shape (W,) of the cabinet and (W, n) of joints. [W]"""
        names = (*CABINET_REGISTERS, *JOINT_REGISTERS)
        return dict(zip(names, (*self.cabinet.T, *self.joints.swapaxes(0, 1)), strict=True))


SHOWN = (
    "motor_velocity", "motor_torque", "motor_torque_measured", "coulomb", "viscous",
    "motor_temperature_degc",
)  # fmt: skip
_TIMES, _SEEN = slice(1, 1 + len(Phase)), slice(1 + len(Phase), None)  # in `_Pieces.counted`


class _Pieces(Block):
    """Parts of periods, one row each."""

    stamp_ns: Annotated[Int, "Last sample, shape (W,). [ns]"]
    shown: Annotated[
        Float, "At that sample, what ``SHOWN`` names and the payload, shape (W, 6 n + 1)."
    ]
    energy: Annotated[
        Float,
        "In the order of the registers, then deviations and measured at the shafts, shape (W, R + "
        "K + n). [J]",
    ]
    quality: Annotated[Bits, "All bits met, shape (W,)."]
    counted: Annotated[
        Int,
        "Time integrated, time of each phase and the number of the last sample in each phase, -1 "
        "for none, shape (W, 1 + 2 phases). [ns] and [-]",
    ]


class Averager:
    """Cuts power samples at the multiples of the period and averages each piece.

    Args:
        period: Length of a period. [s]
    """

    def __init__(self, period: float) -> None:
        self._period_ns = round(period / NANOSECOND)
        self._open: _Pieces | None = None  # the period that has not ended, one row
        self._closed_ns: int | None = None  # stamp at which the last period ended
        self._compared: list[Compared] = []
        self._shown = (np.nan, np.nan, np.nan)  # measured, predicted, coverage
        self._shown_ns: int | None = None
        self._hold_ns = HOLD_NS
        self._samples = 0
        self._last: tuple[int, int] | None = None  # stamp and segment of the last sample

    def step(
        self, block: PowerBlock, intervals: SampleIntervals, shaft: Float | None, compared: Compared
    ) -> MeanBlock | None:
        """Return the periods that end with these samples, one row each; None if none does.

        Args:
            shaft: Measured shaft energy of each interval, shape (N, n), NaN where unknown;
                None where all is. [J]
        """
        if len(compared):
            self._compared.append(compared)
        number = block.stamp_ns // self._period_ns
        carried = self._open
        previous = number[0] if carried is None else carried.stamp_ns[0] // self._period_ns
        starts = differences(number, int(previous)).nonzero()[0]
        lead = int(len(starts) > 0 and starts[0] == 0)
        pieces = self._cut(
            block, intervals, shaft, starts if lead else np.concatenate([[0], starts]), lead
        )
        if lead and carried is not None:  # it has ended; the first row is kept free for it
            for each, before in zip(vars(pieces).values(), vars(carried).values(), strict=True):
                each[0] = before[0]
        elif carried is not None:  # the first piece goes on with it
            pieces.energy[0] += carried.energy[0]
            pieces.quality[0] |= carried.quality[0]
            seen = np.maximum(pieces.counted[0, _SEEN], carried.counted[0, _SEEN])
            pieces.counted[0] += carried.counted[0]
            pieces.counted[0, _SEEN] = seen
        self._open = pieces[slice(-1, None)]
        return self._close(pieces[slice(0, -1)]) if len(pieces) > 1 else None

    def _cut(
        self, block: PowerBlock, intervals: SampleIntervals, shaft: Float | None, bounds: Int,
        lead: int,
    ) -> _Pieces:  # fmt: skip
        """Sum up the pieces that begin at rows, after so many free rows."""
        size, n_joints = lead + len(bounds), block.rigid_power.shape[1]
        held = block.deviation
        width, deviation = intervals.energy.shape[1], held.values[held.row]
        pieces = _Pieces(
            np.empty(size, dtype=np.int64),
            np.empty((size, len(SHOWN) * n_joints + 1)),
            np.empty((size, width + deviation.shape[1] + n_joints)),
            np.empty(size, dtype=np.uint32),
            np.empty((size, 1 + 2 * len(Phase)), dtype=np.int64),
        )
        last = np.empty_like(bounds)
        last[:-1], last[-1] = bounds[1:] - 1, len(block) - 1
        pieces.stamp_ns[lead:] = block.stamp_ns[last]
        for index, name in enumerate(SHOWN):
            columns = slice(index * n_joints, (index + 1) * n_joints)
            pieces.shown[lead:, columns] = block.__dict__[name].T.take(last, axis=1).T
        pieces.shown[lead:, -1] = block.payload_mass[last]
        duration_ns = np.add.reduceat(intervals.duration_ns, bounds)
        pieces.energy[lead:, :width] = np.add.reduceat(intervals.energy, bounds, axis=0)
        deviation *= (intervals.duration_ns * NANOSECOND)[:, None]
        pieces.energy[lead:, width:-n_joints] = np.add.reduceat(deviation, bounds, axis=0)
        pieces.energy[lead:, -n_joints:] = (
            np.where(duration_ns > 0, np.nan, 0.0)[:, None]
            if shaft is None
            else np.add.reduceat(shaft, bounds, axis=0)
        )
        pieces.quality[lead:] = np.bitwise_or.reduceat(block.quality, bounds)
        counted = pieces.counted[lead:]
        counted[:, 0] = duration_ns
        counted[:, _TIMES], counted[:, _SEEN] = self._phases(block, intervals.duration_ns, bounds)
        return pieces

    def _phases(self, block: PowerBlock, duration_ns: Int, bounds: Int) -> tuple[Int, Int]:
        """How long each phase held in each piece, and its last sample; shape (pieces, phases).

        The time up to a sample counts for the phase of that sample, as in the registers.
        Those count no time of unknown power; here it counts for UNKNOWN.
        """
        stamp, segment = block.stamp_ns, block.segment
        before = self._last or (int(stamp[0]), int(segment[0]))
        time_ns, unknown = duration_ns, block.phase == Phase.UNKNOWN
        if unknown.any():
            unknown &= (differences(segment, before[1]) == 0) & (duration_ns == 0)
            time_ns = np.where(unknown, np.maximum(differences(stamp, before[0]), 0), duration_ns)
        self._last = (int(stamp[-1]), int(segment[-1]))
        piece = np.zeros(len(block), dtype=np.int64)
        piece[bounds[1:]] = 1
        np.cumsum(piece, out=piece)
        shape = (len(bounds), len(Phase))
        cell = piece * len(Phase) + block.phase
        held = np.bincount(cell, weights=time_ns, minlength=len(bounds) * len(Phase))
        seen = np.full(shape, -1)
        seen.reshape(-1)[cell] = self._samples + np.arange(len(block))  # the last one stays
        self._samples += len(block)
        return held.astype(np.int64).reshape(shape), seen

    def flush(self) -> MeanBlock | None:
        """Return the period that is still open."""
        carried, self._open = self._open, None
        return None if carried is None or not carried.counted[0, 0] else self._close(carried)

    def _close(self, ended: _Pieces) -> MeanBlock:
        stamp, energy, duration_ns = ended.stamp_ns, ended.energy, ended.counted[:, 0]
        before = np.empty_like(stamp)
        before[0] = stamp[0] - duration_ns[0] if self._closed_ns is None else self._closed_ns
        before[1:] = stamp[:-1]
        self._closed_ns = int(stamp[-1])
        duration = duration_ns * NANOSECOND
        with np.errstate(divide="ignore", invalid="ignore"):
            power = energy / duration[:, None]
            power[duration == 0] = np.nan
            share = duration / ((stamp - before) * NANOSECOND)
        n_joints = ended.shown.shape[1] // len(SHOWN)
        split = len(CABINET_REGISTERS)
        end = split + len(JOINT_REGISTERS) * n_joints
        deviation = power[:, end:-n_joints]
        measured = self._show(stamp)
        held_ns, seen = ended.counted[:, _TIMES], ended.counted[:, _SEEN]
        longest = held_ns == np.where(seen >= 0, held_ns, -1).max(axis=1, keepdims=True)
        phase = np.where(longest, seen, -1).argmax(axis=1)  # of equal ones the later
        return MeanBlock(
            stamp_ns=stamp,
            quality=ended.quality,
            phase=phase,
            period=duration,
            coverage=np.minimum(np.maximum(share, 0.0), 1.0),
            cabinet=power[:, :split],
            joints=power[:, split:end].reshape(len(stamp), len(JOINT_REGISTERS), n_joints),
            deviation=deviation,
            band_half=Z90 * power_std(deviation),
            band=np.full(len(stamp), BandKind.PARAMETRIC),
            shaft_power_measured=power[:, -n_joints:],
            **dict(zip(SHOWN, np.hsplit(ended.shown[:, :-1], len(SHOWN)), strict=True)),
            payload_mass=ended.shown[:, -1],
            measured_power=measured[:, 0],
            predicted_power_at_meter=measured[:, 1],
            comparison_coverage=measured[:, 2],
            measurement_age=measured[:, 3],
            loads=np.empty((len(stamp), 0, len(COLUMNS))),
        )

    def _show(self, stamp: Int) -> Float:
        """Measured and predicted power known at each stamp, shape (W, 4)."""
        rows = np.full((len(stamp), 4), np.nan)
        if not self._compared and self._shown_ns is None:
            return rows
        waiting = Compared.concatenate(self._compared or [NO_INTERVALS])
        available = waiting.stamp_ns
        table = np.stack([waiting.measured, waiting.predicted, waiting.duration_ns], axis=1)
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(table, axis=0)])
        upto = np.searchsorted(available, stamp, side="right")
        done = 0
        for index, (count, now) in enumerate(zip(upto.tolist(), stamp.tolist(), strict=True)):
            if count > done:
                measured, predicted, duration = (total[count] - total[done]).tolist()
                newest = int(available[count - 1])
                first = int(available[done]) if self._shown_ns is None else self._shown_ns
                span = max(newest - first, duration)
                seconds = duration * NANOSECOND
                self._shown = (measured / seconds, predicted / seconds, duration / span)
                self._hold_ns = max(HOLD_NS, 2 * round(duration))
                self._shown_ns, done = newest, count
            if self._shown_ns is not None and now - self._shown_ns <= self._hold_ns:
                rows[index] = (*self._shown, (now - self._shown_ns) * NANOSECOND)
        self._compared = [waiting[slice(done, None)]] if done < len(waiting) else []
        return rows
