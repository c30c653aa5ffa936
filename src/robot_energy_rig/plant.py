"""Friction, drives and temperatures of the plant.

Only presliding friction and temperatures have a state. The thermal network of each axis is motor
-> gear and structure -> ambient,
``C_m dT_m/dt = P_m - G_m (T_m - T_g)`` and
``C_g dT_g/dt = P_g + G_m (T_m - T_g) - G_a (T_g - T_ambient)``, solved exactly for heat
that is constant over a step, so that any step length is stable.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RigError
from robot_energy.timeline.blocks import Float
from robot_energy_rig.config import RigConfig
from robot_energy_rig.profile import PlantProfile

REFERENCE_DEGC = 20.0  # of resistances and torque constants
OIL_DEGC = 60.0  # of the oil while its temperature is switched off
COULOMB_DEGC = 40.0  # of the gear, at which the Coulomb friction of the profile holds
SMALLEST = 1e-12  # N m, of a Coulomb torque
MAX_SHARE = 0.1  # of the fastest thermal time constant in one step
CREEP_TIME = 0.4  # s in which friction at rest takes over what it carries
MIN_COULOMB_SHARE = 0.4  # of it, however warm the gear is


class DriveFlows(Described):
    """What the drives do, shape (N, n) each."""

    iron_loss: Annotated[Float, ">= 0. [W]"]
    copper_loss: Annotated[Float, ">= 0. [W]"]
    inverter_loss: Annotated[Float, ">= 0. [W]"]
    measured_motor_torque: Annotated[
        Float, "Current times the torque constant on the name plate. [N m]"
    ]


class PlantFriction:
    """Coulomb, load, Stribeck and lubricant friction, motor side.

    With presliding the sign of the velocity in the Coulomb term is the state ``z`` of Dahl's
    model, ``dz/dx = (sgn(w) - z) / presliding_angle`` over the motor angle x, solved exactly
    for a speed that is constant over a sample.

    Args:
        period: Between samples. [s]

    Attributes:
        wear: Factor on all friction of each axis, shape (n,). [-]
    """

    def __init__(self, profile: PlantProfile, config: RigConfig, period: float) -> None:
        self._profile = profile
        self.wear: Float = np.ones(profile.n_joints)
        hard = profile.hard
        self._fall = hard.coulomb_fall * config.coulomb_temperature
        self._exponent = hard.viscous_exponent if config.viscous_exponent else 1.0
        self._slides = period / hard.presliding_angle if config.presliding else None
        self._creeps = -np.expm1(-period / CREEP_TIME) if config.creep else 0.0
        self._sign: Float = np.zeros(profile.n_joints)
        self._load = profile.load_coulomb * config.load_friction
        self._stribeck = profile.stribeck * config.stribeck
        self._follows_oil = config.lubricant_temperature

    def viscous(self, gear_temperature_degc: Float) -> Float:
        """Return the viscous coefficient, motor side, shape (n,). [N m s/rad]

        Args:
            gear_temperature_degc: Temperature of the oil, shape (n,). [degC]
        """
        factor = [
            float(oil.friction_factor(degc if self._follows_oil else OIL_DEGC))
            for oil, degc in zip(self._profile.lubricant, gear_temperature_degc, strict=True)
        ]
        return self._profile.viscous_40 * np.asarray(factor)

    def torque(
        self, motor_velocity: Float, motor_torque_rigid: Float, gear_temperature_degc: Float
    ) -> Float:
        """Return what the drive must add against friction, motor side, shape (N, n). [N m]

        Without presliding there is none at standstill.

        Args:
            motor_velocity: Shape (N, n). [rad/s]
            motor_torque_rigid: The load, shape (N, n). [N m]
            gear_temperature_degc: Shape (n,). [degC]
        """
        speed = np.abs(motor_velocity)
        dry = self._profile.coulomb + self._load * np.abs(motor_torque_rigid)
        if self._stribeck.any():
            dry = dry + self._stribeck * np.exp(-((speed / self._profile.stribeck_velocity) ** 2))
        if self._fall:
            colder = 1.0 - self._fall * (gear_temperature_degc - COULOMB_DEGC)
            dry = dry * np.maximum(colder, MIN_COULOMB_SHARE)
        if self._exponent < 1.0:
            reference = self._profile.hard.viscous_speed
            turning = np.sign(motor_velocity) * reference * (speed / reference) ** self._exponent
        else:
            turning = motor_velocity
        viscous = self.viscous(gear_temperature_degc) * turning
        carried = -np.clip(motor_torque_rigid / np.maximum(dry, SMALLEST), -1.0, 1.0)
        return (self._direction(motor_velocity, carried) * dry + viscous) * self.wear

    def _direction(self, motor_velocity: Float, carried: Float) -> Float:
        """Return the sign of the velocity, or what presliding makes of it, shape (N, n).

        At rest it creeps towards ``carried``, the share of the Coulomb torque that holds the load.
        """
        sign = np.sign(motor_velocity)
        if self._slides is None:
            return sign
        kept = np.exp(-np.abs(motor_velocity) * self._slides)
        state = self._sign
        for row in range(len(sign)):
            if self._creeps:
                state = state + (carried[row] - state) * self._creeps * (sign[row] == 0.0)
            state = sign[row] + (state - sign[row]) * kept[row]
            sign[row] = state
        self._sign = state
        return sign


class PlantDrives:
    """Motors and inverters."""

    def __init__(self, profile: PlantProfile, config: RigConfig) -> None:
        self._constant = profile.torque_constant
        self._fall = profile.torque_constant_fall * config.demagnetisation
        self._resistance = profile.resistance * config.copper
        self._rise = profile.resistance_rise * config.copper_temperature
        self._hysteresis = profile.hysteresis_torque * config.iron
        self._eddy = profile.eddy_viscous * config.iron
        self._linear = profile.inverter_linear * config.inverter
        self._square = profile.inverter_square * config.inverter

    def flows(
        self, motor_velocity: Float, motor_torque: Float, motor_temperature_degc: Float
    ) -> DriveFlows:
        """Return losses and the reported torque.

        Args:
            motor_velocity: Shape (N, n). [rad/s]
            motor_torque: At the shaft, shape (N, n). [N m]
            motor_temperature_degc: Winding and magnets, shape (n,). [degC]
        """
        warmer = motor_temperature_degc - REFERENCE_DEGC
        drag = self._hysteresis * np.sign(motor_velocity) + self._eddy * motor_velocity
        constant = self._constant * (1.0 - self._fall * warmer)
        current = (motor_torque + drag) / constant
        magnitude, square = np.abs(current), current * current
        resistance = self._resistance * (1.0 + self._rise * warmer)
        return DriveFlows(
            iron_loss=drag * motor_velocity,
            copper_loss=3.0 * resistance * square,
            inverter_loss=self._linear * magnitude + self._square * square,
            measured_motor_torque=current * self._constant,
        )


def longest_step(profile: PlantProfile) -> float:
    """Return the longest step over which heat and friction may be held. [s]"""
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
        step: Length of a step in thermal time. [s]
        motor_temperature_degc: At the start, shape (n,). [degC]
        gear_temperature_degc: At the start, shape (n,). [degC]
        ambient_degc: [degC]

    Attributes:
        motor_temperature_degc: Now, shape (n,). [degC]
        gear_temperature_degc: Now, shape (n,). [degC]
        ambient_degc: Now. [degC]
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
