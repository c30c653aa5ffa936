"""Friction, drives, temperatures and supply of the plant.

Presliding friction, temperatures and the DC link have a state. The thermal network of each axis is
motor -> gear and structure -> ambient,
``C_m dT_m/dt = P_m - G_m (T_m - T_g)`` and
``C_g dT_g/dt = P_g + G_m (T_m - T_g) - G_a (T_g - T_ambient)``, solved exactly for heat
that is constant over a step, so that any step length is stable.

In the supply energy above the rectified voltage decides: excess of the drives charges the DC link;
from ``chopper_on_voltage`` down to ``chopper_off_voltage`` the brake resistor takes its power,
that at the middle of the two; while the link is above the rectified voltage the diodes
block and the grid gives nothing. Within one interval the demand is constant and the
switching instants are solved for, so that the interval may be longer than a switching cycle.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float
from robot_energy_rig.config import RigConfig
from robot_energy_rig.profile import HardEffects, PlantProfile


class SupplyFlows(Described):
    """Means over the interval of each sample, shape (N,) each."""

    brake_power: Annotated[Float, ">= 0. [W]"]
    capacitor_power: Annotated[Float, "Into the link, signed. [W]"]
    rectifier_loss: Annotated[Float, ">= 0. [W]"]
    grid_power: Annotated[Float, "Power from the grid. [W]"]
    bus_voltage: Annotated[Float, "At the end of the interval. [V]"]


class Supply:
    """The cabinet; its state is the energy in the DC link and the chopper's switch.

    Args:
        interval: Time that each sample stands for. [s]
    """

    def __init__(self, profile: PlantProfile, config: RigConfig, interval: float) -> None:
        supply = profile.supply
        self._supply = supply
        self._interval = interval
        self._capacitor = config.capacitor
        self._efficiency = supply.rectifier_efficiency if config.rectifier else 1.0
        half = 0.5 * supply.capacitance
        base = supply.rectified_voltage**2
        self._on_energy = half * (supply.chopper_on_voltage**2 - base)
        self._off_energy = half * (supply.chopper_off_voltage**2 - base)
        middle = 0.5 * (supply.chopper_on_voltage + supply.chopper_off_voltage)
        self._brake = middle**2 / supply.brake_resistance
        self._stored = 0.0  # J above the rectified voltage
        self._braking = False

    def step(self, bus_power: Float) -> SupplyFlows:
        """Return the flows that the drives' demand makes.

        Args:
            bus_power: Sum of the drive inputs, shape (N,). [W]
        """
        demand = bus_power + self._supply.loss_dc
        brake = np.zeros_like(demand)
        stored = np.zeros_like(demand)
        start = self._stored
        if not self._capacitor:
            brake = np.maximum(-demand, 0.0)
        elif start > 0 or (demand < 0).any():
            for row, wanted in enumerate(demand.tolist()):
                if wanted < 0 or self._stored > 0:
                    brake[row] = self._advance(wanted) / self._interval
                stored[row] = self._stored
        capacitor = np.diff(stored, prepend=start) / self._interval
        # Rounding leaves some 1e-13 W of nothing where the diodes block.
        drawn = np.maximum(demand + brake + capacitor, 0.0)
        taken = drawn / self._efficiency
        voltage = np.sqrt(
            self._supply.rectified_voltage**2 + 2.0 * stored / self._supply.capacitance
        )
        return SupplyFlows(
            brake_power=brake,
            capacitor_power=capacitor,
            rectifier_loss=taken - drawn,
            grid_power=taken + self._supply.loss_grid,
            bus_voltage=voltage,
        )

    def _advance(self, demand: float) -> float:
        """Follow the link through one interval and return the energy braked. [J]"""
        left, braked = self._interval, 0.0
        while left > 0:
            charge = -demand - (self._brake if self._braking else 0.0)
            if not self._braking and self._stored <= 0 and charge <= 0:
                break
            low, high = (self._off_energy, np.inf) if self._braking else (0.0, self._on_energy)
            bound = high if charge > 0 else low
            time = (bound - self._stored) / charge if charge else np.inf
            reached, time = time <= left, min(time, left)
            self._stored = bound if reached else self._stored + charge * time
            if self._braking:
                braked += self._brake * time
            if reached:
                self._braking = charge > 0
            left -= time
        return braked


class Fan:
    """A fan that switches with the warmest motor."""

    def __init__(self, effects: HardEffects) -> None:
        self._effects = effects
        self._on = False

    def power(self, motor_temperature_degc: Float) -> float:
        """Return what it takes from the grid. [W]

        Args:
            motor_temperature_degc: Shape (n,). [degC]
        """
        effects = self._effects
        limit = effects.fan_off_degc if self._on else effects.fan_on_degc
        self._on = bool(motor_temperature_degc.max() > limit)
        return effects.fan_power * self._on


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
    measured_motor_torque: Annotated[Float, "Current times the name-plate constant. [N m]"]


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
