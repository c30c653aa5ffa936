"""Options of all commands that replay bags: model, topics, friction and settings."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from robot_energy.foundation.errors import ModelFileError
from robot_energy_cli.command import LIST, Options, add_option, add_options, name_of
from robot_energy_cli.numbers import number_type, positive

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
    """Return the model that --model or --robot names."""
    from robot_energy.presets import ROBOTS

    if args.robot is not None:
        return ROBOTS[args.robot].model_or(args.model)
    if args.model is None:
        raise ModelFileError("neither --model nor --robot is given", "one of them")
    return args.model


AT_FALLBACK = "fallback"
DAMAGED = 3
LEARNING = ("off", "observe", "apply")
EFFORTS = ("none", "motor_current", "motor_torque", "joint_torque")
MAX_WINDOW = 0.5  # in which joint states are sorted [s]
BAG = "MCAP file, or rosbag2 folder (MCAP or sqlite3)"

degc = number_type("temperature in degC (-60 to 250)", -60.0, 250.0, words=(AT_FALLBACK,))
_port = number_type("port (0 to 65535)", 0.0, 65535.0)
_window = number_type(f"time in s (above 0, to {MAX_WINDOW:g})", 0.0, MAX_WINDOW, open_low=True)
POSITIVE: dict[str, Any] = {"type": positive}

# Their names are those of `ReplayOptions`.
TOPICS: Options = {
    "--joint-states TOPIC": ("topic of joint states; several if each has some of the joints", LIST),
    "--temperatures TOPIC": (
        "topics of motor temperatures; 'none' to use none of the bag's",
        LIST,
    ),
    "--meter TOPIC": "topic of the power meter; default: the one in the bag",
    "--payload TOPIC": "topic of payloads set at run time; 'none' to use none of the bag's",
    **INPUTS,
    "--effort MEANING": (
        "%(choices)s: what the effort in the joint states is; with it, measured shaft "
        "energy is compared with the predicted one per joint (default: that of --inputs, else "
        "none: effort is not used)",
        {"choices": EFFORTS},
    ),
}
PART: Options = {
    "--start S": "read the bag from here on: seconds after its start, negative: before its end",
    "--end S": "read the bag up to here, counted in the same way",
}
SETTINGS: Options = {
    "--derivative-window S": (
        "length of the window over which acceleration is estimated (default 0.02 s); 2.5 times as "
        "long where the messages have no velocities",
        POSITIVE,
    ),
    "--stamp-source": (
        "where the stamps of joint states come from: their header (default), or the time of "
        "recording, for drivers that do not set it",
        {"choices": ("header", "receive")},
    ),
    "--reorder-window S": (
        "window in which out-of-order joint states are sorted (default 0 s)",
        {"type": _window},
    ),
    "--temperature-wait S": (
        "how long torque waits for late temperatures (default 0.1 s)",
        POSITIVE,
    ),
    "--max-gap S": (
        "longest time between two joint states that is bridged (default: what --inputs "
        "says, else five times their usual period, 0.1 s to 1 s)",
        POSITIVE,
    ),
    "--learning": (
        "what is learned of friction and constant losses over the bag: off, observe "
        "(default) or apply, to predict with it",
        {"choices": LEARNING},
    ),
    "--meter-max-gap S": (
        "longest time between meter readings that is bridged (default: what --inputs "
        "says, else 2 s)",
        POSITIVE,
    ),
}
PROCESSES: Options = {
    "--processes": (
        "2: one process reads the bag and computes torque, another counts energy; 3: reading and "
        "torque run in two processes as well; the figures are the same (default 1)",
        {"type": int, "choices": (1, 2, 3), "default": 1},
    )
}
JOBS: Options = {
    "--jobs FILE": "count the energy of jobs or cycles: a YAML file with jobs: [{name, begin, "
    "end}], in seconds since 1970 as the stamps of the recording"
}


PAGE_SETTINGS: Options = {"--page-settings FILE": "prices and emission factor (YAML)"}
PAGE: Options = {
    "--serve": "show the energy page in a browser until Ctrl-C",
    "--port N": ("port of --serve on this computer (default: any)", {"type": _port}),
    **PAGE_SETTINGS,
}


def add_replay(
    parser: ArgumentParser, period: str = "", compare: str = "", fixed: bool = True
) -> None:
    """Add the options; the bags are added by the command itself."""
    add_options(parser, ROBOT)
    friction = parser.add_argument_group("friction") if fixed or compare else None
    either = friction.add_mutually_exclusive_group() if friction else None
    if either and fixed:
        add_option(
            either,
            "--fixed-friction DEGC",
            "keep friction at its value at this temperature, whatever was measured",
            type=degc,
        )
    if either and compare:
        add_option(either, "--compare DEGC", compare, nargs="?", const=AT_FALLBACK, type=degc)
    settings = add_reading(parser)
    if period:
        add_option(settings, "--power-period S", period, **POSITIVE)


def add_reading(parser: ArgumentParser) -> Any:
    """Return the group of the settings, after adding how bags are read, without their robot."""
    topics = parser.add_argument_group("topics")
    settings = parser.add_argument_group("settings, seldom needed")
    parts = parser.add_argument_group("part of the bag")
    for part, options in ((topics, TOPICS), (parts, PART), (settings, SETTINGS)):
        add_options(part, options)
    return settings


def options_of(args: Namespace) -> dict[str, Any]:
    """Return what was given, under the names of `ReplayOptions`.

    Args:
        args: Of the command, with those of `add_replay`; jobs and processes where it has them.
    """
    names = ["robot", *map(name_of, (*TOPICS, *PART, *SETTINGS, *JOBS, *PROCESSES))]
    return {name: getattr(args, name) for name in names if name in args}
