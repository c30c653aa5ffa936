"""Where the energy of a robot went: in all, per joint, per phase, and against the meter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.prediction_errors import PowerErrorSums
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, Registers
from robot_energy.blocks import NANOSECOND, MeterLocation, Phase, Quality
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result
from robot_energy.results.model import ModelUsed, model_used
from robot_energy.results.uncertainty import EnergyUncertainty, uncertainty_of

BALANCE_RELATIVE = 1e-9


@dataclass(frozen=True)
class EnergyBreakdown(Result):
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

    grid_import: float
    grid_return: float
    brake: float
    loss_dc: float
    loss_grid: float
    capacitor: float
    rigid: float
    friction: float
    drive_loss: float
    sum_of_parts: float
    balance_residual: float
    balanced: bool

    @property
    def net(self) -> float:
        """Energy from the grid less what was returned. [J]"""
        return self.grid_import - self.grid_return


@dataclass(frozen=True)
class JointEnergy(Result):
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
    shaft_energy_positive: float
    shaft_energy_negative: float
    rigid_energy: float
    friction_energy: float
    drive_loss_energy: float
    drive_input_energy: float
    share_of_grid: Number
    last_motor_temperature_degc: Number


@dataclass(frozen=True)
class MeterComparison(Result):
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
            not. They can hide how well motion is predicted. [W]
        predicted_energy_beyond_constant: Without them. [J]
        measured_energy_beyond_constant: Without them. [J]
        beyond_constant_relative: The error over the measured energy without them. [-]
        power_error_rms: Predicted less measured mean power from reading to reading. [W]
        measured_power_rms: Of the measured power: the error of a prediction of 0 W. [W]
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
    constant_power_at_meter: float
    predicted_energy_beyond_constant: Number
    measured_energy_beyond_constant: Number
    beyond_constant_relative: Number
    power_error_rms: Number = None
    measured_power_rms: Number = None


@dataclass(frozen=True)
class PhaseEnergy(Result):
    """One phase of the motion.

    Attributes:
        time: How long it held. [s]
        grid_import_energy: Drawn from the grid meanwhile. [J]
    """

    time: float
    grid_import_energy: float


@dataclass(frozen=True)
class GridPower(Result):
    """Predicted power at the grid. [W]

    Attributes:
        predicted_peak_grid_power: The highest.
        predicted_mean_grid_power: The mean over the observed time.
    """

    predicted_peak_grid_power: Number
    predicted_mean_grid_power: Number


@dataclass(frozen=True)
class SampleQuality(Result):
    """How good the samples were.

    Attributes:
        samples: All that gave a power.
        counts: Samples with each quality bit that is set somewhere, by its name.
    """

    samples: int
    counts: dict[str, int]


@dataclass(frozen=True)
class EnergyReport(Result):
    """What a replay and a prediction have in common.

    Attributes:
        model: The model used.
        energy: Where the energy went, over the observed time.
        power: Predicted power at the grid.
        phases: Time and energy by phase: ``hold``, ``motion``, ``generating``, ``unknown``.
        joints: Where the energy of each joint went, in model order.
        quality: How good the samples were.
        uncertainty: How sure the predicted energy is.
        problems: What makes the figures doubtful, one sentence each.
        notes: What a reader should know before trusting the figures, one sentence each.
    """

    model: ModelUsed
    energy: EnergyBreakdown
    power: GridPower
    phases: dict[str, PhaseEnergy]
    joints: tuple[JointEnergy, ...]
    quality: SampleQuality
    uncertainty: EnergyUncertainty
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def common_figures(
    account: EnergyAccount, model: RobotModel, temperature_degc: Sequence[float], change: str | None
) -> dict[str, Any]:
    """Return the fields of an `EnergyReport` but for the sentences.

    Args:
        account: Of one robot.
        model: The model used.
        temperature_degc: Of the motors; NaN where unknown, shape (n,). [degC]
        change: What was changed about the model.
    """
    registers = account.registers
    seconds = registers.time.observed_ns * NANOSECOND
    energy = energy_of(registers)
    return {
        "model": model_used(model, change),
        "energy": energy,
        "power": GridPower(account.peak_power, _ratio(energy.net, seconds)),
        "phases": {
            phase.name.lower(): PhaseEnergy(account.phase_time(phase), account.phase_energy(phase))
            for phase in Phase
        },
        "joints": joints_of(registers, model.joint_names, temperature_degc),
        "quality": SampleQuality(
            account.samples,
            {str(Quality(b).name).lower(): account.quality[b] for b in sorted(account.quality)},
        ),
        "uncertainty": uncertainty_of(account, model.joint_names),
    }


def energy_of(registers: Registers) -> EnergyBreakdown:
    """Return where the energy went, and whether the parts sum to what the grid gave.

    Args:
        registers: Energy registers of one robot.
    """
    cabinet = {name: registers.cabinet(name) for name in CABINET_REGISTERS}
    joints = {
        name: math.fsum(registers.joints(name).tolist())
        for name in ("rigid", "friction", "drive_loss")
    }
    losses = ("loss_dc", "loss_grid", "brake", "capacitor")
    parts = (*joints.values(), *(cabinet[name] for name in losses))
    total = math.fsum(parts)
    residual = cabinet["grid_import"] - cabinet["grid_return"] - total
    rounding = (len(CABINET_REGISTERS) + len(JOINT_REGISTERS) * registers.n_joints) / PER_JOULE
    turnover = math.fsum(abs(part) for part in parts)
    return EnergyBreakdown(
        **cabinet,
        **joints,
        sum_of_parts=total,
        balance_residual=residual,
        balanced=abs(residual) <= rounding + BALANCE_RELATIVE * turnover,
    )


def joints_of(
    registers: Registers, names: Sequence[str], temperature_degc: Sequence[float]
) -> tuple[JointEnergy, ...]:
    """Return where each joint's energy went.

    Args:
        registers: Energy registers of one robot.
        names: Of the joints, in their order.
        temperature_degc: Of their motors; NaN where unknown. [degC]
    """
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    parts = ("shaft_positive", "shaft_negative", "rigid", "friction", "drive_loss")
    rows = zip(*(registers.joints(part).tolist() for part in parts), strict=True)
    found: list[JointEnergy] = []
    for name, row, degc in zip(names, rows, temperature_degc, strict=True):
        out, back, rigid, friction, loss = row
        drawn = rigid + friction + loss
        share = drawn / net if net > 0 else None
        found.append(JointEnergy(name, out, back, rigid, friction, loss, drawn, share, degc))
    return tuple(found)


def unbalanced(energy: EnergyBreakdown) -> list[str]:
    """Return a sentence if the parts of the energy do not sum to what the grid gave.

    Args:
        energy: The parts, with what is left of the balance. [J]
    """
    if energy.balanced:
        return []
    return [
        f"the parts of the energy do not sum to the grid: {energy.balance_residual:g} J are left"
    ]


def comparison_of(
    account: EnergyAccount, model: RobotModel, power_error: PowerErrorSums
) -> MeterComparison:
    """Return predicted and measured energy over the same intervals.

    Args:
        account: Of one robot.
        model: Which has the constant losses.
        power_error: Of the same intervals.
    """
    comparison, observed_ns = account.comparison, account.registers.time.observed_ns
    compared_ns = comparison.compared_ns
    seconds = compared_ns * NANOSECOND
    predicted = comparison.predicted_energy if compared_ns else math.nan
    measured = comparison.measured_energy if compared_ns else math.nan
    known = comparison.location is not MeterLocation.UNKNOWN
    constant = model.constant_power(comparison.location)
    beyond = measured - constant * seconds
    return MeterComparison(
        meter_location=comparison.location.name.lower() if known else None,
        compared_ns=compared_ns,
        compared_time=seconds,
        coverage=_ratio(compared_ns, observed_ns),
        predicted_energy_at_meter=predicted,
        measured_energy=measured,
        predicted_minus_measured_energy=predicted - measured,
        predicted_minus_measured_relative=_ratio(predicted - measured, abs(measured)),
        predicted_mean_power_at_meter=_ratio(predicted, seconds),
        measured_mean_power=_ratio(measured, seconds),
        constant_power_at_meter=constant,
        predicted_energy_beyond_constant=predicted - constant * seconds,
        measured_energy_beyond_constant=beyond,
        beyond_constant_relative=_ratio(predicted - measured, abs(beyond)),
        power_error_rms=power_error.rms,
        measured_power_rms=power_error.measured_rms,
    )


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan
