"""Options that name the robot of a recording: its model, and its driver."""

from __future__ import annotations

from argparse import Namespace

from robot_energy.cli.command import Options
from robot_energy.errors import ModelFileError

INPUTS: Options = {
    "--inputs FILE|NAME": "parameter file of a monitor node: read the bag as that node reads its "
    "topics; or name of a robot whose driver is known (see: robot-energy kinds)"
}
ROBOT: Options = {
    "--model FILE|NAME": "model file, or name of a shipped model (see: robot-energy models); "
    "needed unless --robot has one",
    "--robot NAME": "robot whose driver is known (see: robot-energy kinds): read the topics of its "
    "driver and use the shipped model; --model and --inputs override it",
}


def model_named(args: Namespace) -> str:
    """Return the model that --model or --robot names.

    Args:
        args: Of the command.

    Raises:
        ModelFileError: If neither names one.
        KindError: If the robot is unknown.
    """
    from robot_energy.presets import ROBOTS

    if args.robot is not None:
        return ROBOTS[args.robot].model_or(args.model)
    if args.model is None:
        raise ModelFileError("neither --model nor --robot is given", "one of them")
    return args.model
