"""`robot-energy replay`: run a bag through the model and say where its energy went."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace, RawDescriptionHelpFormatter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.memory import keep_freed_memory
from robot_energy.cli.robots import add_robot, model_named
from robot_energy.cli.terminal import (
    add_debug,
    check_bag,
    check_outputs,
    console,
    progress,
    write_json,
)
from robot_energy.errors import ReportError

if TYPE_CHECKING:
    from robot_energy.bag_replay import Replay
    from robot_energy.model import RobotModel

AT_FALLBACK = "fallback"
DAMAGED = 3
INPUT_OPTIONS = (
    "joint_states",
    "temperatures",
    "meter",
    "payload",
    "inputs",
    "robot",
    "effort",
    "stamp_source",
    "reorder_window",
    "derivative_window",
    "temperature_wait",
    "max_gap",
    "meter_max_gap",
)
EFFORTS = ("none", "motor_current", "motor_torque", "joint_torque")
LONGEST_WINDOW = 0.5  # in which joint states are sorted [s]

DESCRIPTION = """\
Run a recorded bag through the model of its robot and print where the energy went:
predicted and measured over the same time, per joint, per loss and per phase, and which
samples were rejected for which reason.

Topics are found by their type: sensor_msgs/JointState, MotorTemperatures or
sensor_msgs/Temperature (frame_id = joint), PowerReading. If there are several of one type,
name the one to use. Describe other types in the parameter file of the monitor (--inputs).
"""
EPILOG = """\
examples:
  robot-energy replay bag --model kr16
  robot-energy replay bag --model my_robot.yaml --out bag_energy --json energy.json
  robot-energy replay bag --robot ur5e --compare --plot power.png
  robot-energy replay bag --model ur3e --compare 20 --temperatures /driver/temperatures
  robot-energy replay bag --model my_robot.yaml --inputs energy_monitor.yaml
  robot-energy replay bag --model kr16 --effort motor_torque
  robot-energy replay bag --robot fr3 --model my_fr3.yaml --json - | jq .comparison
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "replay",
        help="where the energy of a recorded bag went",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("bag", help="MCAP file, or rosbag2 folder (MCAP or sqlite3)")
    add_robot(parser)
    outputs = parser.add_argument_group("outputs")
    outputs.add_argument(
        "--out", metavar="BAG", help="write the energy topics (/energy/...) into a new bag"
    )
    outputs.add_argument("--overwrite", action="store_true", help="replace the bag of --out")
    outputs.add_argument(
        "--json",
        metavar="FILE",
        help="write all figures as JSON; - for standard output, without tables",
    )
    outputs.add_argument(
        "--plot", metavar="FILE", help="draw power and energy over time (.png, .svg, .pdf)"
    )
    friction = parser.add_argument_group("friction").add_mutually_exclusive_group()
    friction.add_argument(
        "--fixed-friction",
        metavar="DEGC",
        type=degc,
        help="keep friction at its value at this temperature, whatever was measured",
    )
    friction.add_argument(
        "--compare",
        metavar="DEGC",
        nargs="?",
        const=AT_FALLBACK,
        type=degc,
        help="run a second time with friction fixed at this temperature (default: the "
        "model's fallback temperature) and set both side by side",
    )
    settings = add_inputs(parser)
    settings.add_argument(
        "--power-period",
        type=positive,
        metavar="S",
        help="averaging period of /energy/power (default 0.02 s)",
    )
    add_debug(parser)
    parser.set_defaults(run=run)


def add_inputs(parser: ArgumentParser) -> Any:
    """Add the options that say what is read and how; their names are in ``INPUT_OPTIONS``.

    Args:
        parser: Of a command that replays a bag.

    Returns:
        The group of settings, for those of the command itself.
    """
    topics = parser.add_argument_group("topics")
    topics.add_argument(
        "--joint-states",
        metavar="TOPIC",
        nargs="+",
        help="topic of joint states; several if each has some of the joints",
    )
    topics.add_argument(
        "--temperatures",
        metavar="TOPIC",
        nargs="+",
        help="topics of motor temperatures; 'none' to use none of the bag's",
    )
    topics.add_argument(
        "--meter", metavar="TOPIC", help="topic of the power meter; default: the one in the bag"
    )
    topics.add_argument(
        "--inputs",
        metavar="FILE",
        help="parameter file of a monitor node: read the bag as that node reads its topics",
    )
    topics.add_argument(
        "--payload",
        metavar="TOPIC",
        help="topic of payloads set at run time; 'none' to use none of the bag's",
    )
    parser.add_argument(
        "--effort",
        choices=EFFORTS,
        help="what the effort in the joint states is; with it, measured shaft energy is "
        "compared with the predicted one per joint (default: that of --inputs, else none: "
        "effort is not used)",
    )
    settings = parser.add_argument_group("settings, seldom needed")
    settings.add_argument(
        "--derivative-window",
        type=positive,
        metavar="S",
        help="window behind an acceleration (default 0.02 s)",
    )
    settings.add_argument(
        "--stamp-source",
        choices=("header", "receive"),
        help="what dates joint states: their header (default), or the time of the recording "
        "for drivers that do not set it",
    )
    settings.add_argument(
        "--reorder-window",
        type=_window,
        metavar="S",
        help="window in which out-of-order joint states are sorted (default 0 s)",
    )
    settings.add_argument(
        "--temperature-wait",
        type=positive,
        metavar="S",
        help="how long torque waits for late temperatures (default 0.1 s)",
    )
    settings.add_argument(
        "--max-gap",
        type=positive,
        metavar="S",
        help="longest time between two joint states that is bridged (default: what --inputs says, "
        "else five times their usual period, 0.1 s to 1 s)",
    )
    settings.add_argument(
        "--meter-max-gap",
        type=positive,
        metavar="S",
        help="longest time between meter readings that is bridged (default: what --inputs says, "
        "else 2 s)",
    )
    return settings


