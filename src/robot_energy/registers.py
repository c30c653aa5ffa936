"""Energy registers: exact, gap-aware sums of power over time.

Each interval between two finite samples of one segment adds its trapezoid (paper A,
eq. 7). Sums are integers: microjoules, and a remainder in units of 2^-40 microjoule
that is carried. Integer sums do not depend on how the input is cut into blocks, and a
year at 1 kHz loses nothing. Time is counted in ns: ``span = observed + gap``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Float, Int, PowerBlock, differences

PER_JOULE = 1e6  # microjoules
REMAINDER_BITS = 40  # the remainder counts units of 2^-40 microjoule
BLOCK = 1 << 12  # rows whose remainders add up exactly in a float
ROUND_WHOLE = 1.5 * 2.0**52  # adding and subtracting this rounds to an integer,
ROUND_REMAINDER = 1.5 * 2.0 ** (52 - REMAINDER_BITS)  # and this to the remainder's unit

CABINET_REGISTERS = ("grid_import", "grid_return", "brake", "loss_dc", "loss_grid", "capacitor")
JOINT_REGISTERS = ("shaft_positive", "shaft_negative", "rigid", "friction", "drive_loss")


class ExactSum:
    """Sums of energies, exact in integers.

    Args:
        size: How many registers.
    """

    def __init__(self, size: int) -> None:
        self.microjoule: Int = np.zeros(size, dtype=np.int64)
        self._remainder: Int = np.zeros(size, dtype=np.int64)

    def add(self, energy: Float) -> None:
        """Add the energies of intervals.

        Whole microjoules and remainders are rounded to multiples of their units, whose
        sums are exact in floats as well, whatever the order.

        Args:
            energy: Finite, below 2 MJ each, shape (N, size). [J]
        """
        for start in range(0, len(energy), BLOCK):
            rest = energy[start : start + BLOCK] * PER_JOULE
            whole = rest + ROUND_WHOLE
            whole -= ROUND_WHOLE
            rest -= whole
            rest += ROUND_REMAINDER
            rest -= ROUND_REMAINDER
            ones = np.ones(len(rest))
            self.microjoule += (ones @ whole).astype(np.int64)
            self._remainder += (ones @ rest * 2.0**REMAINDER_BITS).astype(np.int64)
            self.microjoule += self._remainder >> REMAINDER_BITS
            self._remainder &= (1 << REMAINDER_BITS) - 1

    @property
    def joule(self) -> Float:
        """The sums, shape (size,). [J]"""
        return self.microjoule / PER_JOULE


@dataclass
class Timekeeping:
    """How much of a recording was integrated, exact in ns.

    Attributes:
        observed_ns: Time between finite samples of one segment. [ns]
        gap_ns: Time between samples that could not be integrated. [ns]
        gap_count: Number of gaps.
        jumps: Number of backward jumps of the stamps; no time passes across one.
        start_ns: First stamp. [ns]
        end_ns: Last stamp. [ns]
    """

    observed_ns: int = 0
    gap_ns: int = 0
    gap_count: int = 0
    jumps: int = 0
    start_ns: int | None = None
    end_ns: int | None = None

    @property
    def span_ns(self) -> int:
        """Time from first to last sample, without backward jumps. [ns]"""
        return self.observed_ns + self.gap_ns

    @property
    def coverage(self) -> float:
        """Observed share of the span; NaN before the second sample. [-]"""
        return self.observed_ns / self.span_ns if self.span_ns else float("nan")


@dataclass(frozen=True)
class Intervals:
    """The intervals that end at the samples of a block.

    Attributes:
        duration_ns: Shape (N,); 0 where the interval is a gap or a jump. [ns]
        energy: Energy of each interval, 0 across gaps, shape (N, R). [J]
    """

    duration_ns: Int
    energy: Float


@dataclass
class Trapezoid:
    """Cuts a stream of power samples into intervals and keeps the time.

    Attributes:
        time: Running account of observed and missing time.
    """

    time: Timekeeping = field(default_factory=Timekeeping)
    _last: tuple[int, int, Float] | None = None
    _in_gap: bool = False

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are gaps
    def step(self, stamp_ns: Int, segment: Int, power: Float) -> Intervals:
        """Take samples and return the intervals that end at them.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            power: Shape (N, R); a sample is finite in all columns or a gap. [W]

        Returns:
            One interval per sample.
        """
        if self._last is None:
            self._last = (int(stamp_ns[0]), int(segment[0]), power[0].copy())
            self.time.start_ns = int(stamp_ns[0])
        elapsed = differences(stamp_ns, self._last[0])
        same = differences(segment, self._last[1]) == 0
        energy = np.empty_like(power)
        np.add(power[1:], power[:-1], out=energy[1:])
        np.add(power[0], self._last[2], out=energy[0])
        observed = same & (elapsed >= 0)
        if not bool(np.isfinite(np.ones(len(energy)) @ energy).all()):
            finite = np.isfinite(energy).all(axis=1)
            energy[~finite] = 0.0
            observed &= finite
        duration_ns = np.where(observed, elapsed, 0)
        energy *= (duration_ns * (0.5 * NANOSECOND))[:, None]
        self._account(elapsed, observed)
        self._last = (int(stamp_ns[-1]), int(segment[-1]), power[-1].copy())
        self.time.end_ns = int(stamp_ns[-1])
        return Intervals(duration_ns, energy)

    def _account(self, elapsed: Int, observed: NDArray[np.bool_]) -> None:
        time = self.time
        backward = elapsed < 0
        missing = ~observed & (elapsed > 0)
        time.observed_ns += int(elapsed[observed].sum())
        time.gap_ns += int(elapsed[missing].sum())
        time.jumps += int(backward.sum())
        begins = missing & ~np.concatenate([[self._in_gap], missing[:-1]])
        time.gap_count += int(begins.sum())
        self._in_gap = bool(missing[-1])


class Registers:
    """The energy registers of one robot.

    Args:
        n_joints: Number of joints.
    """

    def __init__(self, n_joints: int) -> None:
        self.n_joints = n_joints
        self._sum = ExactSum(len(CABINET_REGISTERS) + len(JOINT_REGISTERS) * n_joints)
        self._trapezoid = Trapezoid()

    @property
    def time(self) -> Timekeeping:
        """Account of observed and missing time."""
        return self._trapezoid.time

    @property
    def microjoule(self) -> Int:
        """All registers as integers: cabinet ones, then each joint register. [uJ]"""
        return self._sum.microjoule

    @np.errstate(invalid="ignore")
    def step(self, block: PowerBlock) -> Intervals:
        """Integrate a block.

        Args:
            block: Power samples; NaN samples are gaps.

        Returns:
            The intervals, whose energies are in the order of `microjoule`.
        """
        intervals = self._trapezoid.step(block.stamp_ns, block.segment, _columns(block))
        self._sum.add(intervals.energy)
        return intervals

    def cabinet(self, name: str) -> float:
        """Return a register of the cabinet by its name in ``CABINET_REGISTERS``. [J]"""
        return float(self._sum.joule[CABINET_REGISTERS.index(name)])

    def joints(self, name: str) -> Float:
        """Return a register of every joint by its name in ``JOINT_REGISTERS``, (n,). [J]"""
        start = len(CABINET_REGISTERS) + JOINT_REGISTERS.index(name) * self.n_joints
        return self._sum.joule[start : start + self.n_joints]


def _columns(block: PowerBlock) -> Float:
    """Power behind each register, shape (N, R). [W]"""
    grid, n_joints = block.grid_power, block.rigid_power.shape[1]
    first = len(CABINET_REGISTERS)
    columns = np.empty((len(block), first + len(JOINT_REGISTERS) * n_joints))
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
