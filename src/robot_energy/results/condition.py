"""What was learned of a robot over one recording, or over many in the order of time."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.condition.learner import ConditionLearner
from robot_energy.condition.wear import WearAlarm
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result


@dataclass(frozen=True)
class LearnedJoint(Result):
    """Friction of one joint against the model file, from measured torque.

    Attributes:
        name: Of the joint.
        multiplier: Measured over model friction, mean over speeds and temperatures, within its
            bounds; None where nothing is known. [-]
        multiplier_raw: That of the newest minute of motion. [-]
        valid: Whether it can be used.
        motion: Time in motion behind it. [s]
        records: Records of motion that the test for wear keeps.
    """

    name: str
    multiplier: Number
    multiplier_raw: Number
    valid: bool
    motion: float
    records: int


@dataclass(frozen=True)
class WearFinding(Result):
    """A lasting change of friction.

    Attributes:
        joint: Its name; empty for the whole robot, as one power meter sees it.
        fell: Whether friction has fallen, as after re-greasing; else it has risen.
        change: Friction now over that of the first records, less 1. [-]
        change_std: Its standard deviation. [-]
        since_ns: When the change began. [ns since 1970]
        certainty: Probability that it is no chance. [-]
        sentence: The same in words.
    """

    joint: str
    fell: bool
    change: float
    change_std: Number
    since_ns: int | None
    certainty: float
    sentence: str


@dataclass(frozen=True)
class ConditionReport(Result):
    """Learned figures and lasting changes of friction.

    Attributes:
        learning: What was done with them: ``off``, ``observe`` or ``apply``.
        joints: In model order.
        friction_factor: On the friction of joints without torque, from the meter. [-]
        loss_offset: Added to the constant losses, from the meter. [W]
        meter_valid: Whether both can be used.
        wear: Lasting changes; empty while there are none.
    """

    learning: str
    joints: tuple[LearnedJoint, ...]
    friction_factor: float
    loss_offset: float
    meter_valid: bool
    wear: tuple[WearFinding, ...]


def condition_report(learner: ConditionLearner, model: RobotModel) -> ConditionReport:
    """Return what was learned by now.

    Args:
        learner: After the last recording.
        model: The robot's model.
    """
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
