"""Predicted beside measured shaft energy of each joint, over exactly the same intervals.

The effort of a joint comes with its joint states, so both powers are known at the same
stamps. An interval counts for a joint if the registers integrate it and the effort is
known at both of its ends; predicted and measured are then integrated over the same
intervals, joint by joint. A joint without effort never makes a gap in the registers, and
an unknown effort never counts as 0.
"""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, PowerBlock
from robot_energy.registers import SHAFT_REGISTERS, ExactSum

LARGEST = 1e6  # J in one interval; more is no measurement, and would not fit the sums


class ShaftComparison:
    """Accumulates measured shaft energies and what they are compared with.

    Args:
        n_joints: Number of joints.

    Attributes:
        compared_ns: Time over which each joint was compared, shape (n,). [ns]
    """

    def __init__(self, n_joints: int) -> None:
        self.n_joints = n_joints
        self.compared_ns: Int = np.zeros(n_joints, dtype=np.int64)
        self._sum = ExactSum(len(SHAFT_REGISTERS) * n_joints)
        self._last: Float = np.full((1, len(SHAFT_REGISTERS) * n_joints), np.nan)

    @property
    def microjoule(self) -> Int:
        """All registers as integers, in the order of ``SHAFT_REGISTERS``. [uJ]"""
        return self._sum.microjoule

    @property
    def remainder(self) -> Int:
        """What is left of each register beyond whole microjoules. [2^-40 uJ]"""
        return self._sum.remainder

    def add_sums(self, microjoule: Int, remainder: Int, compared_ns: Int) -> None:
        """Add what was compared before, in the order of `microjoule`.

        Args:
            microjoule: Shape (4 n,). [uJ]
            remainder: Shape (4 n,). [2^-40 uJ]
            compared_ns: Shape (n,). [ns]
        """
        self._sum.add_sums(microjoule, remainder)
        self.compared_ns += compared_ns

    def reset(self) -> None:
        """Begin at zero."""
        self._sum.reset()
        self.compared_ns[:] = 0

    def joints(self, name: str) -> Float:
        """Return a register of every joint by its name in ``SHAFT_REGISTERS``.

        Args:
            name: Of the register; both parts are >= 0 and never fall.

        Returns:
            Shape (n,); NaN where nothing was compared yet. [J]
        """
        start = SHAFT_REGISTERS.index(name) * self.n_joints
        joule = self._sum.joule[start : start + self.n_joints]
        return np.where(self.compared_ns > 0, joule, np.nan)

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are not covered
    def step(self, block: PowerBlock, duration_ns: Int) -> Float | None:
        """Integrate a block.

        Args:
            block: Power samples.
            duration_ns: Of the interval that ends at each sample, 0 for a gap, as the
                registers have it, shape (N,). [ns]

        Returns:
            Measured shaft energy of each interval, shape (N, n), NaN where the effort does
            not cover it and 0 in a gap; None if it covers nothing. [J]
        """
        measured = block.shaft_power_measured
        if bool(np.isnan(measured).all()):
            self._last = np.full_like(self._last, np.nan)
            return None
        power = _columns(measured, block.shaft_power)
        before = np.concatenate([self._last, power[:-1]])
        self._last = power[-1:].copy()
        energy = (power + before) * (duration_ns * (0.5 * NANOSECOND))[:, None]
        parts = energy.reshape(len(block), len(SHAFT_REGISTERS), self.n_joints)
        observed = duration_ns[:, None] > 0
        covered = observed & (parts < LARGEST).all(axis=1)
        parts[:] = np.where(covered[:, None, :], parts, 0.0)
        self._sum.add(energy)
        self.compared_ns += np.where(covered, duration_ns[:, None], 0).sum(axis=0)
        return np.where(covered | ~observed, parts[:, 0] - parts[:, 1], np.nan)


def _columns(measured: Float, predicted: Float) -> Float:
    """Power behind each register, shape (N, R). [W]"""
    return np.concatenate(
        [
            np.maximum(measured, 0.0),
            np.maximum(-measured, 0.0),
            np.maximum(predicted, 0.0),
            np.maximum(-predicted, 0.0),
        ],
        axis=1,
    )
