"""The energy account: registers, comparison with the meter, phases and short-term means.

It outlives a process: `EnergyAccount.state` gives all that must be kept as one record, and
`EnergyAccount.restore` continues from it. What lies between the last sample of a record and the
next sample is a gap, or a jump where the stamps went back; it never carries energy.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from robot_energy.accounting.account_record import carry_into, record_of, totals_of
from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.averaging import Averager, MeanBlock
from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.exact_sum import ExactSum, SampleCounts, greatest
from robot_energy.accounting.job_intervals import JobIntervals
from robot_energy.accounting.meter_checks import MeterDiagnostics
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.accounting.plain_text import MAX_REASON, require_plain_text
from robot_energy.accounting.power_curve import MAX_POWER
from robot_energy.accounting.record import (
    AccountRecord,
    Calibrated,
    EnergyInterval,
    EventLog,
    Identity,
    TraceEntry,
)
from robot_energy.accounting.registers import (
    CABINET_REGISTERS,
    CLOCK_STEP_NS,
    Registers,
    ShaftEnergySums,
)
from robot_energy.accounting.totals import Totals
from robot_energy.certainty.band_calibration import BandCalibration
from robot_energy.certainty.deviation import EnergyBand
from robot_energy.foundation.errors import RegisterError
from robot_energy.foundation.units import MINUTE_NS
from robot_energy.timeline.blocks import (
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    Phase,
    PowerBlock,
    SupplyBlock,
)
from robot_energy.timeline.pieces import NO_INTERVALS, Compared
from robot_energy.timeline.stamps import MAX_STAMP_NS, MIN_STAMP_NS

REPEATED_NS = 1_000_000_000  # after a restart, stamps up to this old were counted before it


@dataclass(frozen=True)
class AccountSettings:
    """How power is averaged and which meter readings count.

    Attributes:
        power_period: Averaging period of the power states; None makes no means. [s]
        meter_max_gap: Longest time between meter readings that is bridged. [s]
        meter_max_power: Readings that say or imply more, either way, are refused. [W]
        meter_wraps_at: Reading at which the meter's counter starts again from zero; None:
            it never does. [J]
        meter_unit: Unit the meter was said to use; empty for W or J.
    """

    power_period: float | None = 0.02
    meter_max_gap: float = 2.0
    meter_max_power: float = MAX_POWER
    meter_wraps_at: float | None = None
    meter_unit: str = ""


class EnergyAccount:
    """Integrates power and compares it with the meter.

    Args:
        response: Delay and low pass of the meter; None: they are found from its readings.
        floor: Speed below which a motor rests, shape (n,); None: where it holds. [rad/s]

    Attributes:
        on_reading: Called when the registers stand as a reading of its own must show them: with
            the UTC minute up to which all samples are counted, or 0 before they are set to
            zero or the stamps jump. [ns]
        shaft: Predicted and measured shaft energy of each joint.
        judgement: What is wrong with the meter.
        repeated: Samples left out after a restart because their time was counted before it.
        counts: Samples, by quality and phase, and the greatest power.
        calibration: How wide the bands of predicted power and energy must be.
        auxiliary: Account of the loads outside of the cabinet; None where none are counted.
    """

    def __init__(
        self,
        n_joints: int,
        settings: AccountSettings | None = None,
        response: MeterResponse | None = None,
        floor: Float | None = None,
    ) -> None:
        self._n_joints, self._floor = n_joints, floor
        self._response = response
        self._settings = settings or AccountSettings()
        period = self._settings.power_period
        self._averager = None if period is None else Averager(period)
        self.on_compared: Callable[[Compared], None] | None = None
        self.on_reading: Callable[[int], None] | None = None
        self.judgement = MeterDiagnostics(self._settings.meter_unit)
        self.repeated = 0
        self.auxiliary: AuxiliaryAccount | None = None
        self.begin()

    def begin(self) -> None:
        """Begin with all counters at zero."""
        self.registers = Registers(self._n_joints)
        self.comparison = Comparison(
            self._settings.meter_max_gap,
            max_power=self._settings.meter_max_power,
            wraps_at=self._settings.meter_wraps_at,
            response=self._response,
        )
        self.shaft = ShaftEnergySums(self._n_joints)
        self.counts = SampleCounts(self._floor)
        self.intervals = JobIntervals()
        self.calibration = BandCalibration()
        self.trace = EventLog()
        self.restarts = 0
        if self.auxiliary is not None:
            self.auxiliary.begin()
        self._unplaced: deque[SupplyBlock] = deque()
        self._resume_ns: int | None = None  # newest sample counted before a restart

    def measure(self, block: MeterBlock) -> None:
        """Take meter readings."""
        self.comparison.measure(block)
        if block.location is not MeterLocation.UNKNOWN:
            self.calibration.location = block.location

    def step(self, block: PowerBlock) -> MeanBlock | None:
        """Return the means of the periods that end with these power samples, or None.

        Raises:
            Exception: Whatever a fault of the program raises; nothing of the block, or of its
                last minute, is counted then, and its time is a gap.
        """
        if self.on_reading is None:
            return self._step(block)
        before = self.registers.time.end_ns
        first = int(block.stamp_ns[0]) if before is None else before
        minute = (block.stamp_ns - 1) // MINUTE_NS
        if not (minute != (first - 1) // MINUTE_NS).any():
            return self._step(block)
        cuts = self._minutes(block.stamp_ns, first)
        ended: list[MeanBlock] = []
        done = 0
        for place, minute_ns in (*cuts, (len(block), None)):
            means = self._step(block[slice(done, place)]) if place > done else None
            done = place
            if means is not None:
                ended.append(means)
            if minute_ns is not None:
                self.on_reading(minute_ns)
        return MeanBlock.concatenate(ended) if ended else None

    def _minutes(self, stamp_ns: Int, first: int) -> list[tuple[int, int]]:
        """Before which samples a minute of UTC ends, or the stamps jump; and that minute."""
        minute = (np.append(first, stamp_ns) - 1) // MINUTE_NS
        found = np.flatnonzero(minute[1:] != minute[:-1])
        step = np.diff(stamp_ns, prepend=first)[found]
        ends = np.where((step > 0) & (step <= CLOCK_STEP_NS), minute[1:][found] * MINUTE_NS, 0)
        return list(zip(found.tolist(), ends.tolist(), strict=True))

    def _step(self, block: PowerBlock) -> MeanBlock | None:
        registers, shaft, comparison = self.registers, self.shaft, self.comparison
        undo = [
            *map(ExactSum.mark, (registers, shaft, comparison)),
            *self.counts.mark(),
            partial(vars(registers).update, time=replace(registers.time)),
            partial(vars(shaft).update, compared_ns=shaft.compared_ns.copy()),
            partial(
                vars(comparison).update, compared_ns=comparison.compared_ns, swing=comparison.swing
            ),
            *(() if self.auxiliary is None else self.auxiliary.mark()),
        ]
        try:
            means, compared = self._counted(block)
        except Exception:  # all counters stand as before; the time until the next sample is a gap
            for each in undo:
                each()
            self.interrupt()
            raise
        if self.on_compared is not None and compared is not None:
            self.on_compared(compared)
        return means

    def _counted(self, block: PowerBlock) -> tuple[MeanBlock | None, Compared | None]:
        """Count a block; return the means and what was compared, None if all was counted before."""
        if self._resume_ns is not None:
            fresh = self._without_repeated(block, self._resume_ns)
            if fresh is None:
                return None, None
            block = fresh
        effort = not bool(np.isnan(block.shaft_power_measured).all())
        intervals, held = self.registers.step(block, effort or self._averager is not None)
        shaft = None
        if effort:
            shaft = self.shaft.step(block, intervals)
        else:
            self.shaft.last = np.nan
        compared = self._compare(block)
        imported = intervals.energy[:, CABINET_REGISTERS.index("grid_import")]
        self.counts.count(block, imported, intervals.duration_ns)
        if self.intervals.open_entries:
            self.intervals.step(greatest(block.grid_power))
        means = None
        if self._averager is not None:
            means = self._averager.step(block, intervals, shaft, compared)
        self.calibration.step(block, held, self.registers.held.open_ns, compared, means)
        if self.auxiliary is not None:
            if means is not None:
                means = replace(means, loads=self.auxiliary.shown(means.stamp_ns))
            self.auxiliary.step(block)
        return means, compared

    def _compare(self, block: PowerBlock) -> Compared:
        """Compare as far as possible; power waits until it is known where the meter sits."""
        location = self.comparison.location
        if location is MeterLocation.UNKNOWN:
            self._unplaced.append(block.supply)
            now = int(block.stamp_ns[-1])
            oldest = now - self.comparison.patience_ns
            while not oldest <= int(self._unplaced[0].stamp_ns[-1]) <= now:
                self._unplaced.popleft()
            return NO_INTERVALS
        supply: SupplyBlock = block
        if self._unplaced:
            supply = SupplyBlock.concatenate([*self._unplaced, block])
            self._unplaced.clear()
        return self.comparison.predict(supply.stamp_ns, supply.segment, supply.power_at(location))

    @property
    def start_ns(self) -> int | None:
        """Since when the registers count, within the range of stamps. [ns]"""
        return _in_range(self.registers.time.start_ns)

    @property
    def end_ns(self) -> int | None:
        """Newest counted sample, within the range of stamps. [ns]"""
        return _in_range(self.registers.time.end_ns)

    def totals(self) -> Totals:
        """Return all counters as they stand."""
        return totals_of(self, self.auxiliary)

    def state(self, identity: Identity) -> AccountRecord:
        """Return all that must be kept across a restart."""
        return record_of(self, identity)

    def restore(self, record: AccountRecord) -> None:
        """Continue from a record; what this account has counted is dropped."""
        self.resume(record)
        self.restarts += 1

    def resume(self, record: AccountRecord) -> None:
        """Go on with a record of this account; what it has counted since is dropped."""
        self.begin()
        carry_into(self, record)
        self._resume_ns = record.end_ns

    def precede(self, record: AccountRecord) -> None:
        """Put a record before what was counted since: nothing of either is lost.

        For state files that can be read only some time after the start, of the same joints.
        """
        carry_into(self, record)
        self.restarts += 1

    def calibrate(self, kept: Calibrated) -> None:
        """Go on with the bands and the lag of the meter that an earlier run has found."""
        self.calibration.restore(kept)
        self.comparison.lag.begin([(error, step) for error, step, _ in kept.energy_windows])

    def interrupt(self) -> None:
        """Count nothing from the last to the next sample: a gap, as over a restart."""
        self.registers.interrupt()
        self.comparison.interrupt()
        self.calibration.interrupt()
        if self.auxiliary is not None:
            self.auxiliary.interrupt()
        self._unplaced.clear()
        self._resume_ns = self.registers.time.end_ns

    def reset(self, reason: str) -> None:
        """Set all counters to zero at the newest sample; open intervals keep what they counted."""
        before = self.totals()
        if not reason.strip():
            raise RegisterError("a reset without a reason", "a few words that say why")
        require_plain_text("a reason", reason.strip(), MAX_REASON, RegisterError)
        if self.end_ns is None:
            raise RegisterError("no sample has been counted yet", "registers that have counted")
        if self.on_reading is not None:
            self.on_reading(0)
        self.trace.add(
            TraceEntry(
                kind="reset",
                stamp_ns=self.end_ns,
                text=reason.strip(),
                totals=before,
                energy_start_ns=self.start_ns,
            )
        )
        self.intervals.rebase(before)
        self.registers.reset()
        self.shaft.reset()
        self.comparison.reset()
        self.counts.reset()
        if self.auxiliary is not None:
            self.auxiliary.reset()

    def open_interval(self, name: str) -> EnergyInterval:
        """Return a job interval of a name that is not open, from the newest counted sample on."""
        return self.intervals.open(name, self.end_ns, self.totals())

    def close_interval(self, name: str = "", interval_id: int = 0) -> EnergyInterval:
        """Return a job interval, by number or name, ended at the newest counted sample."""
        return self.intervals.close(name, interval_id, self.end_ns or 0, self.totals())

    def list_intervals(self) -> list[EnergyInterval]:
        """Return the latest closed intervals and the open ones as they stand."""
        return self.intervals.listed(self.end_ns, self.totals())

    def _without_repeated(self, block: PowerBlock, before_ns: int) -> PowerBlock | None:
        """Leave out the first samples after a restart if their time is counted already.

        A stamp that is far older is a jump back, not a repetition.
        """
        stamp = block.stamp_ns
        known = (stamp > before_ns - REPEATED_NS) & (stamp <= before_ns)
        first = len(block) if known.all() else int(np.argmin(known))
        self.repeated += first
        if first == len(block):
            return None
        self._resume_ns = None
        return block[slice(first, None)]

    def flush(self) -> MeanBlock | None:
        """Return the mean of the period that is still open, and decide what waits for loads."""
        means = None if self._averager is None else self._averager.flush()
        if means is not None:
            self.calibration.finish(means)
        if self.auxiliary is not None:
            if means is not None:
                means = replace(means, loads=self.auxiliary.shown(means.stamp_ns))
            self.auxiliary.flush()
        return means

    @property
    def energy_band(self) -> EnergyBand:
        """How sure the predicted net energy from the grid is."""
        return self.calibration.energy_band(self.registers.deviation)

    def phase_energy(self, phase: Phase) -> float:
        """Return the predicted energy drawn from the grid in a phase, >= 0. [J]"""
        return float(self.counts.phase_energy_sum.joule[phase])

    def phase_time(self, phase: Phase) -> float:
        """Return the observed time in a phase. [s]"""
        return float(self.counts.phase_ns[phase]) * 1e-9


def _in_range(stamp_ns: int | None) -> int | None:
    return None if stamp_ns is None else max(MIN_STAMP_NS, min(stamp_ns, MAX_STAMP_NS))
