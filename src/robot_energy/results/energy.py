"""Where the energy of a robot went: in all, per joint, per phase, and against the meter."""

import math
from collections.abc import Collection, Sequence
from typing import Annotated, Any

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, Registers
from robot_energy.certainty.deviation import Z90, energy_std, energy_variances, names_of
from robot_energy.certainty.prediction_errors import PowerErrorSums
from robot_energy.model import RobotModel
from robot_energy.pipeline.work_sums import WorkSums
from robot_energy.results.base import ModelUsed, Number, Result, Texts, model_used
from robot_energy.timeline.blocks import NANOSECOND, MeterLocation, Phase, Quality, known_part


class PartEnergy(Result):
    """Jobs, cycles or repetitions of one kind: what one part costs."""

    name: Annotated[str, "Of the job or cycle; of the program for its repetitions."]
    count: Annotated[int, "How many."]
    energy: Annotated[float, "Mean energy of one from the grid. [J]"]


class NormalisedEnergy(Result):
    """Energy from the grid over what was done with it."""

    tool_path: Annotated[
        Number, "Path of the frame ``tool0``; None for a robot without it. [m]"
    ]  # fmt: skip
    energy_per_metre: Annotated[Number, "Net energy from the grid over that path. [J/m]"]
    body_work: Annotated[float, "Work that lifted and accelerated the bodies, when it did. [J]"]
    body_work_share: Annotated[
        Number, "That work over the net energy from the grid; bodies give a part back. [-]"
    ]
    parts: Annotated[tuple[PartEnergy, ...], "Energy of one part, by its kind; empty if not known."]


def normalised_energy(
    work: WorkSums, net: float, parts: Sequence[tuple[str, float]] = ()
) -> NormalisedEnergy:
    """Return what the energy comes to per metre, and per part.

    Args:
        net: From the grid, less what was returned. [J]
        parts: Name and energy of each. [J]
    """
    kinds: dict[str, list[float]] = {}
    for name, energy in parts:
        kinds.setdefault(name, []).append(energy)
    return NormalisedEnergy(
        tool_path=work.tool_path,
        energy_per_metre=net / work.tool_path if work.tool_path > 0 else math.nan,
        body_work=work.body_work,
        body_work_share=work.body_work / net if net > 0 else math.nan,
        parts=tuple(
            PartEnergy(name, len(found), math.fsum(found) / len(found))
            for name, found in kinds.items()
        ),
    )


BALANCE_RELATIVE = 1e-9


class EnergyBreakdown(Result):
    """Where the energy went. [J]

    ``grid_import - grid_return`` is the sum of the joints' parts, both constant losses, brake
    and capacitor.
    """

    grid_import: Annotated[float, "Drawn from the grid."]
    grid_return: Annotated[float, "Energy fed back by a regenerative supply."]
    brake: Annotated[float, "Energy into the brake resistor."]
    loss_dc: Annotated[float, "Constant loss on the DC side."]
    loss_grid: Annotated[float, "Loss on the grid side."]
    capacitor: Annotated[Number, "Energy into the DC-link capacitor, signed; None if not modelled."]
    rigid: Annotated[float, "Energy that moves the bodies, all joints."]
    friction: Annotated[float, "Energy lost in friction, all joints."]
    drive_loss: Annotated[
        Number, "Drive input minus shaft energy, all joints; None if not modelled."
    ]
    sum_of_parts: Annotated[float, "Sum of all parts."]
    balance_residual: Annotated[
        float, "What the grid gave minus the sum of the parts; rounding only."
    ]
    balanced: Annotated[bool, "Whether that difference is no more than rounding."]

    @property
    def net(self) -> float:
        """Energy from the grid minus what was returned. [J]"""
        return self.grid_import - self.grid_return


class JointEnergy(Result):
    """Where the energy of one joint went. [J]"""

    name: Annotated[str, "Name of the joint."]
    shaft_energy_positive: Annotated[float, "Shaft energy given by the motor."]
    shaft_energy_negative: Annotated[float, "Shaft energy taken back by the motor, >= 0."]
    rigid_energy: Annotated[float, "Energy that moves the bodies."]
    friction_energy: Annotated[float, "Energy lost in friction."]
    drive_loss_energy: Annotated[Number, "Drive input minus shaft energy; None if not modelled."]
    drive_input_energy: Annotated[float, "Sum of the three."]
    share_of_grid: Annotated[Number, "Share of the energy from the grid. [-]"]
    last_motor_temperature_degc: Annotated[Number, "Newest temperature, or the assumed one. [degC]"]
    last_gear_temperature_degc: Annotated[
        Number,
        "Estimated temperature of the gear, which friction follows; None for a joint whose model "
        "has no gear. [degC]",
    ] = None


