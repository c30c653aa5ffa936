"""Predicted and measured shaft energy of each joint, over exactly the same intervals.

The effort of a joint comes with its joint states, so both powers are known at the same
stamps. An interval counts for a joint if the registers integrate it and the effort is
known at both of its ends; predicted and measured are then integrated over the same
intervals, joint by joint. A joint without effort never makes a gap in the registers, and
an unknown effort never counts as 0.
"""

from __future__ import annotations

import numpy as np

from robot_energy.accounting.exact_sum import ExactSum, add_saturating
from robot_energy.accounting.integration import SampleIntervals
from robot_energy.accounting.registers import CABINET_REGISTERS, SHAFT_REGISTERS
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, PowerBlock

PREDICTED = len(CABINET_REGISTERS)  # column of the first predicted shaft energy in an interval
MAX_INTERVAL_ENERGY = 1e6  # J in one interval; more is no measurement, does not fit the sums


class ShaftEnergySums(ExactSum):
    """Accumulates measured shaft energies and what they are compared with.

    The sums are in the order of ``SHAFT_REGISTERS``.

    Attributes:
        compared_ns: Time over which each joint was compared, shape (n,). [ns]
    """

    def __init__(self, n_joints: int) -> None:
        super().__init__(len(SHAFT_REGISTERS) * n_joints)
        self.n_joints = n_joints
        self.compared_ns: Int = np.zeros(n_joints, dtype=np.int64)
        self._last: Float = np.full(2 * n_joints, np.nan)

    def reset(self) -> None:
        """Begin at zero."""
        super().reset()
        self.compared_ns[:] = 0

    def joints(self, name: str) -> Float:
        """Return a register of every joint by its name in ``SHAFT_REGISTERS``.

        Args:
            name: Of the register; both parts are >= 0 and never fall.

        Returns:
            Shape (n,); NaN where nothing was compared yet. [J]
        """
        start = SHAFT_REGISTERS.index(name) * self.n_joints
        joule = self.joule[start : start + self.n_joints]
        return np.where(self.compared_ns > 0, joule, np.nan)

    def leave_out(self) -> None:
        """Note that a block has no effort at all."""
        self._last = np.full_like(self._last, np.nan)

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are not covered
    def step(self, block: PowerBlock, intervals: SampleIntervals) -> Float:
        """Integrate a block.

        Returns:
            Measured shaft energy of each interval, shape (N, n), NaN where the effort does
            not cover it and 0 in a gap. [J]
        """
        n_joints, measured = self.n_joints, block.shaft_power_measured
        power = np.empty((len(block) + 1, 2 * n_joints), order="F")
        power[0], positive, negative = self._last, power[1:, :n_joints], power[1:, n_joints:]
        np.maximum(measured, 0.0, out=positive)
        np.subtract(positive, measured, out=negative)
        self._last = power[-1].copy()
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
