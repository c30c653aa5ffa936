"""Energies of the powers that a pipeline put out, summed without any rounding."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS
from robot_energy.timeline.blocks import Float, Int, PowerBlock


def exact_sum(values: Float, weights: Int) -> Fraction:
    """Return ``sum values * weights`` without any rounding, values and weights (N,)."""
    mantissa, exponent = np.frexp(values)
    whole = (mantissa * 2.0**53).astype(np.int64)
    total = Fraction(0)
    for power in np.unique(exponent).tolist():
        rows = exponent == power
        product = int(whole[rows].astype(object) @ weights[rows].astype(object))
        total += product * Fraction(2) ** (power - 53)
    return total


class Reference:
    """Exact registers of a recording that repeats itself.

    Args:
        start_ns: Start of the first cycle. [ns]
        length_ns: Length of a cycle. [ns]
        cycle_ns: Stamps of the good samples from the start of a cycle, shape (C,). [ns]
        longest_ns: Longer intervals are gaps. [ns]

    Attributes:
        observed_ns: Time between neighbouring samples that is not a gap. [ns]
        gap_ns: The other time. [ns]
        strange: Samples after the first two cycles whose powers differ from those of the second.
    """

    def __init__(self, start_ns: int, length_ns: int, cycle_ns: Int, longest_ns: int) -> None:
        self._start_ns, self._length_ns, self._longest_ns = start_ns, length_ns, longest_ns
        self._cycle_ns = cycle_ns
        self._duration_ns = np.diff(cycle_ns, prepend=cycle_ns[-1] - length_ns)
        self._second: list[Float] = []
        self._cycle: Float | None = None  # powers of the second cycle, shape (C, R)
        self._times = np.zeros(len(cycle_ns), dtype=np.int64)  # of the interval ending there
        self._apart: list[Fraction] = []  # of the intervals counted one by one [W ns]
        self._last: tuple[Int, Float, NDArray[np.bool_]] | None = None
        self.observed_ns = 0
        self.gap_ns = 0
        self.strange = 0

    def take(self, block: PowerBlock) -> None:
        """Take power samples in time order."""
        stamp, power = block.stamp_ns, _powers(block)
        turn, offset = np.divmod(stamp - self._start_ns, self._length_ns)
        row = np.searchsorted(self._cycle_ns, offset)
        if self._cycle is None:
            same = np.zeros(len(stamp), dtype=np.bool_)
            self._second.append(power[turn == 1])
            if sum(map(len, self._second)) == len(self._cycle_ns):
                self._cycle = np.concatenate(self._second)
        else:
            same = (power == self._cycle[row]).all(axis=1)
            self.strange += int((~same & (turn > 1)).sum())
        if self._last is not None:
            before = self._last
            stamp, power = np.append(before[0], stamp), np.concatenate([before[1], power])
            same, row = np.append(before[2], same), np.append(-1, row)
        self._last = (stamp[-1:], power[-1:], same[-1:])
        elapsed = np.diff(stamp)
        gap = elapsed > self._longest_ns
        self.gap_ns += int(elapsed[gap].sum())
        self.observed_ns += int(elapsed[~gap].sum())
        known = same[1:] & same[:-1]
        np.add.at(self._times, row[1:][known & ~gap], 1)
        rest = ~known & ~gap
        if rest.any():
            self._count(power[:-1][rest], power[1:][rest], elapsed[rest])

    def _count(self, before: Float, after: Float, elapsed: Int) -> None:
        energies = [
            exact_sum(first, elapsed) + exact_sum(last, elapsed)
            for first, last in zip(before.T, after.T, strict=True)
        ]
        before_these = self._apart or [Fraction(0)] * len(energies)
        self._apart = [sum(pair, Fraction(0)) for pair in zip(before_these, energies, strict=True)]

    def microjoule(self) -> list[Fraction]:
        """All registers. [uJ]"""
        doubled = self._apart
        if self._cycle is not None:
            weight = self._times * self._duration_ns
            doubled = [
                apart + exact_sum(power, weight) + exact_sum(np.roll(power, 1), weight)
                for apart, power in zip(doubled, self._cycle.T, strict=True)
            ]
        return [energy / 2000 for energy in doubled]  # half a W ns is 1/2000 uJ


def _powers(block: PowerBlock) -> Float:
    """What each register integrates, in their order, shape (N, R). [W]"""
    grid, shaft = block.grid_power, block.rigid_power + block.friction_power
    columns = {
        "grid_import": grid.clip(min=0),
        "grid_return": -grid.clip(max=0),
        "brake": block.brake_power,
        "loss_dc": block.loss_dc,
        "loss_grid": block.loss_grid,
        "capacitor": block.capacitor_power,
        "shaft_positive": shaft.clip(min=0),
        "shaft_negative": -shaft.clip(max=0),
        "rigid": block.rigid_power,
        "friction": block.friction_power,
        "drive_loss": block.drive_loss,
    }
    return np.column_stack([columns[name] for name in (*CABINET_REGISTERS, *JOINT_REGISTERS)])