class MeterComparison(Result):
    """Predicted and measured over the same intervals; None where nothing was measured."""

    meter_location: Annotated[str | None, "``grid`` or ``dc_bus``."]
    compared_ns: Annotated[int, "Time that meter and prediction cover. [ns]"]
    compared_time: Annotated[float, "The same. [s]"]
    coverage: Annotated[Number, "Compared share of the observed time. [-]"]
    predicted_energy_at_meter: Annotated[Number, "Predicted energy over that time. [J]"]
    measured_energy: Annotated[Number, "Measured energy over that time. [J]"]
    predicted_minus_measured_energy: Annotated[Number, "The error. [J]"]
    predicted_minus_measured_relative: Annotated[Number, "The error over the measured energy. [-]"]
    predicted_mean_power_at_meter: Annotated[Number, "Predicted mean power over that time. [W]"]
    measured_mean_power: Annotated[Number, "Measured mean power over that time. [W]"]
    constant_power_at_meter: Annotated[
        float,
        "Losses of the model that flow whether the robot moves or not. They can hide how well "
        "motion is predicted. [W]",
    ]
    predicted_energy_beyond_constant: Annotated[
        Number, "Predicted energy without these constant losses. [J]"
    ]
    measured_energy_beyond_constant: Annotated[Number, "Measured energy without them. [J]"]
    beyond_constant_relative: Annotated[
        Number, "The error over the measured energy without them. [-]"
    ]
    power_error_rms: Annotated[
        Number, "Predicted minus measured mean power from reading to reading. [W]"
    ] = None
    measured_power_rms: Annotated[
        Number, "Of the measured power: the error of a prediction of 0 W. [W]"
    ] = None
    half_relative: Annotated[
        Number,
        "Half width of the 90 % band of the predicted energy at the meter, over that energy, from "
        "the figures of the model alone, without what the meter showed. [-]",
    ] = None


class PhaseEnergy(Result):
    """One phase of the motion."""

    time: Annotated[float, "Time in the phase. [s]"]
    grid_import_energy: Annotated[float, "Drawn from the grid meanwhile. [J]"]


class GridPower(Result):
    """Predicted power at the grid. [W]"""

    predicted_peak_grid_power: Annotated[Number, "Highest predicted power."]
    predicted_mean_grid_power: Annotated[Number, "Mean predicted power over the observed time."]


class SampleQuality(Result):
    """How good the samples were."""

    samples: Annotated[int, "Number of samples that gave a power."]
    counts: Annotated[
        dict[str, int], "Samples with each quality bit that is set somewhere, by its name."
    ]


class Contribution(Result):
    """What one figure of the model, or several of one kind, add to the uncertainty."""

    name: Annotated[str, "Name of the figures."]
    std: Annotated[float, "Standard deviation of the energy that they alone cause. [J]"]
    share: Annotated[Number, "Share of the variance. [-]"]


class EnergyUncertainty(Result):
    """How sure the predicted net energy from the grid is."""

    std: Annotated[float, "Standard deviation from the figures of the model. [J]"]
    band: Annotated[
        str,
        "``parametric``: from that alone; ``calibrated``: scaled by the errors that a meter "
        "showed in windows of 5 s.",
    ]
    lower: Annotated[float, "Lower end of the 90 % band. [J]"]
    upper: Annotated[float, "Upper end of the 90 % band. [J]"]
    half_relative: Annotated[Number, "Half width over the energy. [-]"]
    readings: Annotated[int, "Number of meter readings that were compared with the band of power."]
    inside: Annotated[Number, "Share of them that lay within it. [-]"]
    inside_parametric: Annotated[
        Number, "The same of a band from the standard deviation alone. [-]"
    ]
    contributions: Annotated[
        tuple[Contribution, ...], "What adds how much, the largest first: what to measure next."
    ]


def uncertainty_of(account: EnergyAccount, joint_names: Sequence[str]) -> EnergyUncertainty:
    registers, calibration, band = account.registers, account.calibration, account.energy_band
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    variances = energy_variances(registers.deviation)
    total = float(variances.sum())
    by_name: dict[str, float] = {}
    for name, variance in zip(names_of(joint_names), variances.tolist(), strict=True):
        by_name[name] = by_name.get(name, 0.0) + variance
    found = [
        Contribution(name, variance**0.5, variance / total if total else None)
        for name, variance in by_name.items()
        if variance > 0
    ]
    count, inside, parametric = calibration.counts.sum(axis=0).tolist()
    return EnergyUncertainty(
        std=band.std,
        band=band.kind.name.lower(),
        lower=net - band.half,
        upper=net + band.half,
        half_relative=band.half / net if net > 0 else None,
        readings=count,
        inside=inside / count if count else None,
        inside_parametric=parametric / count if count else None,
        contributions=tuple(sorted(found, key=lambda one: -one.std)),
    )


