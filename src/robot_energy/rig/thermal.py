"""Thermal network of each axis: motor -> gear and structure -> ambient.

``C_m dT_m/dt = P_m - G_m (T_m - T_g)`` and
``C_g dT_g/dt = P_g + G_m (T_m - T_g) - G_a (T_g - T_ambient)``, solved exactly for heat
that is constant over a step, so that any step length is stable.
"""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import RigError
from robot_energy.rig.profile import PlantProfile

MAX_SHARE = 0.1  # of the fastest time constant in one step


def longest_step(profile: PlantProfile) -> float:
    """Return the longest step over which heat and friction may be held. [s]

    Args:
        profile: The plant.
    """
    rate = np.linalg.eigvals(_matrix(profile))
    return MAX_SHARE / float(np.abs(rate).max())


def _matrix(profile: PlantProfile) -> Float:
    """Rates of both nodes of every axis, shape (n, 2, 2). [1/s]"""
    inner, outer = profile.motor_conductance, profile.gear_conductance
    matrix = np.empty((profile.n_joints, 2, 2))
    matrix[:, 0, 0] = -inner / profile.motor_capacity
    matrix[:, 0, 1] = inner / profile.motor_capacity
    matrix[:, 1, 0] = inner / profile.gear_capacity
    matrix[:, 1, 1] = -(inner + outer) / profile.gear_capacity
    return matrix


class ThermalNetwork:
    """Two nodes per axis, stepped at a fixed interval.

    Args:
        profile: Capacities and conductances.
        step: Length of a step in thermal time. [s]
        motor_temperature_degc: At the start, shape (n,). [degC]
        gear_temperature_degc: At the start, shape (n,). [degC]
        ambient_degc: [degC]

    Attributes:
        motor_temperature_degc: Now, shape (n,). [degC]
        gear_temperature_degc: Now, shape (n,). [degC]
        ambient_degc: Now. [degC]

    Raises:
        RigError: If a step is long against the fastest time constant, so that friction
            could not follow.
    """

    def __init__(
        self,
        profile: PlantProfile,
        step: float,
        motor_temperature_degc: Float,
        gear_temperature_degc: Float,
        ambient_degc: float,
    ) -> None:
        self.motor_temperature_degc = motor_temperature_degc.copy()
        self.gear_temperature_degc = gear_temperature_degc.copy()
        self.ambient_degc = ambient_degc
        self._inner, self._outer = profile.motor_conductance, profile.gear_conductance
        if step > longest_step(profile):
            raise RigError(
                f"one step of the temperatures is {step:.3g} s of thermal time",
                f"at most {longest_step(profile):.3g} s, a tenth of the fastest time constant",
                "reduce thermal_speedup",
            )
        rate, shape = np.linalg.eig(_matrix(profile))
        self._transition = (shape * np.exp(rate * step)[:, None, :]) @ np.linalg.inv(shape)

    def step(self, motor_heat: Float, gear_heat: Float) -> None:
        """Advance by one step.

        Args:
            motor_heat: Mean over the step, shape (n,). [W]
            gear_heat: Mean over the step, shape (n,). [W]
        """
        gear = self.ambient_degc + (motor_heat + gear_heat) / self._outer
        motor = gear + motor_heat / self._inner
        above_motor = self.motor_temperature_degc - motor
        above_gear = self.gear_temperature_degc - gear
        now = self._transition
        self.motor_temperature_degc = (
            motor + now[:, 0, 0] * above_motor + (now[:, 0, 1] * above_gear)
        )
        self.gear_temperature_degc = gear + now[:, 1, 0] * above_motor + (now[:, 1, 1] * above_gear)
