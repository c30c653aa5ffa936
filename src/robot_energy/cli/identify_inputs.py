"""What the commands under `robot-energy identify` share: bags to read, results to write."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.numbers import number
from robot_energy.cli.robots import INPUTS, add_robot
from robot_energy.cli.terminal import add_json, check_outputs, progress
from robot_energy.errors import ModelFileError
from robot_energy.units import DQ_FACTORS

if TYPE_CHECKING:
    from robot_energy.api.inputs import BagSource
    from robot_energy.identify.drives.drive_power import DrivePowerTopics
    from robot_energy.identify.stats.systematic import SensorLimits

SENSORS = (
    ("meter-class", "PERCENT", 1.0, "gain of the power meter: its class"),
    ("torque-tolerance", "PERCENT", 5.0, "torque constant of each motor, or gain of the torque"),
    ("thermometer-tolerance", "K", 2.0, "motor temperatures"),
    ("body-tolerance", "PERCENT", 5.0, "torque of bodies that are not identified"),
    ("drive-power-class", "PERCENT", 2.0, "gain of the power that each drive reports"),
)
LIMIT_OF = dict(
    zip(
        (name for name, *_ in SENSORS),
        ("meter", "torque", "thermometer", "bodies", "drive_power"),
        strict=True,
    )
)
EFFORTS = ("motor_torque", "joint_torque", "motor_current")


def add_bags(
    parser: ArgumentParser,
    required: bool = True,
    effort: str = "what the effort in the joint states means",
    robot: bool = False,
) -> None:
    """Add recordings, model and what their topics mean.

    Args:
        parser: Of the command.
        required: Whether there is no other input, such as a log.
        effort: Help of ``--effort``; empty for a command that needs none.
        robot: Whether a known robot can bring model and inputs.
    """
    parser.add_argument(
        "bags", nargs="+" if required else "*", metavar="BAG", help="recordings of one robot"
    )
    if robot:
        add_robot(parser)
    else:
        parser.add_argument(
            "--model", required=required, metavar="FILE|NAME", help="model file to begin with"
        )
    if effort:
        parser.add_argument(
            "--effort", choices=EFFORTS, metavar="MEANING", help=f"%(choices)s: {effort}"
        )
    parser.add_argument("--inputs", **INPUTS)


def add_drive_power(parser: ArgumentParser) -> None:
    """Add where the bags have the power of each drive.

    Args:
        parser: Of the command.
    """
    parser.add_argument(
        "--drive-power",
        nargs="+",
        metavar="TOPIC",
        help="array with the power of each drive [W]; or four arrays, from which the power is "
        "computed: currents d and q [A], voltages d and q [V]",
    )
    parser.add_argument(
        "--drive-joints",
        nargs="+",
        metavar="JOINT",
        help="joints in the order of these arrays (default: of the model)",
    )
    parser.add_argument(
        "--dq-scaling",
        choices=tuple(DQ_FACTORS),
        default="peak",
        help="what the four are: peak or RMS values of a phase, or those of the power-invariant "
        "transformation (default: peak)",
    )


def drive_power_topics(args: Namespace) -> DrivePowerTopics | None:
    """Return where the bags have the power of each drive; None without `--drive-power`.

    Args:
        args: Of the command.

    Raises:
        ModelFileError: If the options do not fit together.
    """
    from robot_energy.identify.drives.drive_power import drive_topics

    if not args.drive_power and (args.drive_joints or args.dq_scaling != "peak"):
        option = "--drive-joints" if args.drive_joints else "--dq-scaling"
        raise ModelFileError(f"{option} without --drive-power", "both or none")
    return drive_topics(args.drive_power, args.drive_joints, args.dq_scaling)


def add_results(parser: ArgumentParser, what: str, plot: str = "") -> None:
    """Add what can be written.

    Args:
        parser: Of the command.
        what: Content of the model file.
        plot: Help of ``--plot``; empty for a command without a figure.
    """
    parser.add_argument("--out", metavar="FILE", help=f"write the model with {what}")
    add_json(parser)
    parser.add_argument(
        "--report", metavar="FILE", help="write tables and figures as one HTML file"
    )
    if plot:
        parser.add_argument("--plot", metavar="FILE", help=plot)


def add_link_voltages(parser: ArgumentParser) -> None:
    """Add the voltages of the DC link, which a grid meter cannot determine.

    Args:
        parser: Of the command.
    """
    parser.add_argument(
        "--link-voltages",
        nargs=2,
        type=number,
        metavar=("MAINS", "CHOPPER"),
        help="of the DC link: rectified mains, and where the brake chopper starts [V] (default: "
        "those of the model file, else 566 and 700, assumed)",
    )


def add_sensors(parser: ArgumentParser) -> None:
    """Add what data sheets say of constant errors, which no recording shows.

    Args:
        parser: Of the command.
    """
    group = parser.add_argument_group("limits of constant errors, from data sheets, +-")
    for name, unit, default, what in SENSORS:
        group.add_argument(
            f"--{name}",
            type=number,
            metavar=unit,
            help=f"{what} [{'%%' if unit == 'PERCENT' else unit}] (default: {default:g})",
        )


def sensor_limits(args: Namespace) -> SensorLimits:
    """Return the limits of the constant errors of the sensors.

    Args:
        args: Of the command.

    Raises:
        ModelFileError: If one is negative.
    """
    from robot_energy.identify.stats.systematic import SensorLimits

    given: dict[str, float] = {}
    for name, unit, *_ in SENSORS:
        value = getattr(args, name.replace("-", "_"))
        if value is not None:
            field = LIMIT_OF[name]
            given[field] = value / 100.0 if unit == "PERCENT" else value
    return SensorLimits(**given)


def add_share_shape(parser: ArgumentParser) -> None:
    """Add the loan of a temperature shape.

    Args:
        parser: Of the command.
    """
    parser.add_argument(
        "--share-shape",
        action="store_true",
        help="axes whose range of temperature or speed is too small take the temperature shape of "
        "the others; only its size is fitted",
    )


def link_voltages(args: Namespace) -> tuple[float, float] | None:
    """Return the voltages of the DC link, None if they were not given.

    Args:
        args: Of the command, with those of `add_link_voltages`.

    Returns:
        Rectified mains, and the voltage at which the brake chopper starts. [V]

    Raises:
        ModelFileError: If they do not rise from above 0.
    """
    if args.link_voltages is None:
        return None
    low, high = args.link_voltages
    if not 0.0 < low < high < float("inf"):
        raise ModelFileError(
            f"--link-voltages are {low:g} and {high:g} V",
            "rectified mains above 0, then the higher voltage of the chopper",
        )
    return low, high


def check_results(args: Namespace) -> None:
    """Refuse files that cannot be written, before the work.

    Args:
        args: Of the command, with those of `add_results` and with all that it reads.

    Raises:
        ReportError: If one of them cannot be.
    """
    inputs: list[Any] = []
    for name in ("bags", "test", "log", "model", "inputs", "mapping"):
        value = getattr(args, name, None)
        inputs += value if isinstance(value, list) else [value]
    check_outputs(args, [one for one in inputs if isinstance(one, str)], args.out)


def check_source(args: Namespace, needs_effort: bool = False) -> None:
    """Refuse bags together with logs, without what they need, or one recording twice.

    Args:
        args: Of the command, with bags and a log.
        needs_effort: Whether the command uses the effort in the joint states of bags.

    Raises:
        ModelFileError: Saying which options belong together.
        BagError: If two bags or logs are the same.
    """
    from robot_energy.identify.provenance import require_distinct

    if bool(args.bags) == bool(args.log):
        raise ModelFileError("neither bags nor a log, or both", "BAG... or --log")
    if args.bags:
        if needs_effort and (args.model is None or (args.effort is None and args.inputs is None)):
            raise ModelFileError(
                "bags need --model and --effort",
                f"a model file, and one of {', '.join(EFFORTS)}",
                "the effort of a driver is never guessed",
            )
        if args.model is None:
            raise ModelFileError("bags need --model", "a model file")
    require_distinct([Path(name) for name in args.bags or args.log])


def bags_of(args: Namespace, bags: Sequence[str | Path] | None = None) -> BagSource:
    """Return the recordings, and how they are read.

    Args:
        args: Of the command.
        bags: Instead of those that the command names.
    """
    from robot_energy.api.inputs import BagSource

    effort, robot = getattr(args, "effort", None), getattr(args, "robot", None)
    sensors = sensor_limits(args) if hasattr(args, "meter_class") else None
    used = args.bags if bags is None else bags
    return BagSource(used, effort, args.inputs, robot, progress, sensors)


def source_of(args: Namespace) -> str:
    """Return the names of the recordings, for the model file.

    Args:
        args: Of the command, with bags or a log.
    """
    return ", ".join(Path(name).name for name in args.bags or args.log)
