"""How often a recorded motion needs more torque than its robot has.

Torque is that of bodies and rotors (paper A, eq. 1), the limit that of the URDF.
"""

from __future__ import annotations

import numpy as np

from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import DOUBTFUL, Float, TorqueBlock

OFTEN = 0.05  # share of the samples; identified friction and peak torques of a sound robot: 0.01


class TorqueLimitWatch:
    """Counts samples whose bodies and rotors need more than the effort limit of the URDF.

    Attributes:
        most: Greatest torque or force over its limit, shape (n,). [-]
    """

    def __init__(self, limits: JointLimits, drivetrain: Drivetrain) -> None:
        self._limits, self._drivetrain = limits, drivetrain
        self._samples = 0
        self._beyond = np.zeros(len(limits.effort), dtype=np.int64)
        self.most: Float = np.zeros(len(limits.effort))

    @property
    def share(self) -> Float:
        """Share of the samples beyond the limit, shape (n,). [-]"""
        return self._beyond / max(self._samples, 1)

    def step(self, block: TorqueBlock) -> None:
        """Take torques; those without a full derivative window do not count."""
        torque = self._drivetrain.joint_torque_from_motor(block.motor_torque_rigid)
        use = np.maximum(torque.max(axis=0), -torque.min(axis=0)) / self._limits.effort
        doubtful = (block.quality & np.uint32(DOUBTFUL)) != 0
        if np.isfinite(use.sum()) and bool((use <= 1.0).all()) and not doubtful.any():
            self._samples += len(torque)  # nearly always: no sample is beyond a limit
            self.most = np.maximum(self.most, use)
            return
        torque = np.abs(torque)
        known = ~doubtful & np.isfinite(torque).all(axis=1)
        shares = torque[known] / self._limits.effort
        self._samples += len(shares)
        self._beyond += (shares > 1.0).sum(axis=0)
        self.most = np.maximum(self.most, shares.max(axis=0, initial=0.0))

    def sentences(self) -> dict[str, str]:
        """Return what each joint needs too often, by its name; empty where none does."""
        names = self._limits.joint_names
        return {
            names[joint]: f"joint '{names[joint]}' needs more than its torque limit in "
            f"{100 * self.share[joint]:.0f} % of the samples, up to {100 * self.most[joint]:.0f} %"
            for joint in np.flatnonzero(self.share > OFTEN)
        }
