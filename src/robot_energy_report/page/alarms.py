"""What is wrong and what to do about it: quality bits and diagnostic statuses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, field
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.timeline.blocks import Quality

LEVELS = ("OK", "WARN", "ERROR", "STALE")  # in the order of diagnostic_msgs/DiagnosticStatus
MAX_VALUES = 100  # key values of one status

QUALITY_REMEDIES: dict[Quality, tuple[str, str]] = {
    Quality.TEMPERATURE_MISSING: (
        "a motor temperature was never received; friction is that of the fallback temperature",
        "name the topic of the temperatures under temperature_sources, or set the fallback "
        "temperature in the model file",
    ),
    Quality.TEMPERATURE_STALE: (
        "a motor temperature is too old; friction is that of the fallback temperature",
        "check whether the driver still publishes it; see the status of the motor temperatures",
    ),
    Quality.TEMPERATURE_IMPLAUSIBLE: (
        "the last reading of a motor temperature was refused",
        "check the unit of the source and the sensor",
    ),
    Quality.EXTRAPOLATED: (
        "a motor is colder or warmer than its friction law was fitted for",
        "record a warm-up that covers this temperature and identify friction again",
    ),
    Quality.VELOCITY_DERIVED: (
        "the driver sends no velocity; it is taken from the positions",
        "let the driver publish velocities if it can",
    ),
    Quality.AFTER_GAP: (
        "there was a gap in the joint states; nothing is counted over it",
        "see the status of the joint states for lost or late messages",
    ),
    Quality.DRIVE_EXTRAPOLATED: (
        "a drive works outside the torque or speed its model was identified for",
        "identify the drives from a recording that covers this motion",
    ),
    Quality.NOT_FINITE: (
        "an input or a result is not a number; the power is unknown",
        "look for NaN in the joint states and for a figure missing in the model file",
    ),
    Quality.JOINT_STATE_IMPLAUSIBLE: (
        "the joint states do not fit the limits of the robot description",
        "check the unit of positions and velocities, and that the model is of this robot",
    ),
    Quality.TEMPERATURE_STUCK: (
        "a motor temperature does not change although the motor must have warmed",
        "check the sensor and its driver",
    ),
    Quality.TEMPERATURE_ESTIMATED: (
        "a motor temperature is estimated from the motor's own losses",
        "check its sensor, if it has one",
    ),
}
OUTSIDE_FIT = "outside_fit."  # keys of a status that names motors outside their friction law
REMEDY_KEY = "remedy."  # keys of a status that hold what to do about one of its findings each
SUBJECT_REMEDIES = {
    "joint states": "check the driver, its topic and its rate (ros2 topic hz); if messages are "
    "lost, raise joint_state_depth",
    "motor temperatures": "check the topics under temperature_sources, and their units",
    "energy": "check the topic of the meter, its unit and what it states (meter.*)",
    "auxiliary loads": "check the topics of their meters and states (auxiliary_meters, "
    "auxiliary_states)",
    "registers": "check space and permissions of the state folder, and that only one monitor "
    "writes to it",
    "node": "read the log of the node; set the node active where a life cycle manager runs it",
}


class PageFinding(Described):
    """One status, with what to do about it."""

    level: str
    name: str
    message: str
    remedy: Annotated[str, "What to do; empty where all is well."] = ""
    values: dict[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def of_status(cls, level: int, name: str, message: str, values: dict[str, str]) -> PageFinding:
        """Return the finding of a diagnostic status; texts are made safe to show."""
        word = LEVELS[level] if 0 <= level < len(LEVELS) else "ERROR"
        subject = name.rpartition(": ")[2]
        remedy = "" if word == "OK" else SUBJECT_REMEDIES.get(subject, "read the log of the node")
        own = [text for key, text in values.items() if key.startswith(REMEDY_KEY)]
        for text in own:
            message = message.replace(f"{text}: ", "", 1)
        if own:
            general = () if values.get("findings") == str(len(own)) else (remedy,)
            remedy = shown("; ".join(dict.fromkeys((*general, *own))), MAX_LINE)
        few = [pair for pair in values.items() if not pair[0].startswith(REMEDY_KEY)][:MAX_VALUES]
        return cls(
            word,
            shown(name),
            shown(message, MAX_LINE),
            remedy,
            {shown(key): shown(value) for key, value in few},
        )

    @classmethod
    def no_power(cls, robot: str) -> PageFinding:
        """Return the finding that no power state arrives."""
        return cls(
            "STALE",
            robot,
            "no power state arrives; live figures are not shown",
            "check that a monitor runs, is active, and receives joint states",
        )

    @property
    def names_outside_fit(self) -> bool:
        """Whether it names the motors of `Quality.EXTRAPOLATED`."""
        return self.level != "OK" and any(key.startswith(OUTSIDE_FIT) for key in self.values)

    def plain(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)


def quality_alarms(quality: Quality, findings: Iterable[PageFinding]) -> list[PageFinding]:
    """Return an alarm for each quality bit, but for what a finding names with its motors."""
    if any(one.names_outside_fit for one in findings):
        quality &= ~Quality.EXTRAPOLATED
    return [
        PageFinding("WARN", bit.name or "", message, remedy)
        for bit, (message, remedy) in QUALITY_REMEDIES.items()
        if bit in quality
    ]
