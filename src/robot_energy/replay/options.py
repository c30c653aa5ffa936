"""Options of all verbs that replay bags: which topics, which part, and how they are read."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from robot_energy.foundation.described import documented
from robot_energy.foundation.options import Option

if TYPE_CHECKING:
    from robot_energy.condition.learner import ConditionRecord

NONE = "none"  # instead of a topic: use none of the bag's
ROBOT, TOPICS, PART = "robot", "topics", "part of the bag"
SETTINGS, COUNTED, OUTPUTS, PERIOD = "settings, seldom needed", "counted", "outputs", "period"
LATEST = 1e6  # of a time that is waited for or bridged [s]


# fmt: off
class PartOptions(TypedDict, total=False):
    """Which part of a bag is read; all of it where nothing is said."""

    start: Annotated[float | None, Option(
        "read the bag from here on: seconds after its start, negative: before its end",
        unit="s", group=PART)]
    end: Annotated[float | None, Option(
        "read the bag up to here, counted in the same way", unit="s", group=PART)]


class ReadOptions(PartOptions, total=False):
    """What is read and how; all may be left out."""

    robot: Annotated[str | None, Option(
        "robot whose driver is known (see: robot-energy kinds): read the topics of its driver and "
        "use the shipped model; --model and --inputs override it", value="NAME", group=ROBOT)]
    joint_states: Annotated[str | Sequence[str] | None, Option(
        "topic of joint states; several if each has some of the joints",
        value="TOPIC", several="in a row", group=TOPICS)]
    temperatures: Annotated[str | Sequence[str] | None, Option(
        "topics of motor temperatures; 'none' to use none of the bag's",
        value="TOPIC", several="in a row", group=TOPICS)]
    meter: Annotated[str | None, Option(
        "topic of the power meter; default: the one in the bag", value="TOPIC", group=TOPICS)]
    payload: Annotated[str | None, Option(
        "topic of payloads set at run time; 'none' to use none of the bag's",
        value="TOPIC", group=TOPICS)]
    inputs: Annotated[str | Path | None, Option(
        "parameter file of a monitor node: read the bag as that node reads its topics; or name of "
        "a robot whose driver is known (see: robot-energy kinds)",
        value="FILE|NAME", group=TOPICS)]
    effort: Annotated[str | None, Option(
        "%(choices)s: what the effort in the joint states is; with it, measured shaft energy is "
        "compared with the predicted one per joint (default: that of --inputs, else none: effort "
        "is not used)",
        value="MEANING", choices=(NONE, "motor_current", "motor_torque", "joint_torque"),
        group=TOPICS)]
    derivative_window: Annotated[float | None, Option(
        "length of the window over which acceleration is estimated (default 0.02 s); 2.5 times as "
        "long where the messages have no velocities",
        unit="s", low=1e-6, high=LATEST, group=SETTINGS)]
    stamp_source: Annotated[str | None, Option(
        "where the stamps of joint states come from: their header (default), or the time of "
        "recording, for drivers that do not set it",
        choices=("header", "receive"), group=SETTINGS)]
    reorder_window: Annotated[float | None, Option(
        "window in which out-of-order joint states are sorted (default 0 s)",
        unit="s", low=0.0, high=0.5, group=SETTINGS)]
    temperature_wait: Annotated[float | None, Option(
        "how long torque waits for late temperatures (default 0.1 s)",
        unit="s", low=0.0, high=LATEST, group=SETTINGS)]
    max_gap: Annotated[float | None, Option(
        "longest time between two joint states that is bridged (default: what the inputs file "
        "says, else five times their usual period, 0.1 s to 1 s)",
        unit="s", low=0.0, high=LATEST, group=SETTINGS)]
    learning: Annotated[str | None, Option(
        "what is learned of friction and constant losses over the bag: off, observe (default) or "
        "apply, to predict with it", choices=("off", "observe", "apply"), group=SETTINGS)]
    meter_max_gap: Annotated[float | None, Option(
        "longest time between meter readings that is bridged (default: what the inputs file "
        "says, else 2 s)", unit="s", low=1e-6, high=LATEST, group=SETTINGS)]
    jobs: Annotated[str | Path | None, Option(
        "count the energy of jobs or cycles: a YAML file with jobs: [{name, begin, end}], in "
        "seconds since 1970 as the stamps of the recording", value="FILE", group=COUNTED)]
    processes: Annotated[int, Option(
        "2: one process reads the bag and computes torque, another counts energy; 3: reading and "
        "torque run in two processes as well; the figures are the same (default 1)",
        choices=(1, 2, 3), default=1, group=COUNTED)]

@documented
class ReplayOptions(ReadOptions, total=False):
    """What is read, how, and what is written; all may be left out."""

    learned: Annotated["ConditionRecord | None",
        "What an earlier recording has taught, the `state` of its learner."]
    out: Annotated[str | Path | None, Option(
        "write the energy topics (/energy/...) into a new bag", value="BAG", group=OUTPUTS)]
    overwrite: Annotated[bool, Option(
        "replace a bag that exists there", default=False, group=OUTPUTS)]
    power_period: Annotated[float | None, Option(
        "averaging period of /energy/power (default 0.02 s)",
        unit="s", low=1e-6, high=LATEST, group=PERIOD)]
    progress: Annotated[Callable[[float], None] | None,
        "Called with the share done, 0 to 1."]
# fmt: on
