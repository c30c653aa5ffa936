"""Rectifier, DC link, brake chopper and fan of the plant.

Energy above the rectified voltage decides: excess of the drives charges the link; from
``chopper_on_voltage`` down to ``chopper_off_voltage`` the brake resistor takes its power,
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
            if charge > 0:
                bound = float("inf") if self._braking else self._on_energy
            elif charge < 0:
                bound = self._off_energy if self._braking else 0.0
            else:
                bound = float("inf")
            time = (bound - self._stored) / charge if charge else float("inf")
            reached = time <= left
            if reached:
                self._stored = bound
            else:
                time = left
                self._stored += charge * time
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
