"""Electrical power of the drives, identified from their own power or from one meter."""

from collections.abc import Sequence
from typing import Annotated

from robot_energy.results.base import Number, Result, Texts
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_identify.drives.all_drives import DrivesFound, TotalFound
from robot_energy_identify.drives.drives import DrivesFit
from robot_energy_identify.drives.total_power import TotalFit
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy_identify.stats.cross_validation import EnergyScore
from robot_energy_identify.stats.lag import Delay

MeterDelay = Annotated[
    Delay | None, "Lag of the meter behind the joint states; None where it cannot be determined."
]
MeterTimeConstant = Annotated[
    Delay | None, "Time constant of a low pass in the meter; None where it cannot be determined."
]


class LossTerm(Result):
    """One coefficient of the loss model."""

    value: Annotated[float, "In the unit of its term."]
    std: Annotated[Number, "Standard deviation; None where it is not determined."]
    at_bound: Annotated[bool, "Whether the value came out negative and stays at 0."]


class AxisLosses(Result):
    """Losses of one drive behind one meter for all."""

    name: Annotated[str, "Name of the joint."]
    copper: Annotated[LossTerm, "Loss over squared motor torque. [W/(N m)^2]"]
    linear: Annotated[LossTerm, "Loss over motor speed. [W s/rad]"]
    quadratic: Annotated[LossTerm, "Loss over squared motor speed. [W s^2/rad^2]"]


class TotalPower(Result):
    """Losses of all drives, from one meter."""

    location: Annotated[MeterLocation, "Where the meter sits."]
    readings: Annotated[int, "Number of readings of the meter."]
    duration: Annotated[float, "Time that they cover. [s]"]
    recordings: Annotated[int, "Number of recordings that they come from."]
    structure: Annotated[str, "What the readings distinguish."]
    constant: Annotated[float, "Constant power. [W]"]
    constant_std: Annotated[Number, "[W]"]
    axes: Annotated[tuple[AxisLosses, ...], "One per joint."]
    block_rms: Annotated[dict[str, float], "RMS error on blocks not seen, by structure. [W]"]
    held_out: Annotated[str, "``recordings`` or ``blocks``."]
    ways: Annotated[dict[str, EnergyScore], "Predictions of held-out readings, by way."]
    meter_delay: MeterDelay
    meter_time_constant: MeterTimeConstant
    notes: Annotated[Texts, "What the readings do not determine, one sentence each."]
    parts: Annotated[
        dict[str, dict[str, float]], "Of the standard deviations, by column of the fit and cause."
    ]


class DrivesReport(Result, name="drives"):
    """Electrical power of the drives."""

    torque: Annotated[str, "Where the torque comes from; empty if that was not asked."]
    drives: Annotated[DrivesFit | None, "Fit to the power of each drive; None without such power."]
    delay: Annotated[
        Delay | None,
        "Lag of that power behind the joint states; None where it cannot be determined.",
    ]
    total: Annotated[TotalPower | None, "Fit to one meter for all drives; None without a meter."]
    notes: Annotated[Texts, "What was decided for the model file without data, one sentence each."]


def drives_report(found: DrivesFound, torque: str = "", notes: Sequence[str] = ()) -> DrivesReport:
    """Return all that was found of the drives.

    Args:
        found: From the power of each drive, from one meter, or both.
        notes: What was decided for the model file without data, one sentence each.
    """
    total = None if found.total is None else total_power(found.total)
    return DrivesReport(torque, found.drives, found.delay, total, tuple(notes))


def total_power(found: TotalFound) -> TotalPower:
    """Return what was found from one meter for all drives."""
    data, fit = found.data, found.fit
    return TotalPower(
        location=data.location,
        readings=len(data),
        duration=float(data.duration.sum()),
        recordings=len(set(data.recording.tolist())),
        structure=fit.structure,
        constant=fit.constant,
        constant_std=fit.constant_std,
        axes=tuple(
            AxisLosses(name, *(_term(data, fit, joint, row) for row in range(len(COEFFICIENTS))))
            for joint, name in enumerate(data.names)
        ),
        block_rms={str(name): rms for name, rms in fit.errors.items()},
        held_out=found.held_out,
        ways=found.scores,
        meter_delay=found.delay,
        meter_time_constant=found.low_pass,
        notes=tuple(_not_determined(fit)),
        parts=fit.losses.parts,
    )


def _term(data: Sums, fit: TotalFit, joint: int, row: int) -> LossTerm:
    names = {f"{COEFFICIENTS[row]} of {which}" for which in (data.names[joint], "all axes")}
    return LossTerm(
        float(fit.coefficients[row, joint]),
        float(fit.deviations[row, joint]),
        bool(names & set(fit.losses.negative)),
    )


def _not_determined(fit: TotalFit) -> list[str]:
    negative, undetermined = fit.losses.negative, fit.losses.undetermined
    notes: list[str] = []
    if undetermined:
        notes.append(f"not distinguished from those before, taken as 0: {', '.join(undetermined)}")
    if negative:
        notes.append(f"at the bound 0, negative otherwise: {', '.join(negative)}")
    if fit.structure in ("shared", "axis_copper"):
        notes.append("what axes share cannot be distinguished per axis from one meter here")
    return notes
