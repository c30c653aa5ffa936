"""Ways to rest: drives that hold, brakes, standby, hibernation, each with its way back to work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from robot_energy.foundation.config_file import load
from robot_energy.foundation.described import Described, documented
from robot_energy.foundation.errors import MotionError
from robot_energy.model.figure import ModelEntry, Number

Share = Annotated[Number, Field(ge=0, le=10)]


@documented
class RestState(ModelEntry):
    """A way to rest other than with drives that hold the robot.

    All shares are of the power of the robot at rest on its brakes.
    """

    name: Annotated[Annotated[str, Field(min_length=1)], "As controllers and tables call it."]
    power: Annotated[Share, "Share that is left. [-]"]
    power_std: Annotated[Share, "Its standard deviation. [-]"] = 0.0
    wake_time: Annotated[Annotated[Number, Field(ge=0, le=3600)], "From there to ready. [s]"]
    wake_power: Annotated[Share, "Share while it wakes up. [-]"] = 1.0
    wake_power_std: Annotated[Share, "Its standard deviation. [-]"] = 0.0
    source: Annotated[str, "Where the figures come from."] = ""


class RestStatesFile(ModelEntry):
    """What one robot's controller can do while the robot rests."""

    rest_states: Annotated[list[RestState], Field(min_length=1, max_length=20)]


ASSUMED = (
    RestState(
        name="brakes", power=1.0, power_std=0.05, wake_time=0.5, wake_power=1.1,
        wake_power_std=0.1, source="assumed: the drives stay on, the brakes hold",
    ),
    RestState(
        name="standby", power=0.7, power_std=0.1, wake_time=3.0, wake_power=1.2,
        wake_power_std=0.2, source="assumed; published: about 30 % less than at rest",
    ),
    RestState(
        name="hibernation", power=0.15, power_std=0.05, wake_time=40.0, wake_power=1.2,
        wake_power_std=0.2, source="assumed; published: about 85 % less than at rest",
    ),
)  # fmt: skip
"""For robots whose states nobody measured."""


def read_rest_states(given: str | Path | Sequence[RestState]) -> tuple[RestState, ...]:
    """Return the states of a robot, as they are given or from a file."""
    if not isinstance(given, str | Path):
        return tuple(given)
    file = load(given, RestStatesFile, MotionError, "file of rest states", "see howto_savings.md")
    return tuple(file.rest_states)


class RestCost(Described):
    """Energy of a rest in a state as a share of the energy of the same rest on brakes."""

    held: Annotated[float, "Seconds on brakes that cost as much. [s]"]
    power_error: Annotated[float, "Its error by a standard deviation of the power, likewise. [s]"]
    wake_error: Annotated[float, "The same of the power while it wakes up. [s]"]


def rest_cost(state: RestState, duration: float) -> RestCost | None:
    """Return what a rest costs; None where it is shorter than the way back to work.

    Args:
        duration: Of the rest. [s]
    """
    low = duration - state.wake_time
    if low < 0:
        return None
    return RestCost(
        held=state.power * low + state.wake_power * state.wake_time,
        power_error=state.power_std * low,
        wake_error=state.wake_power_std * state.wake_time,
    )


def break_even(state: RestState, hold_share: float) -> float:
    """Return the shortest rest in which a state costs less than drives that hold. [s]

    ``power (t - wake) + wake_power wake = hold t``; infinite where it never does.

    Args:
        hold_share: Power of drives that hold over that on brakes. [-]
    """
    if state.power >= hold_share:
        return float("inf")
    extra = (state.wake_power - state.power) * state.wake_time
    return max(extra / (hold_share - state.power), state.wake_time)
