"""Options of all commands that replay bags: model, topics, friction and settings."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from robot_energy.cli.numbers import number, number_type, positive
from robot_energy.cli.robots import INPUTS, add_robot

AT_FALLBACK = "fallback"
DAMAGED = 3
LEARNING = ("off", "observe", "apply")
EFFORTS = ("none", "motor_current", "motor_torque", "joint_torque")
MAX_WINDOW = 0.5  # in which joint states are sorted [s]
BAG = "MCAP file, or rosbag2 folder (MCAP or sqlite3)"

degc = number_type("temperature in degC (-60 to 250)", -60.0, 250.0, words=(AT_FALLBACK,))
_window = number_type(f"time in s (above 0, to {MAX_WINDOW:g})", 0.0, MAX_WINDOW, open_low=True)

# Names are those of `ReplayOptions`; the keywords those of `add_argument`.
TOPICS: dict[str, dict[str, Any]] = {
    "joint_states": {
        "metavar": "TOPIC",
        "nargs": "+",
        "help": "topic of joint states; several if each has some of the joints",
    },
    "temperatures": {
        "metavar": "TOPIC",
        "nargs": "+",
        "help": "topics of motor temperatures; 'none' to use none of the bag's",
    },
    "meter": {"metavar": "TOPIC", "help": "topic of the power meter; default: the one in the bag"},
    "payload": {
        "metavar": "TOPIC",
        "help": "topic of payloads set at run time; 'none' to use none of the bag's",
    },
    "inputs": INPUTS,
    "effort": {
        "choices": EFFORTS,
        "metavar": "MEANING",
        "help": "%(choices)s: what the effort in the joint states is; with it, measured shaft "
        "energy is compared with the predicted one per joint (default: that of --inputs, else "
        "none: effort is not used)",
    },
}
PART: dict[str, dict[str, Any]] = {
    "start": {
        "type": number,
        "metavar": "S",
        "help": "read the bag from here on: seconds after its start, negative: before its end",
    },
    "end": {"type": number, "metavar": "S", "help": "read the bag up to here, likewise"},
}
SETTINGS: dict[str, dict[str, Any]] = {
    "derivative_window": {
        "type": positive,
        "metavar": "S",
        "help": "window behind an acceleration (default 0.02 s), 2.5 times as long where the "
        "messages have no velocities",
    },
    "stamp_source": {
        "choices": ("header", "receive"),
        "help": "what dates joint states: their header (default), or the time of the recording "
        "for drivers that do not set it",
    },
    "reorder_window": {
        "type": _window,
        "metavar": "S",
        "help": "window in which out-of-order joint states are sorted (default 0 s)",
    },
    "temperature_wait": {
        "type": positive,
        "metavar": "S",
        "help": "how long torque waits for late temperatures (default 0.1 s)",
    },
    "max_gap": {
        "type": positive,
        "metavar": "S",
        "help": "longest time between two joint states that is bridged (default: what --inputs "
        "says, else five times their usual period, 0.1 s to 1 s)",
    },
    "learning": {
        "choices": LEARNING,
        "help": "what is learned of friction and constant losses over the bag: off, observe "
        "(default) or apply, to predict with it",
    },
    "meter_max_gap": {
        "type": positive,
        "metavar": "S",
        "help": "longest time between meter readings that is bridged (default: what --inputs "
        "says, else 2 s)",
    },
}
PROCESSES: dict[str, Any] = {
    "type": int,
    "choices": (1, 2, 3),
    "default": 1,
    "help": "2: a process of its own reads the bag and computes torque, ahead of the one that "
    "counts energy; 3: reading and torque are two; no figure changes (default 1)",
}


def add_replay(
    parser: ArgumentParser, period: str = "", compare: str = "", fixed: bool = True
) -> None:
    """Add the options; the bags are added by the command itself.

    Args:
        parser: Of a command that replays bags.
        period: Help of ``--power-period``; empty for a command without it.
        compare: Help of ``--compare``; empty for a command without it.
        fixed: Whether friction can be kept fixed instead.
    """
    add_robot(parser)
    friction = parser.add_argument_group("friction") if fixed or compare else None
    either = friction.add_mutually_exclusive_group() if friction else None
    if either and fixed:
        either.add_argument(
            "--fixed-friction",
            metavar="DEGC",
            type=degc,
            help="keep friction at its value at this temperature, whatever was measured",
        )
    if either and compare:
        either.add_argument(
            "--compare", metavar="DEGC", nargs="?", const=AT_FALLBACK, type=degc, help=compare
        )
    topics = parser.add_argument_group("topics")
    settings = parser.add_argument_group("settings, seldom needed")
    parts = parser.add_argument_group("part of the bag")
    for part, options in ((topics, TOPICS), (parts, PART), (settings, SETTINGS)):
        for name, words in options.items():
            part.add_argument(f"--{name.replace('_', '-')}", **words)
    if period:
        settings.add_argument("--power-period", type=positive, metavar="S", help=period)


def add_jobs(parser: ArgumentParser) -> None:
    """Add the option of commands that show job intervals.

    Args:
        parser: Of a command that replays bags.
    """
    parser.add_argument(
        "--jobs",
        metavar="FILE",
        help="count the energy of jobs or cycles: a YAML file with jobs: [{name, begin, end}], in "
        "seconds since 1970 as the stamps of the recording",
    )


def options_of(args: Namespace) -> dict[str, Any]:
    """Return what was given, under the names of `ReplayOptions`.

    Args:
        args: Of the command, with those of `add_replay`; jobs and processes where it has them.
    """
    given = {name: getattr(args, name) for name in ("robot", *TOPICS, *PART, *SETTINGS)}
    return given | {name: getattr(args, name) for name in ("jobs", "processes") if name in args}
