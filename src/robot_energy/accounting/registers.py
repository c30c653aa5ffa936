"""The energy registers of one robot: cabinet and joints, drawn and given.

Each interval between two finite samples of one segment adds its trapezoid (paper A,
eq. 7) to exact sums. The deviations of the power, whose sums say how sure the energies are, are
held for 10 ms each and added when these have passed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.exact_sum import ExactSum, add_saturating
from robot_energy.certainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.foundation.described import Described
from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.physics import kernels
from robot_energy.physics.equations import interval_energy
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int, PowerBlock, differences

CLOCK_STEP_NS = 90 * 86_400 * 10**9  # a longer step between two samples is one of the clock [ns]
MAX_ENERGY = 2e6  # of one interval, which sums exactly [J]
NO_SEGMENT = -1  # segments count from zero: nothing is integrated from this one
CABINET_REGISTERS = ("grid_import", "grid_return", "brake", "loss_dc", "loss_grid", "capacitor")
JOINT_REGISTERS = ("shaft_positive", "shaft_negative", "rigid", "friction", "drive_loss")
SHAFT_REGISTERS = (
    "measured_positive",
    "measured_negative",
    "predicted_positive",
    "predicted_negative",
)
PREDICTED = len(CABINET_REGISTERS)  # column of the first predicted shaft energy in an interval
MAX_INTERVAL_ENERGY = 1e6  # J in one interval; more is not a measurement, does not fit the sums


@dataclass
class Coverage:
    """How much of a recording was integrated: ``span = observed + gap``, exact in ns.

    A step of the stamps that is longer than ``CLOCK_STEP_NS`` is not a gap: the clock was set, as
    after a start in 1970, and how much time has passed is unknown. It is a jump, forward instead
    of backward, and no time passes across it.

    Attributes:
        observed_ns: Time between finite samples of one segment. [ns]
        gap_ns: Time between samples that could not be integrated. [ns]
        jumps: Number of jumps of the stamps, backward or forward by more than
            ``CLOCK_STEP_NS``; no time passes across one.
        in_gap: Whether the last sample ended a gap, which may go on.
    """

    observed_ns: int = 0
    gap_ns: int = 0
    gap_count: int = 0
    jumps: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    in_gap: bool = field(default=False, compare=False, repr=False)

    def take(self, elapsed: Int, observed: NDArray[np.bool_]) -> None:
        """Count the time between samples.

        Args:
            elapsed: From the sample before to each sample, shape (N,), N >= 1. [ns]
            observed: Whether that time was integrated, shape (N,).
        """
        if observed.all():
            self.observed_ns = min(self.observed_ns + int(elapsed.sum()), MAX_COUNTER)
            self.in_gap = False
            return
        jump = (elapsed < 0) | (elapsed > CLOCK_STEP_NS)
        missing = ~observed & ~jump & (elapsed > 0)
        begins = missing & ~np.concatenate([[self.in_gap], missing[:-1]])
        self.count(
            _total(elapsed[observed]), _total(elapsed[missing]), int(begins.sum()), int(jump.sum())
        )
        self.in_gap = bool(missing[-1])

    def precede(self, earlier: Coverage) -> None:
        """Put an earlier account before this one; what lies between is a gap, or a jump."""
        between = 0
        if earlier.end_ns is not None and self.start_ns is not None:
            between = self.start_ns - earlier.end_ns
        gap_ns = between if 0 < between <= CLOCK_STEP_NS else 0
        self.count(
            earlier.observed_ns,
            earlier.gap_ns + gap_ns,
            earlier.gap_count + (gap_ns > 0),
            earlier.jumps + (between != gap_ns),
        )
        if earlier.start_ns is not None:
            self.start_ns = earlier.start_ns
        if self.end_ns is None:
            self.end_ns = earlier.end_ns

    def surround(self, before_ns: int, after_ns: int) -> None:
        """Count time at both ends of which no sample could be used as gaps."""
        for time_ns in (before_ns, after_ns):
            self.count(0, time_ns, int(time_ns > 0), 0)
        if self.start_ns is not None and self.end_ns is not None:
            self.start_ns, self.end_ns = self.start_ns - before_ns, self.end_ns + after_ns

    def count(self, observed_ns: int, gap_ns: int, gap_count: int, jumps: int) -> None:
        """Count on; a counter that is full stays so."""
        self.observed_ns = min(self.observed_ns + observed_ns, MAX_COUNTER)
        self.gap_ns = min(self.gap_ns + gap_ns, MAX_COUNTER)
        self.gap_count = min(self.gap_count + gap_count, MAX_COUNTER)
        self.jumps = min(self.jumps + jumps, MAX_COUNTER)

    @property
    def span_ns(self) -> int:
        """Time from first to last sample, without jumps. [ns]"""
        return self.observed_ns + self.gap_ns

    @property
    def coverage(self) -> float:
        """Observed share of the span; NaN before the second sample. [-]"""
        return self.observed_ns / self.span_ns if self.span_ns else float("nan")


def _total(durations: Int) -> int:
    """Sum of durations, each at most ``CLOCK_STEP_NS``, exact. [ns]"""
    if len(durations) and len(durations) * int(durations.max()) > MAX_COUNTER:
        return sum(durations.tolist())
    return int(durations.sum())


class SampleIntervals(Described):
    """The intervals that end at the samples of a block."""

    duration_ns: Annotated[Int, "Shape (N,); 0 where the interval is a gap or a jump. [ns]"]
    energy: Annotated[Float, "Energy of each interval, 0 across gaps, shape (N, R). [J]"]


class HeldEnergies(Block):
    """Rows that have ended, with their integrals."""

    stamp_ns: Annotated[Int, "Where each began, shape (M,). [ns]"]
    phase: Annotated[NDArray[np.uint8], "At that sample, shape (M,)."]
    duration_ns: Annotated[Int, "Integrated time, shape (M,). [ns]"]
    energy: Annotated[Float, "Shape (M, K). [J]"]


class _Open(NamedTuple):
    """The row that has not ended: where it began, its phase, its time so far, its values."""

    stamp_ns: int
    phase: int
    duration_ns: int
    values: Float


class HeldIntegrator:
    """Integrates held rows over the observed time by trapezoids, from where each begins.

    A row is complete once the next one begins, so the cutting of the input makes no difference.

    Attributes:
        open_ns: Where the row began that is not complete, after the first sample. [ns]
    """

    def __init__(self) -> None:
        self._open: _Open | None = None
        self.open_ns = 0

    def step(self, block: PowerBlock, duration_ns: Int) -> HeldEnergies | None:
        """Return what becomes complete with these power samples, if anything.

        Args:
            duration_ns: Observed time up to each sample, shape (N,). [ns]
        """
        held, before = block.deviation, self._open
        starts = held.begins.nonzero()[0]
        if not len(starts):
            if before is not None:
                time = before.duration_ns + int(duration_ns.sum())
                self._open = before._replace(duration_ns=time)
            return None
        passed = np.cumsum(duration_ns)
        upto, last = passed[starts], int(starts[-1])
        stamp, phase = block.stamp_ns[starts], block.phase[starts]
        values = held.values[held.row[starts]]
        self._open = _Open(
            int(stamp[-1]), int(phase[-1]), int(passed[-1] - passed[last]), values[-1]
        )
        self.open_ns, time = self._open.stamp_ns, upto[1:] - upto[:-1]
        if before is not None:
            stamp = np.concatenate([[before.stamp_ns], stamp])
            phase = np.concatenate([np.array([before.phase], dtype=np.uint8), phase])
            time = np.concatenate([[before.duration_ns + upto[0]], time])
            values = np.concatenate([before.values[None], values])
        if len(stamp) == 1:
            return None
        energy = (values[1:] + values[:-1]) * (time * (0.5 * NANOSECOND))[:, None]
        np.clip(energy, -MAX_ENERGY, MAX_ENERGY, out=energy)
        return HeldEnergies(stamp[:-1], phase[:-1], time, energy)

    @property
    def open_energy(self) -> Float | float:
        """Its integral so far, shape (K,). [J]"""
        row = self._open
        return 0.0 if row is None else row.values * (row.duration_ns * NANOSECOND)

    def interrupt(self) -> None:
        """Drop the row that is not complete."""
        self._open, self.open_ns = None, 0


class Registers(ExactSum):
    """The energy registers of one robot: of the cabinet, of each joint, then the deviations.

    Attributes:
        time: Account of observed and missing time.
    """

    def __init__(self, n_joints: int) -> None:
        energies = len(CABINET_REGISTERS) + len(JOINT_REGISTERS) * n_joints
        super().__init__(energies + len(CABINET_DEVIATIONS) + len(JOINT_DEVIATIONS) * n_joints)
        self.n_joints = n_joints
        self.deviations = slice(energies, None)
        self.time = Coverage()
        self._last: tuple[int, int, Float] | None = None  # stamp, segment, powers
        self.held = HeldIntegrator()

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are gaps
    def step(
        self, block: PowerBlock, whole: bool = True
    ) -> tuple[SampleIntervals, HeldEnergies | None]:
        """Integrate a block.

        An interval is a gap if a power at either end is not finite, or if its energy is more than a
        register can take.

        Args:
            whole: Whether all energies are of use, or only that of the first register.

        Returns:
            The intervals, whose energies are in the order of `microjoule`, and the integrals of
            the deviations that became complete.
        """
        stamp, segment = block.stamp_ns, block.segment
        if self._last is None:
            self._last = int(stamp[0]), int(segment[0]), _columns(block[slice(0, 1)])[0]
            self.time.start_ns = int(stamp[0])
        elapsed = differences(stamp, self._last[0])
        same = differences(segment, self._last[1]) == 0
        observed = same & (elapsed >= 0) & (elapsed <= CLOCK_STEP_NS)
        duration = np.where(observed, elapsed, 0) * NANOSECOND
        found = self._compiled(block, duration, whole or self.nearly_full)
        if found is not None:
            energy, last = found
        else:
            columns = _columns(block)
            energy, greatest = interval_energy(columns, self._last[2], duration)
            last = columns[-1].copy()
            if not greatest <= MAX_ENERGY:
                countable = (np.abs(energy) <= MAX_ENERGY).all(axis=1)
                energy[~countable] = 0.0
                observed &= countable
            self.add(energy)
        self.time.take(elapsed, observed)
        self.time.end_ns = int(stamp[-1])
        self._last = self.time.end_ns, int(segment[-1]), last
        intervals = SampleIntervals(np.where(observed, elapsed, 0), energy)
        held = self.held.step(block, intervals.duration_ns)
        if held is not None:
            self.add(held.energy, self.deviations.start)
        return intervals, held

    def _compiled(
        self, block: PowerBlock, duration: Float, all_of_use: bool
    ) -> tuple[Float, Float] | None:
        """Add energies by the kernel, and return them with the last powers; None if it cannot."""
        if kernels.compiled is None or self._last is None:
            return None
        size = self.deviations.start
        whole, rest = np.zeros((2, size), dtype=np.int64)
        energy = np.empty((size if all_of_use else 1, len(block))).T
        before, last = np.ascontiguousarray(np.broadcast_to(self._last[2], size)), np.empty(size)
        cabinet = (block.grid_power, block.brake_power, block.loss_dc, block.loss_grid,
                   block.capacitor_power)  # fmt: skip
        joints = block.rigid_power, block.friction_power, block.drive_loss
        powers = tuple(map(np.ascontiguousarray, cabinet)), tuple(map(np.asfortranarray, joints))
        rooms = last, energy, whole, rest
        if not kernels.compiled.integrate(*powers, before, 0.5 * duration, *rooms):
            return None  # what is not a number or too much becomes a gap
        self.add_counted(whole, rest, energy)
        return energy, last

    def reset(self) -> None:
        """Begin all registers and times at zero, at the newest sample."""
        super().reset()
        self.time = Coverage(start_ns=self.time.end_ns, end_ns=self.time.end_ns)

    def interrupt(self) -> None:
        """Let the time from the last to the next sample be a gap of its own, or a jump."""
        self.time.in_gap = False
        end_ns = self.time.end_ns
        self._last = None if end_ns is None else (end_ns, NO_SEGMENT, np.full(1, np.nan))
        self.held.interrupt()

    @property
    def deviation(self) -> Float:
        """Integrals of the deviations up to the newest sample, shape (K,). [J]"""
        return self.joule[self.deviations] + self.held.open_energy

    def cabinet(self, name: str) -> float:
        """Return a register of the cabinet. [J]"""
        return float(self.joule[CABINET_REGISTERS.index(name)])

    def joints(self, name: str) -> Float:
        """Return a register of every joint, shape (n,). [J]"""
        start = len(CABINET_REGISTERS) + JOINT_REGISTERS.index(name) * self.n_joints
        return self.joule[start : start + self.n_joints]


def _columns(block: PowerBlock) -> Float:
    """Power behind each register, shape (N, R). [W]"""
    grid, n_joints = block.grid_power, block.rigid_power.shape[1]
    first = len(CABINET_REGISTERS)
    last = first + len(JOINT_REGISTERS) * n_joints
    columns = np.empty((len(block), last), order="F")
    columns[:, 0] = np.maximum(grid, 0.0)
    columns[:, 1] = np.maximum(-grid, 0.0)
    columns[:, 2] = block.brake_power
    columns[:, 3] = block.loss_dc
    columns[:, 4] = block.loss_grid
    columns[:, 5] = block.capacitor_power
    positive, negative, rigid, friction, loss = (
        columns[:, first + index * n_joints : first + (index + 1) * n_joints]
        for index in range(len(JOINT_REGISTERS))
    )
    rigid[:], friction[:], loss[:] = block.rigid_power, block.friction_power, block.drive_loss
    shaft = block.shaft_power
    np.maximum(shaft, 0.0, out=positive)
    np.subtract(positive, shaft, out=negative)
    return columns


class ShaftEnergySums(ExactSum):
    """Predicted and measured shaft energy of each joint, over exactly the same intervals.

    An interval counts for a joint if the registers integrate it and the effort is known at both of
    its ends. A joint without effort never makes a gap in the registers, and an unknown effort
    never counts as 0. The sums are in the order of ``SHAFT_REGISTERS``.

    Attributes:
        compared_ns: Time over which each joint was compared, shape (n,). [ns]
        last: Measured power at the last sample, driving and given back, shape (2 n,); NaN for a
            sample without effort. [W]
    """

    def __init__(self, n_joints: int) -> None:
        super().__init__(len(SHAFT_REGISTERS) * n_joints)
        self.n_joints = n_joints
        self.compared_ns: Int = np.zeros(n_joints, dtype=np.int64)
        self.last: Float | float = np.nan

    def reset(self) -> None:
        """Begin at zero."""
        super().reset()
        self.compared_ns[:] = 0

    def joints(self, name: str) -> Float:
        """Return a register of ``SHAFT_REGISTERS``, shape (n,), >= 0; NaN: not compared. [J]"""
        start = SHAFT_REGISTERS.index(name) * self.n_joints
        joule = self.joule[start : start + self.n_joints]
        return np.where(self.compared_ns > 0, joule, np.nan)

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are not covered
    def step(self, block: PowerBlock, intervals: SampleIntervals) -> Float:
        """Integrate a block.

        Returns:
            Measured shaft energy of each interval, shape (N, n), NaN where the effort does
            not cover it and 0 in a gap. [J]
        """
        n_joints, measured = self.n_joints, block.shaft_power_measured
        power = np.empty((len(block) + 1, 2 * n_joints), order="F")
        power[0], positive, negative = self.last, power[1:, :n_joints], power[1:, n_joints:]
        np.maximum(measured, 0.0, out=positive)
        np.subtract(positive, measured, out=negative)
        self.last = power[-1].copy()
        energy = np.empty((len(block), len(SHAFT_REGISTERS) * n_joints), order="F")
        parts = energy[:, : 2 * n_joints]
        np.add(power[1:], power[:-1], out=parts)
        parts *= (intervals.duration_ns * (0.5 * NANOSECOND))[:, None]
        energy[:, 2 * n_joints :] = intervals.energy[:, PREDICTED : PREDICTED + 2 * n_joints]
        total = parts[:, :n_joints] - parts[:, n_joints:]
        if bool((parts < MAX_INTERVAL_ENERGY).all()):
            add_saturating(self.compared_ns, intervals.duration_ns.sum())
        else:
            self._leave_out(energy, total, intervals.duration_ns)
        self.add(energy)
        return total

    def _leave_out(self, energy: Float, total: Float, duration_ns: Int) -> None:
        """Take what is not covered out of the energies, and count the time of the rest."""
        parts = energy.reshape(len(energy), len(SHAFT_REGISTERS), self.n_joints)
        known = np.asarray((parts[:, :2] < MAX_INTERVAL_ENERGY).all(axis=1), dtype=np.bool_)
        parts[:] = np.where(known[:, None, :], parts, 0.0)
        total[:] = np.where(known, total, np.where(duration_ns[:, None] > 0, np.nan, 0.0))
        add_saturating(self.compared_ns, np.where(known, duration_ns[:, None], 0).sum(axis=0))
