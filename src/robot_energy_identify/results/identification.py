"""What identification found; the fits of `identify` are parts of it as they are."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.results.base import Result, Texts
from robot_energy_identify.data.bags import BagFacts
from robot_energy_identify.friction.laws import MIN_RANGE
from robot_energy_identify.friction_and_thermal import FrictionReport
from robot_energy_identify.run_all import FullIdentification
from robot_energy_identify.stats.held_out_energy import HeldOutEnergy
from robot_energy_identify.stats.lag import MeterDelay, MeterTimeConstant
from robot_energy_identify.steps import Step
from robot_energy_identify.thermal.gear import MIN_RISE, MIN_WINDOWS, WINDOW


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
