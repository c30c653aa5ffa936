"""What was learned of a robot over one recording, or over many in the order of time."""

from typing import Annotated

from robot_energy.condition.learner import ConditionLearner
from robot_energy.condition.wear import WearAlarm
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result


class LearnedJoint(Result):
    """Friction of one joint against the model file, from measured torque."""

    name: Annotated[str, "Name of the joint."]
    multiplier: Annotated[
        Number,
        "Measured over model friction, mean over speeds and temperatures, within its bounds; "
        "None where nothing is known. [-]",
    ]
    multiplier_raw: Annotated[Number, "Multiplier of the newest minute of motion. [-]"]
    valid: Annotated[bool, "Whether it can be used."]
    motion: Annotated[float, "Time in motion from which it was learned. [s]"]
    records: Annotated[int, "Records of motion that the test for wear keeps."]


class WearFinding(Result):
    """A lasting change of friction."""

    joint: Annotated[str, "Its name; empty for the whole robot, as one power meter sees it."]
    fell: Annotated[bool, "Whether friction has fallen, as after re-greasing; else it has risen."]
    change: Annotated[float, "Friction now over that of the first records, less 1. [-]"]
    change_std: Annotated[Number, "Its standard deviation. [-]"]
    since_ns: Annotated[int | None, "When the change began. [ns since 1970]"]
    certainty: Annotated[float, "Probability that it is not chance. [-]"]
    sentence: Annotated[str, "The same in words."]


class ConditionReport(Result):
    """Learned figures and lasting changes of friction."""

    learning: Annotated[
        str, "What was done with learned figures: ``off``, ``observe`` or ``apply``."
    ]
    joints: Annotated[tuple[LearnedJoint, ...], "Joints in model order."]
    friction_factor: Annotated[
        float, "On the friction of joints without torque, from the meter. [-]"
    ]
    loss_offset: Annotated[float, "Added to the constant losses, from the meter. [W]"]
    meter_valid: Annotated[bool, "Whether both can be used."]
    wear: Annotated[tuple[WearFinding, ...], "Lasting changes; empty while there are none."]


def condition_report(learner: ConditionLearner, model: RobotModel) -> ConditionReport:
    """Return what was learned by now."""
    friction, factor = learner.friction, learner.meter.filtered
    time = friction.sums[2].sum(axis=(0, 2, 3)).tolist()
    rows = zip(
        model.joint_names,
        friction.filtered.tolist(),
        friction.raw.tolist(),
        friction.valid.tolist(),
        time,
        [len(test.records) for test in learner.wear.joints],
        strict=True,
    )
    return ConditionReport(
        str(learner.learning),
        tuple(LearnedJoint(*row) for row in rows),
        *factor,
        learner.meter.valid,
        tuple(_finding(alarm) for alarm in learner.wear.alarms),
    )


def _finding(alarm: WearAlarm) -> WearFinding:
    drift = alarm.drift
    return WearFinding(
        alarm.joint,
        drift.fell,
        drift.size,
        drift.std,
        drift.since_ns,
        alarm.sure,
        alarm.sentence,
    )
