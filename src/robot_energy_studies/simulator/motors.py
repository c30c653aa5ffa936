"""Motors and inverters: torque to current, and what they turn into heat.

Iron is Bertotti's three parts, power by speed w (sinusoidal flux of constant size):
``hysteresis w + eddy w^2 + excess w^1.5``, the first growing with the square of the current. It
brakes the shaft: the shaft has the torque of the current less iron loss over speed. The torque
constant falls with the temperature of the magnets and with the current. An inverter loses
``a i + b i^2`` by conduction and ``c i V`` by switching.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.timeline.blocks import Float

REFERENCE_DEGC = 20.0
COPPER = 0.00393  # 1/K
STILL = 0.5  # rad/s, below which hysteresis does not brake fully


@dataclass(frozen=True)
class Motors:
    """Figures of all motors and inverters, shape (n,) each."""

    plate_constant: Float  # torque constant on the name plate [N m/A]
    torque_constant: Float  # true one at 20 degC and no current [N m/A]
    magnet_fall: Float  # share of it lost per kelvin [1/K]
    saturation: Float  # share of it lost at rated current; grows with the square [-]
    rated_current: Float  # [A]
    resistance: Float  # of a phase at 20 degC [ohm]
    skin: Float  # rise of the resistance at rated speed; grows with the square [-]
    hysteresis: Float  # torque [N m]
    hysteresis_rise: Float  # its rise at rated torque; grows with the square [-]
    eddy: Float  # [N m s/rad]
    excess: Float  # [N m (s/rad)^0.5]
    standby: Float  # of an inverter that is on [W]
    conduction_linear: Float  # [W/A]
    conduction_square: Float  # [W/A^2]
    switching: Float  # [W/(A V)]
    rated_torque: Float  # [N m]
    rated_speed: Float  # [rad/s]

    def drag(self, motor_velocity: Float, air_gap_torque: Float) -> Float:
        """Return by how much iron brakes the shaft, same shape. [N m]

        Args:
            motor_velocity: Shape (..., n). [rad/s]
            air_gap_torque: Of the current, shape (..., n). [N m]
        """
        speed = np.abs(motor_velocity)
        load = 1.0 + self.hysteresis_rise * (air_gap_torque / self.rated_torque) ** 2
        still = (self.hysteresis * load + self.excess * np.sqrt(speed)) * np.tanh(
            motor_velocity / STILL
        )
        return still + self.eddy * motor_velocity

    def current(self, air_gap_torque: Float, magnet_degc: Float) -> Float:
        """Return the phase current (rms) with the sign of the torque, same shape. [A]

        Args:
            air_gap_torque: Shape (..., n). [N m]
            magnet_degc: Shape (..., n). [degC]
        """
        warm = 1.0 - self.magnet_fall * (magnet_degc - REFERENCE_DEGC)
        linear = air_gap_torque / (self.torque_constant * warm)
        return linear * (1.0 + self.saturation * (linear / self.rated_current) ** 2)

    def copper_loss(self, current: Float, motor_velocity: Float, winding_degc: Float) -> Float:
        """Return the heat of the windings, same shape. [W]

        Args:
            current: Shape (..., n). [A]
            motor_velocity: Shape (..., n). [rad/s]
            winding_degc: Shape (..., n). [degC]
        """
        warm = 1.0 + COPPER * (winding_degc - REFERENCE_DEGC)
        skin = 1.0 + self.skin * (motor_velocity / self.rated_speed) ** 2
        return 3.0 * self.resistance * warm * skin * current**2

    def conduction_loss(self, current: Float) -> Float:
        """Return the loss of the inverters without switching, same shape. [W]

        Args:
            current: Shape (..., n). [A]
        """
        size = np.abs(current)
        return self.standby + self.conduction_linear * size + self.conduction_square * size**2
