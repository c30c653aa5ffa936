"""Energies as dataclasses: the figures of a report under documented names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Number = float | None  # None where nothing is known


@dataclass(frozen=True)
class EnergyBreakdown:
    """Where the energy went. [J]

    ``grid_import - grid_return`` is the sum of the joints' parts, both constant losses, brake
    and capacitor.

    Attributes:
        grid_import: Drawn from the grid.
        grid_return: Fed back by a regenerative supply.
        brake: Into the brake resistor.
        loss_dc: Constant loss on the DC side.
        loss_grid: Loss on the grid side.
        capacitor: Into the DC-link capacitor, signed.
        rigid: Moving the bodies, all joints.
        friction: All joints.
        drive_loss: Drive input less shaft energy, all joints.
        sum_of_parts: Of all parts.
        balance_residual: What the grid gave less the sum of the parts; rounding only.
        balanced: Whether it is no more than rounding.
    """

    grid_import: Number
    grid_return: Number
    brake: Number
    loss_dc: Number
    loss_grid: Number
    capacitor: Number
    rigid: Number
    friction: Number
    drive_loss: Number
    sum_of_parts: Number
    balance_residual: Number
    balanced: bool


@dataclass(frozen=True)
class JointEnergy:
    """Where the energy of one joint went. [J]

    Attributes:
        name: Of the joint.
        shaft_energy_positive: Given by the motor.
        shaft_energy_negative: Taken back by the motor, >= 0.
        rigid_energy: Moving the bodies.
        friction_energy: Lost in friction.
        drive_loss_energy: Drive input less shaft energy.
        drive_input_energy: Sum of the three.
        share_of_grid: Of the energy from the grid. [-]
        last_motor_temperature_degc: Newest temperature, or the assumed one. [degC]
    """

    name: str
    shaft_energy_positive: Number
    shaft_energy_negative: Number
    rigid_energy: Number
    friction_energy: Number
    drive_loss_energy: Number
    drive_input_energy: Number
    share_of_grid: Number
    last_motor_temperature_degc: Number


@dataclass(frozen=True)
class MeterComparison:
    """Predicted and measured over the same intervals; None where nothing was measured.

    Attributes:
        meter_location: ``grid`` or ``dc_bus``.
        compared_ns: Time that both cover. [ns]
        compared_time: The same. [s]
        coverage: Compared share of the observed time. [-]
        predicted_energy_at_meter: Over that time. [J]
        measured_energy: Over that time. [J]
        predicted_minus_measured_energy: The error. [J]
        predicted_minus_measured_relative: The error over the measured energy. [-]
        predicted_mean_power_at_meter: Over that time. [W]
        measured_mean_power: Over that time. [W]
        constant_power_at_meter: Losses of the model that flow whether the robot moves or
            not. [W]
        predicted_energy_beyond_constant: Without them. [J]
        measured_energy_beyond_constant: Without them. [J]
        beyond_constant_relative: The error over the measured energy without them. [-]
    """

    meter_location: str | None
    compared_ns: int
    compared_time: float
    coverage: Number
    predicted_energy_at_meter: Number
    measured_energy: Number
    predicted_minus_measured_energy: Number
    predicted_minus_measured_relative: Number
    predicted_mean_power_at_meter: Number
    measured_mean_power: Number
    constant_power_at_meter: Number
    predicted_energy_beyond_constant: Number
    measured_energy_beyond_constant: Number
    beyond_constant_relative: Number


@dataclass(frozen=True)
class PhaseEnergy:
    """One phase of the motion.

    Attributes:
        time: How long it held. [s]
        grid_import_energy: Drawn from the grid meanwhile. [J]
    """

    time: Number
    grid_import_energy: Number


def energy_of(summary: Mapping[str, Any]) -> EnergyBreakdown:
    """Return the breakdown of a summary."""
    return EnergyBreakdown(**summary["energy"])


def joints_of(summary: Mapping[str, Any]) -> tuple[JointEnergy, ...]:
    """Return the joints of a summary, in model order."""
    return tuple(JointEnergy(**entry) for entry in summary["joints"])


def phases_of(summary: Mapping[str, Any]) -> dict[str, PhaseEnergy]:
    """Return the phases of a summary by name."""
    return {name: PhaseEnergy(**entry) for name, entry in summary["phases"].items()}
