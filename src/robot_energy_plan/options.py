"""Options of the verbs about motions that are planned: predict, optimize, shared-bus."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from robot_energy.foundation.described import documented
from robot_energy.foundation.options import Option
from robot_energy.foundation.units import DAY
from robot_energy.replay.options import PartOptions, ReplayOptions

if TYPE_CHECKING:
    from robot_energy.model.payload import Payload
    from robot_energy_plan.motion.load_motion import ToolOptions
    from robot_energy_plan.optimization.rest_states import RestState

TOOL = "G-code"
PAYLOAD_LINK = "tool0"
NOT_STATED = "What G-code does not state."
SHARE_DONE = "Called with the share done, 0 to 1."


# fmt: off
@documented
class PredictOptions(TypedDict, total=False):
    """What is predicted of a motion; all may be left out."""

    payload: Annotated[Sequence["Payload"], Option(
        "what the robot carries, its centre of mass in the frame of the link [m] (default link "
        f"{PAYLOAD_LINK}), instead of what the model has on that link",
        value="KG[,X,Y,Z][@LINK]")]
    auxiliary: Annotated[Mapping[str, str], Option(
        "state of an auxiliary load of the models (default: as the model says)",
        value="LOAD=STATE", several="repeated")]
    repeat: Annotated[int, Option(
        "how often (default: as the program says, or 1)", unit="1")]
    max_samples: Annotated[int, Option(
        "greatest number of samples, all programs, robots and temperatures together (default "
        "5,000,000: hours of motion at 100 to 200 samples per second)", unit="1")]
    progress: Annotated[Callable[[float], None] | None, SHARE_DONE]


@documented
class OptimizeOptions(PartOptions, total=False):
    """What may be changed to save energy, and what is kept; all may be left out."""

    cycle_time: Annotated[float | None, Option(
        "time of one cycle with its wait (default: the next one begins at once)",
        unit="s", low=1e-6, high=1e7)]
    standby: Annotated[bool, Option(
        "rests may be spent on brakes, in standby or hibernation, with assumed figures",
        default=False)]
    rest_states: Annotated["str | Path | Sequence[RestState] | None", Option(
        "figures of these states, for this robot", value="FILE")]
    regenerative: Annotated[bool, Option("evaluate a regenerative supply as well", default=False)]
    peak_limit: Annotated[float | None, Option(
        "greatest power from the grid", unit="W", low=1e-6)]
    cycles_per_year: Annotated[float | None, Option(
        "how many cycles there are in a year: says what is saved in it",
        unit="1", low=1.0, high=365 * DAY)]
    time_law: Annotated[bool, Option(
        "moves may follow time laws of their own; --out writes a trajectory then", default=False)]
    level: Annotated[Sequence[str | Path], Option(
        "program of another robot of this model on the same supply; starts within the cycle time "
        "are shifted so that the peak is least; repeat the option for several robots",
        value="PROGRAM", several="repeated")]
    one_bus: Annotated[bool, Option(
        "the robots of --level share one DC bus: starts are shifted so that least energy is "
        "needed, as one accelerates while another brakes", default=False)]
    free_rests: Annotated[bool, Option(
        "the work needs none of the rests of the program: moves may fill them (cycle time: as "
        "long as now, unless given)", default=False)]
    topic: Annotated[str | None, Option(
        "of the JointTrajectory, or of the joint states, in a bag", value="NAME")]
    tool: Annotated["ToolOptions | None", NOT_STATED]
    max_feed: Annotated[float, Option(
        "greatest factor on all feeds (default 1: never faster than the program)",
        unit="-", value="F", default=1.0, group=TOOL)]
    progress: Annotated[Callable[[float], None] | None, SHARE_DONE]


@documented
class SharedBusOptions(ReplayOptions, total=False):
    """What several robots do on one DC bus, and how their bags are read; all may be left out."""

    cycle_time: Annotated[float | None, Option(
        "cycle time of programs: each robot waits until then (default: the longest)",
        unit="s", low=1e-6, high=1e7)]
    same_start: Annotated[bool, Option(
        "the recordings were made at different times: treat them as begun at once",
        default=False)]
    topic: Annotated[str | None, Option(
        "topic of the JointTrajectory in a bag", value="NAME")]
    tool: Annotated["ToolOptions | None", NOT_STATED]
# fmt: on
