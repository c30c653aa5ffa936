"""What identification found; the fits of `identify` are parts of it as they are."""

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result, Texts
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_identify.auxiliary import LoadsFit
from robot_energy_identify.cabinet.cabinet import CabinetFit
from robot_energy_identify.cabinet.dc_link import LinkFit
from robot_energy_identify.cabinet.supply import SupplyFound
from robot_energy_identify.data.bags import BagFacts
from robot_energy_identify.drives.all_drives import DrivesFound, TotalFound
from robot_energy_identify.drives.drives import DrivesFit
from robot_energy_identify.drives.total_power import TotalFit
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy_identify.friction.friction import FrictionFit
from robot_energy_identify.friction.hold import HoldFit
from robot_energy_identify.friction.laws import MIN_RANGE
from robot_energy_identify.friction.temperature_study import Study
from robot_energy_identify.friction.torque_constants import FallingConstant
from robot_energy_identify.friction_and_thermal import FrictionFound, ThermalFound
from robot_energy_identify.results.dynamics import DynamicsReport, dynamics_report
from robot_energy_identify.run_all import FullIdentification
from robot_energy_identify.stats.cross_validation import EnergyScore
from robot_energy_identify.stats.held_out_energy import HeldOutEnergy
from robot_energy_identify.stats.lag import Delay
from robot_energy_identify.steps import DynamicsFound, Step
from robot_energy_identify.thermal.gear import MIN_RISE, MIN_WINDOWS, WINDOW, GearsFound
from robot_energy_identify.thermal.network import ThermalFit

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
    parts: Annotated[dict[str, dict[str, float]], "Of the deviations, by column and cause."]


class DrivesReport(Result, name="drives"):
    """Electrical power of the drives."""

    torque: Annotated[str, "Where the torque comes from; empty if that was not asked."]
    drives: Annotated[DrivesFit | None, "Fit to the power of each drive; None without such power."]
    delay: Annotated[Delay | None, "Lag of it behind the joint states; None where unknown."]
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


class ThermalReport(Result, name="thermal"):
    """Thermal networks of the motors of a robot."""

    heat: Annotated[
        str, "``losses`` [W], or of a log ``squared_current`` [A^2], with relative capacities."
    ]
    ambient_degc: Annotated[float, "Temperature of the air that was taken. [degC]"]
    axes: Annotated[tuple[ThermalFit, ...], "One per motor that could be identified."]
    refused: Annotated[Texts, "Why the others could not, one sentence each."]
    gears: Annotated[
        GearsFound, "Temperatures of gears by the power meter, where torque gave none."
    ] = field(default_factory=GearsFound)


def thermal_report(found: ThermalFound) -> ThermalReport:
    return ThermalReport("losses", found.ambient_degc, found.fits, found.refused, found.gears)


class LoadStatesReport(Result, name="auxiliary"):
    """Powers of the states of auxiliary loads."""

    fits: Annotated[
        tuple[LoadsFit, ...],
        "One for each load with a meter, one for all behind that of the outlet.",
    ]
    refused: Annotated[Texts, "Why others could not be identified, one sentence each."]


class FrictionReport(Result, name="friction"):
    """Friction over motor temperature."""

    effort: Annotated[str, "What the torque was measured as; ``log``: relative figures of a log."]
    axes: Annotated[tuple[FrictionFit, ...], "One per axis that could be identified."]
    refused: Annotated[Texts, "Why the others could not, one sentence each."]
    gears: Annotated[
        GearsFound, "Temperatures of gears, which the friction of their axes follows."
    ] = field(default_factory=GearsFound)
    hold: Annotated[HoldFit | None, "What motors hold at rest; None if few rests show it."] = None
    apart: Annotated[
        Texts, "Recordings of other friction, or without temperatures, one sentence each."
    ] = ()
    falls: Annotated[
        tuple[FallingConstant, ...], "Torque constants that fall with the motor temperature."
    ] = ()

    @property
    def torque_unit(self) -> str:
        return "A" if self.effort == "log" else "N m"


def friction_report(found: FrictionFound, effort: str) -> FrictionReport:
    return FrictionReport(
        effort, found.fits, found.refused, found.gears, found.hold, found.apart, found.falls
    )


class AxisStudy(Result):
    """Laws of one axis, tested on temperatures that their fits have not seen."""

    name: Annotated[str, "Name of the axis."]
    study: Annotated[Study, "The test."]
    gain: Annotated[Number, "RMS, exponential law over constant; None without it. [-]"]
    shuffles: Annotated[int, "How often the temperatures were shuffled between the runs."]
    median_gain: Annotated[Number, "The same ratio then: its median. [-]"]
    least_gain: Annotated[Number, "Its least value. [-]"]


class FrictionStudyReport(Result, name="friction_study"):
    """Friction at temperatures that were not seen."""

    studies: Annotated[tuple[AxisStudy, ...], "One per axis."]


def axis_study(name: str, study: Study, chance: Sequence[float]) -> AxisStudy:
    """Return a test on unseen temperatures.

    Args:
        chance: Gain with temperatures shuffled between the runs, one per shuffle. [-]
    """
    known = (float(np.median(chance)), float(np.min(chance))) if chance else (None, None)
    return AxisStudy(name, study, exponential_gain(study), len(chance), *known)


def exponential_gain(study: Study) -> float | None:
    """Return the RMS of the exponential law over that of the constant; None without such a law."""
    try:
        return study.row("exponential", "extend").rms / study.row("constant").rms
    except NotIdentifiableError:
        return None


class CabinetReport(Result, name="cabinet"):
    """Constant losses of the cabinet, and energy of the DC link."""

    losses: Annotated[CabinetFit, "Constant losses."]
    meter_delay: MeterDelay
    meter_time_constant: MeterTimeConstant
    link: Annotated[LinkFit | None, "Energy of the DC link; None where it was not determined."]
    link_taken: Annotated[bool, "Whether the model has it."]
    link_reason: Annotated[str, "Why the model does not have it; empty if it has."]
    link_note: Annotated[str, "Where its voltages come from; empty if the model has none."]


def cabinet_report(found: SupplyFound) -> CabinetReport:
    taken = found.link is not None and not found.reason
    return CabinetReport(
        found.cabinet, found.delay, found.low_pass, found.link, taken, found.reason, found.note
    )


StepFound = DynamicsReport | FrictionReport | CabinetFit | DrivesReport | LinkFit | ThermalReport


class StepReport(Result):
    """One step of the whole."""

    subject: Annotated[str, "What it is about."]
    taken: Annotated[bool, "Whether the model has what was found."]
    reason: Annotated[str, "Why it was left out, or not taken; empty otherwise."]
    notes: Annotated[Texts, "What was decided without data, one sentence each."]
    found: Annotated[StepFound | None, "What the recordings show; None if the step was left out."]
    step: Annotated[Step, "The step behind it."] = field(repr=False)


class IdentificationReport(Result, name="identification"):
    """All that was identified, and the test on what was held out."""

    model: Annotated[RobotModel, "As it is written; in JSON its identity."]
    given: Annotated[RobotModel, "The model as it was given; in JSON its identity."]
    recordings: Annotated[tuple[BagFacts, ...], "Bags of the fit."]
    tests: Annotated[tuple[BagFacts, ...], "Bags of the test alone."]
    steps: Annotated[tuple[StepReport, ...], "In the order in which they were done."]
    meter_delay: MeterDelay
    meter_time_constant: MeterTimeConstant
    energy: Annotated[HeldOutEnergy | None, "Energy errors held out; None if there was no test."]
    mean_error: Annotated[dict[str, float], "Mean of its errors at the meter, by stage. [-]"]
    notes: Annotated[Texts, "What does not fit the model as given, one sentence each."] = ()

    def taken(self, subject: str) -> bool:
        """Whether the model has new figures of a subject."""
        return any(step.subject == subject and step.taken for step in self.steps)


def identification_report(
    whole: FullIdentification,
    model: RobotModel,
    recordings: Sequence[BagFacts],
    tests: Sequence[BagFacts],
    test: HeldOutEnergy | None,
    notes: Sequence[str] = (),
) -> IdentificationReport:
    """Return all that was identified.

    Args:
        notes: What does not fit the model as given, one sentence each.
    """
    friction = next((one.found for one in whole.steps if one.subject == "friction"), None)
    found = friction if isinstance(friction, FrictionFound) else FrictionFound((), ())
    return IdentificationReport(
        model=model,
        given=whole.given,
        recordings=tuple(recordings),
        tests=tuple(tests),
        steps=tuple(
            StepReport(step.subject, step.taken, step.reason, step.notes, _found(step), step)
            for step in whole.steps
        ),
        meter_delay=whole.meter_delay,
        meter_time_constant=whole.meter_time_constant,
        energy=test,
        mean_error={stage: test.mean_error(stage) for stage in test.stages}
        if test is not None and test.metered
        else {},
        notes=(
            *notes,
            *found.apart,
            *_without_temperature(found),
            *_at_one_temperature(found),
            *_without_warm_up(model, recordings),
        ),
    )


def _without_temperature(found: FrictionFound) -> list[str]:
    """Name the axes whose friction is a constant because no recording has their temperature."""
    axes = [fit.name for fit in found.fits if np.isnan(fit.range_degc[0])]
    if not axes:
        return []
    return [
        f"no motor temperature of {', '.join(axes)}, so that friction is a constant there, that of "
        "the temperatures at which it was recorded: check these sensors, or name their topic with "
        "--inputs"
    ]


def _at_one_temperature(found: FrictionFound) -> list[str]:
    """Name the axes whose friction is a constant because they were recorded at one temperature."""
    axes = [fit for fit in found.fits if np.ptp(fit.range_degc) < MIN_RANGE]
    if not axes:
        return []
    low, high = axes[0].range_degc
    return [
        f"friction of {', '.join(fit.name for fit in axes)} was recorded at one temperature each "
        f"({axes[0].name} {low:.0f} to {high:.0f} degC), so that it is a constant: other "
        "temperatures count as outside the fitted ones, and change it by 2 to 5 % per kelvin; "
        "record it cold and warm"
    ]


def _without_warm_up(model: RobotModel, recordings: Sequence[BagFacts]) -> list[str]:
    """Ask for a warm-up where the model has no gear and no recording can show one."""
    degc = [(one, one.range_degc) for one in recordings if one.range_degc is not None]
    shown = any(
        one.duration >= MIN_WINDOWS * WINDOW and high - low >= MIN_RISE for one, (low, high) in degc
    )
    if not degc or shown or any(joint.gear is not None for joint in model.joints):
        return []
    return [
        "no recording shows a warm-up: friction sits in the gear, which is colder than the motor "
        "while a robot warms up, so the model reads low then; record half an hour or more of work "
        "from a cold start, with motor temperatures"
    ]


def _found(step: Step) -> StepFound | None:
    match step.found:
        case DynamicsFound() as found:
            return dynamics_report(found.result, found.least_squares, found.consistent, found.given)
        case FrictionFound() as found:
            return friction_report(found, "measured")
        case DrivesFound() as found:
            return drives_report(found)
        case ThermalFound() as found:
            return thermal_report(found)
        case found:
            return found
