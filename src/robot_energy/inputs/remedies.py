"""What to do about messages that an input rejects, by reason: the same live and in replay."""

from __future__ import annotations

from collections.abc import Mapping

from robot_energy.inputs.joint_states.decode import ZERO_STATE
from robot_energy.timeline.stamps import BAD_STAMP, OLDER

NO_STAMP = "let the driver set the stamp, or set {} to receive"
NO_CLOCK = "start the source of /clock, or set use_sim_time to false"
NO_REASON = ("joint states of this robot", "look up the reasons in the nomenclature")
# Of joint states: what was expected instead of messages refused for a reason, and what mends them.
REFUSED = {
    "malformed": (
        "bytes of sensor_msgs/JointState",
        "check its publisher and, in a bag, its definition",
    ),
    "zero_stamp": ("a stamp in the header", NO_STAMP.format("joint_states.stamp_source")),
    BAD_STAMP: ("a stamp of the clock", "set joint_states.stamp_source to receive"),
    "wrong_length": (
        "one position for each name, and one velocity for each or none",
        "let the driver send as many as names",
    ),
    "repeated_joint": ("each joint name once in a message", "let the driver name each joint once"),
    "not_finite": ("finite positions and velocities", "let the driver leave out what it lacks"),
    OLDER: ("stamps that rise", "set joint_states.reorder_window, or stop one of two publishers"),
    "conflicting_stamp": (
        "a stamp of its own for each state",
        "set joint_states.stamp_source to receive, or stop one of two publishers",
    ),
    "conflicting_publisher": (
        "one publisher for each joint",
        "stop one of two publishers, or name the topics in joint_states.topics",
    ),
    ZERO_STATE: (
        "states of the robot",
        "stop the publisher of zeros, or name the topics in joint_states.topics",
    ),
    "impossible_position": (
        "positions that a motion reaches",
        "check for rows or bits that are corrupt, and the limits of the velocity",
    ),
    "impossible_velocity": (
        "velocities that the positions support",
        "check the unit of velocities and limits",
    ),
    "missing_joint": (
        "readings of every joint around each of the first one",
        "name the topics of all joints in joint_states.topics",
    ),
}
JOINT_STATE_REMEDIES = {reason: remedy for reason, (_, remedy) in REFUSED.items()}
METER_REMEDIES = {
    "zero_stamp": NO_STAMP.format("meter.stamp_source"),
    "unknown_location": "let the publisher set location to 1 (grid) or 2 (DC bus)",
    "unknown_meaning": "let the publisher set meaning to 1, 2 or 3, as PowerReading says",
    "changed_meaning": "let one meter publish; where its meaning or place has changed, restart the "
    "monitor",
}
TEMPERATURE_REMEDIES = {
    "zero_stamp": NO_STAMP.format("stamp_source of the source"),
    "unknown_joint": "set joints and names of the source",
    "no_temperature": "set interface or keys of the source",
    "before_names": "set names_topic of the source",
}


def remedy_of(reason: str, remedies: Mapping[str, str], *, receive_time: bool) -> str:
    """Return what to do about messages that are rejected for a reason; empty if that is not known.

    Args:
        remedies: Those of the input.
        receive_time: Whether they are dated by their receipt, at 0 before simulated time begins.
    """
    if receive_time and reason == "zero_stamp":
        return NO_CLOCK
    return remedies.get(reason, "")
