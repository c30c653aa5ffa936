"""Torque constants of warm motors: ``k(T) = k (1 - beta (T - 20))``, as warm magnets are weaker.

A torque that is known by its current, which is multiplied by k, is read too high by one over what
is left of k. As much higher is the torque that heats the windings. T is the motor temperature.

Source: reversible temperature coefficients of the remanence of magnets, NdFeB -0.09 to -0.12 %/K,
SmCo -0.03 to -0.05 %/K, ferrite -0.2 %/K (data sheets).
"""

from __future__ import annotations

import numpy as np

from robot_energy.model.schema import RobotModel
from robot_energy.physics.equations import REFERENCE_DEGC
from robot_energy.timeline.blocks import Float


class TorqueConstants:
    """What warm motors have left of their torque constants.

    Args:
        fall: beta, shape (n,). [1/K]
        fallback_degc: Of motors whose temperature is not known. [degC]
    """

    def __init__(self, fall: Float, fallback_degc: float) -> None:
        self._fall, self._fallback_degc = fall, fallback_degc

    @classmethod
    def of(cls, model: RobotModel) -> TorqueConstants | None:
        """Return those of a robot; None where no torque constant falls."""
        entries = [joint.torque_constant_fall for joint in model.joints]
        if not any(entries):
            return None
        fall = np.array([0.0 if entry is None else entry.value for entry in entries])
        return cls(fall, model.temperature.fallback_degc)

    def of_joint(self, joint: int) -> TorqueConstants:
        """Return that of one motor."""
        return TorqueConstants(self._fall[joint : joint + 1], self._fallback_degc)

    def left(self, motor_temperature_degc: Float) -> Float:
        """Return the share that is left. [-]

        Args:
            motor_temperature_degc: NaN where unknown, shape (N, n). [degC]
        """
        unknown = np.isnan(motor_temperature_degc)
        degc = np.where(unknown, self._fallback_degc, motor_temperature_degc)
        return 1.0 - self._fall * (degc - REFERENCE_DEGC)
