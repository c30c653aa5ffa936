"""What the public functions accept in place of their own types."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import RobotModel, load
from robot_energy.presets import ROBOTS
from robot_energy.timeline.blocks import EffortMeaning

if TYPE_CHECKING:
    from robot_energy.inputs.sources import Inputs

Member = TypeVar("Member", bound=StrEnum)
ModelName = str | Path | RobotModel  # a model, its file, or the name of a shipped one


def model_of(model: ModelName) -> RobotModel:
    """Return a model, loaded if it is a name."""
    return model if isinstance(model, RobotModel) else load(model)


def effort_meaning(effort: str) -> EffortMeaning:
    """Return what the effort in the joint states means."""
    return member_named(EffortMeaning, "effort", effort)


def member_named(kind: type[Member], what: str, name: str) -> Member:
    """Return the member of an enumeration."""
    if name not in tuple(kind):
        raise ParameterError(f"{what} is '{name}'", f"one of {', '.join(kind)}")
    return kind(name)


def driver_inputs(path: str | Path | None, robot: str | None) -> tuple[Inputs | None, list[str]]:
    """Return the inputs of a robot in `ROBOTS`, those of a file over them, and misspelt names."""
    if robot is None:
        return (None, []) if path is None else read_inputs(path)
    preset = ROBOTS[robot]
    return read_inputs(preset.inputs) if path is None else read_inputs(path, preset)