def degc(text: str) -> float | str:
    """Return a temperature, or ``fallback`` for that of the model. [degC]

    Args:
        text: As it was typed.

    Raises:
        ArgumentTypeError: If it is none.
    """
    if text == AT_FALLBACK:
        return text
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not -60.0 <= value <= 250.0:
        raise ArgumentTypeError(f"'{text}' is no temperature in degC (-60 to 250)")
    return value


def _window(text: str) -> float:
    value = positive(text)
    if value > LONGEST_WINDOW:
        raise ArgumentTypeError(f"'{text}' is longer than {LONGEST_WINDOW:g} s")
    return value


def positive(text: str) -> float:
    """Return a time above 0. [s]

    Args:
        text: As it was typed.

    Raises:
        ArgumentTypeError: If it is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1e6:
        raise ArgumentTypeError(f"'{text}' is no time in s (above 0)")
    return value


def run(args: Namespace) -> int:
    """Replay and report.

    Args:
        args: Of the sub-command.

    Returns:
        0, or 3 if the bag is damaged and was read in part.

    Raises:
        RobotEnergyError: If model, bag or outputs cannot be used.
    """
    from robot_energy.api.replay import fixed_friction
    from robot_energy.files.placement import all_or_none
    from robot_energy.model import load
    from robot_energy.report import print_replay, summarise

    named = model_named(args)
    inputs = [args.bag, named, args.inputs]
    check_outputs(args, inputs)
    if args.plot is not None:
        from robot_energy.report.canvas import check_format

        check_format(Path(args.plot))
    if args.out is not None:
        check_bag(args.out, args.overwrite, inputs, (args.json, args.plot))
    model, change = load(named), None
    if args.fixed_friction is not None:
        model, change = fixed_friction(model, args.fixed_friction)
    with all_or_none():
        first = _replay(args, model, "replaying", out=args.out)
        summary = summarise(first, change)
        second = other = None
        if args.compare is not None:
            fixed, other_change = fixed_friction(model, args.compare)
            second = _replay(args, fixed, "with fixed friction", out=None)
            other = summarise(second, other_change)
        if args.plot is not None:
            _plot(args.plot, first, second, change, other)
        if args.json is not None:
            write_json(args.json, summary if other is None else {**summary, "compared_with": other})
    if args.json != "-":  # last: the reader of a pipe may close it early
        print_replay(summary, console(), other)
    return DAMAGED if first.problems else 0


def _replay(args: Namespace, model: RobotModel, label: str, out: str | None) -> Replay:
    from robot_energy.api.replay import run_replay

    keep_freed_memory()
    options = {name: getattr(args, name) for name in INPUT_OPTIONS}
    with progress(label) as report:
        return run_replay(
            args.bag,
            model,
            **options,
            power_period=args.power_period,
            out=out,
            overwrite=args.overwrite,
            keep_curves=args.plot is not None,
            progress=report,
        )


def _plot(
    path: str,
    first: Replay,
    second: Replay | None,
    change: str | None,
    other: dict[str, Any] | None,
) -> None:
    from robot_energy.blocks import MeterLocation
    from robot_energy.report.power_figure import power_and_energy
    from robot_energy.report.series import Role, Series, compared_series, predicted_series

    runs: list[tuple[Replay, str, Role]] = [(first, "predicted", "predicted")]
    if change:
        runs[0] = (first, f"predicted, {change}", "fixed")
    if second is not None and other is not None:
        runs[0] = (first, "predicted, friction by temperature", "predicted")
        runs.append((second, f"predicted, {other['model']['change']}", "fixed"))
    curves: list[Series] = []
    for result, label, role in runs:
        pair = compared_series(result, label, role)
        if pair is not None:
            curves += pair[1 if curves else 0 :]
        elif (curve := predicted_series(result, label, role)) is not None:
            curves.append(curve)
    if not curves:
        raise ReportError(f"{first.bag} gave no two samples in a row", "something to plot")
    measured = curves[0].role == "measured"
    at_bus = measured and first.ledger.comparison.location is MeterLocation.DC_BUS
    title = f"{first.model.robot.type}, model {first.model.model_id}, {first.bag.name}"
    if first.origin:
        title = f"{title}\n{first.origin}"
    power_and_energy(curves, path, title, "the DC bus" if at_bus else "the grid")
