"""What the public functions accept in place of their own types."""

from __future__ import annotations

from pathlib import Path

from robot_energy.blocks import EffortMeaning
from robot_energy.errors import ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel, load
from robot_energy.presets import ROBOTS

ModelName = str | Path | RobotModel  # a model, its file, or the name of a shipped one


def model_of(model: ModelName) -> RobotModel:
    """Return a model, loaded if it is a name.

    Args:
        model: A model, its file, or the name of a shipped one.

    Raises:
        ModelFileError: If there is none, or it cannot be used.
    """
    return model if isinstance(model, RobotModel) else load(model)


def effort_meaning(effort: str) -> EffortMeaning:
    """Return what the effort in the joint states means.

    Args:
        effort: Its name.

    Raises:
        ParameterError: If it is unknown.
    """
    if effort not in tuple(EffortMeaning):
        raise ParameterError(f"effort is '{effort}'", f"one of {', '.join(EffortMeaning)}")
    return EffortMeaning(effort)


def driver_inputs(path: str | Path | None, robot: str | None) -> tuple[Inputs | None, list[str]]:
    """Read the inputs of a parameter file, of a known robot, or of both.

    Args:
        path: Parameter file of a monitor, whose values go before; None for none.
        robot: Name of a robot in `ROBOTS`; None for none.

    Returns:
        The inputs, None where neither is given, and one sentence for each name that is probably
        misspelt.

    Raises:
        KindError: If the robot is unknown.
        ParameterError: If the file cannot be used.
    """
    if robot is None:
        return (None, []) if path is None else read_inputs(path)
    preset = ROBOTS[robot]
    return read_inputs(preset.inputs) if path is None else read_inputs(path, preset)
