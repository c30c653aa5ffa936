"""Options of all verbs that replay bags: which topics, which part, and how they are read."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from robot_energy.foundation.described import documented
from robot_energy.foundation.options import Option
from robot_energy.inputs.options import LATEST, TOPICS, InputOptions

if TYPE_CHECKING:
    from robot_energy.condition.learner import ConditionRecord

NONE = "none"  # instead of a topic: use none of the bag's
ROBOT, PART, COUNTED, OUTPUTS, PERIOD = "robot", "part of the bag", "counted", "outputs", "period"


# fmt: off
class PartOptions(TypedDict, total=False):
    """Which part of a bag is read; all of it where nothing is said."""

    start: Annotated[float | None, Option(
        "read the bag from here on: seconds after its start, negative: before its end",
        unit="s", group=PART)]
    end: Annotated[float | None, Option(
        "read the bag up to here, counted in the same way", unit="s", group=PART)]


class ReadOptions(PartOptions, InputOptions, total=False):
    """What is read and how; all may be left out."""

    robot: Annotated[str | None, Option(
        "robot whose driver is known (see: robot-energy kinds): read the topics of its driver and "
        "use the shipped model; --model and --inputs override it", value="NAME", group=ROBOT)]
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
