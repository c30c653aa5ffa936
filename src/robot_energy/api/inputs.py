"""What the public functions accept in place of their own types."""

from __future__ import annotations

from pathlib import Path

from robot_energy.blocks import EffortMeaning
from robot_energy.errors import ParameterError
from robot_energy.model import RobotModel, load

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