class EnergyReport(Result):
    """What a replay and a prediction have in common."""

    model: Annotated[ModelUsed, "The model used."]
    energy: Annotated[EnergyBreakdown, "Where the energy went, over the observed time."]
    power: Annotated[GridPower, "Predicted power at the grid."]
    phases: Annotated[
        dict[str, PhaseEnergy],
        "Time and energy by phase: ``hold``, ``motion``, ``generating``, ``unknown``.",
    ]
    joints: Annotated[
        tuple[JointEnergy, ...], "Where the energy of each joint went, in model order."
    ]
    normalised: Annotated[NormalisedEnergy, "Energy over what was done with it."]
    quality: Annotated[SampleQuality, "How good the samples were."]
    uncertainty: Annotated[EnergyUncertainty, "How sure the predicted energy is."]
    problems: Annotated[Texts, "What makes the figures doubtful, one sentence each."]
    notes: Annotated[
        Texts, "What a reader should know before trusting the figures, one sentence each."
    ]


def common_figures(
    account: EnergyAccount,
    model: RobotModel,
    temperature_degc: Sequence[float],
    change: str | None,
    gear_degc: Sequence[float] | None = None,
) -> dict[str, Any]:
    """Return the fields of an `EnergyReport` but for the sentences.

    Args:
        temperature_degc: Of the motors; NaN where unknown, shape (n,). [degC]
        gear_degc: Of the gears; NaN for a joint without one, shape (n,); None: no gear. [degC]
    """
    registers, counts = account.registers, account.counts
    seconds = registers.time.observed_ns * NANOSECOND
    energy = energy_of(registers, model.unmodelled)
    parts = ("shaft_positive", "shaft_negative", "rigid", "friction", "drive_loss")
    rows = zip(*(registers.joints(part).tolist() for part in parts), strict=True)
    gears = gear_degc or [math.nan] * len(model.joints)
    joints: list[JointEnergy] = []
    for name, row, *degc in zip(model.joint_names, rows, temperature_degc, gears, strict=True):
        out, back, rigid, friction, loss = row
        drawn = rigid + friction + loss
        shown = float(known_part("drive_loss", loss, model.unmodelled))
        share = drawn / energy.net if energy.net > 0 else None
        joints.append(JointEnergy(name, out, back, rigid, friction, shown, drawn, share, *degc))
    return {
        "model": model_used(model, change),
        "energy": energy,
        "power": GridPower(counts.peak_power, _ratio(energy.net, seconds)),
        "phases": {
            phase.name.lower(): PhaseEnergy(account.phase_time(phase), account.phase_energy(phase))
            for phase in Phase
        },
        "joints": tuple(joints),
        "quality": SampleQuality(
            counts.samples,
            {str(Quality(b).name).lower(): counts.quality[b] for b in sorted(counts.quality)},
        ),
        "uncertainty": uncertainty_of(account, model.joint_names),
    }


def energy_of(registers: Registers, unmodelled: Collection[str]) -> EnergyBreakdown:
    """Return where the energy went, and whether the parts sum to what the grid gave."""
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
        **{
            name: float(known_part(name, energy, unmodelled))
            for name, energy in (cabinet | joints).items()
        },
        sum_of_parts=total,
        balance_residual=residual,
        balanced=abs(residual) <= rounding + BALANCE_RELATIVE * turnover,
    )


def unbalanced(energy: EnergyBreakdown) -> list[str]:
    if energy.balanced:
        return []
    return [
        f"the parts of the energy do not sum to the grid: {energy.balance_residual:g} J are left"
    ]


def comparison_of(
    account: EnergyAccount, model: RobotModel, power_error: PowerErrorSums
) -> MeterComparison:
    comparison, observed_ns = account.comparison, account.registers.time.observed_ns
    compared_ns = comparison.compared_ns
    seconds = compared_ns * NANOSECOND
    predicted = comparison.predicted_energy if compared_ns else math.nan
    measured = comparison.measured_energy if compared_ns else math.nan
    known = comparison.location is not MeterLocation.UNKNOWN
    constant = model.constant_power(comparison.location)
    beyond = measured - constant * seconds
    registers, at_bus = account.registers, comparison.location is MeterLocation.DC_BUS
    half = Z90 * energy_std(registers.deviation, at_bus)
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    net -= registers.cabinet("loss_grid") if at_bus else 0.0
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
        half_relative=_ratio(half, abs(net)) if compared_ns else math.nan,
    )


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan
