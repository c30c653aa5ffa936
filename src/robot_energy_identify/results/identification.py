"""What identification found; the fits of `identify` are parts of it as they are."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result, Texts, known
from robot_energy_identify.auxiliary import LoadsFit
from robot_energy_identify.data.bags import BagFacts
from robot_energy_identify.excitation.excitation import (
    Excitation,
    ExcitationScore,
    ExcitationSettings,
)
from robot_energy_identify.excitation.limits import Floor
from robot_energy_identify.friction.laws import MIN_RANGE
from robot_energy_identify.friction.temperature_study import Study
from robot_energy_identify.friction_and_thermal import FrictionReport
from robot_energy_identify.run_all import FullIdentification
from robot_energy_identify.stats.held_out_energy import HeldOutEnergy
from robot_energy_identify.stats.lag import MeterDelay, MeterTimeConstant
from robot_energy_identify.steps import Step
from robot_energy_identify.thermal.gear import MIN_RISE, MIN_WINDOWS, WINDOW

KINDS = ("position", "velocity", "acceleration", "torque")


class ExcitedJoint(Result):
    """One joint of the motion."""

    name: Annotated[str, "Name of the joint."]
    start: Annotated[float, "Position at the start. [rad] or [m]"]
    use: Annotated[dict[str, Number], "Share of each limit, by kind; None without a limit. [-]"]


class ExcitationReport(Result, name="excitation"):
    """A motion for the identification of the dynamics."""

    settings: Annotated[ExcitationSettings, "Settings of the search."]
    before: Annotated[ExcitationScore, "How well the best random start does."]
    after: Annotated[ExcitationScore, "How well the optimised motion does."]
    base_parameters: Annotated[
        dict[str, str], "All that a motion can determine: sum of each group by its name."
    ]
    without_effect: Annotated[Texts, "Parameters that no torque depends on."]
    margin: Annotated[float, "Share of every limit that was allowed. [-]"]
    acceleration_assumed: Annotated[bool, "Whether the limits of the acceleration were not given."]
    joints: Annotated[tuple[ExcitedJoint, ...], "In model order."]
    floor: Annotated[Floor | None, "Height that a link keeps; None without one."]
    least_height: Annotated[Number, "Least height that the link reaches; None without a floor. [m]"]


def excitation_report(found: Excitation) -> ExcitationReport:
    limits = found.limits
    start = found.motion.sample(np.zeros(1)).joint_position[0].tolist()
    use = {kind: found.use[kind] * limits.margin for kind in KINDS}
    use["torque"] = np.where(np.isfinite(limits.torque), use["torque"], np.nan)
    return ExcitationReport(
        settings=found.settings,
        before=found.start,
        after=found.quality,
        base_parameters={
            name: found.base.expression(place) for place, name in enumerate(found.base.labels)
        },
        without_effect=found.base.without_effect,
        margin=limits.margin,
        acceleration_assumed=limits.acceleration_assumed,
        joints=tuple(
            ExcitedJoint(name, start[joint], {kind: known(use[kind][joint]) for kind in KINDS})
            for joint, name in enumerate(limits.robot.joint_names)
        ),
        floor=limits.floor,
        least_height=found.height,
    )


class LoadStatesReport(Result, name="auxiliary"):
    """Powers of the states of auxiliary loads."""

    fits: Annotated[
        tuple[LoadsFit, ...],
        "One for each load with a meter, one for all behind that of the outlet.",
    ]
    refused: Annotated[Texts, "Why others could not be identified, one sentence each."]


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


class IdentificationReport(Result, name="identification"):
    """All that was identified, and the test on what was held out."""

    model: Annotated[RobotModel, "As it is written; in JSON its identity."]
    given: Annotated[RobotModel, "The model as it was given; in JSON its identity."]
    recordings: Annotated[tuple[BagFacts, ...], "Bags of the fit."]
    tests: Annotated[tuple[BagFacts, ...], "Bags of the test alone."]
    steps: Annotated[tuple[Step, ...], "In the order in which they were done."]
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
    found = friction if isinstance(friction, FrictionReport) else FrictionReport("", (), ())
    return IdentificationReport(
        model=model,
        given=whole.given,
        recordings=tuple(recordings),
        tests=tuple(tests),
        steps=whole.steps,
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


def _without_temperature(found: FrictionReport) -> list[str]:
    """Name the axes whose friction is a constant because no recording has their temperature."""
    axes = [fit.name for fit in found.axes if np.isnan(fit.range_degc[0])]
    if not axes:
        return []
    return [
        f"no motor temperature of {', '.join(axes)}, so that friction is a constant there, that of "
        "the temperatures at which it was recorded: check these sensors, or name their topic with "
        "--inputs"
    ]


def _at_one_temperature(found: FrictionReport) -> list[str]:
    """Name the axes whose friction is a constant because they were recorded at one temperature."""
    axes = [fit for fit in found.axes if np.ptp(fit.range_degc) < MIN_RANGE]
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
