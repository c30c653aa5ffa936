"""Options of all commands that replay bags: model, topics, friction and settings."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy.foundation.errors import ModelFileError
from robot_energy.foundation.options import options_of
from robot_energy.inputs.options import SETTINGS, TOPICS
from robot_energy.replay.options import (
    OUTPUTS,
    PART,
    PERIOD,
    ROBOT,
    ReplayOptions,
)
from robot_energy_cli.command import ONE_OF, Options, flags, number_type

INPUTS = flags(ReplayOptions, "inputs")
MODEL_OR_ROBOT: Options = {
    "--model FILE|NAME": "model file, or name of a shipped model (see: robot-energy models); "
    "needed unless --robot has one",
    **flags(ReplayOptions, ROBOT),
}


def model_named(args: Namespace) -> str:
    """Return the model that --model or --robot names."""
    from robot_energy.presets import ROBOTS

    if args.robot is not None:
        return ROBOTS[args.robot].model_or(args.model)
    if args.model is None:
        raise ModelFileError(
            "neither --model nor --robot is given",
            "one of them",
            "`robot-energy models` lists the shipped models, `robot-energy model init` begins "
            "one from a URDF",
        )
    return args.model


AT_FALLBACK = "fallback"
DAMAGED = 3
BAG = "MCAP file, or rosbag2 folder (MCAP or sqlite3)"

degc = number_type("temperature in degC (-60 to 250)", -60.0, 250.0, words=(AT_FALLBACK,))
_port = number_type("port (0 to 65535)", 0.0, 65535.0)
PAGE_SETTINGS: Options = {"--page-settings FILE": "prices and emission factor (YAML)"}
PAGE: Options = {
    "--serve": "show the energy page in a browser until Ctrl-C",
    "--port N": ("port of --serve on this computer (default: any)", {"type": _port}),
    **PAGE_SETTINGS,
}

READING: Options = {  # how bags are read, without their robot
    title: flags(ReplayOptions, title) for title in (TOPICS, SETTINGS, PART)
}


def replay_options(period: str | None = None, compare: str = "", fixed: bool = True) -> Options:
    """Return the options of a command that replays bags: no period of means where it is None."""
    either: dict[str, Any] = {}
    if fixed:
        text = "keep friction at its value at this temperature, whatever was measured"
        either["--fixed-friction DEGC"] = (text, {"type": degc})
    if compare:
        words = {"nargs": "?", "const": AT_FALLBACK, "type": degc}
        either["--compare DEGC"] = (compare, words)
    settings = flags(ReplayOptions, SETTINGS)
    if period is not None:
        for spelled, (text, words) in flags(ReplayOptions, PERIOD).items():
            settings[spelled] = (period or text, words)
    friction: Options = {"friction": {ONE_OF: either}} if either else {}
    return {**MODEL_OR_ROBOT, **friction, **READING, SETTINGS: settings}


def options_given(args: Namespace) -> Any:
    """Return what was typed under the names of `ReplayOptions`, but for what is written."""
    names = [name for name, one in options_of(ReplayOptions).items() if one.group != OUTPUTS]
    return {name: getattr(args, name) for name in names if name in args}
