"""`robot-energy identify drives`: electrical power of the drives."""

from __future__ import annotations

import json
from argparse import ArgumentParser, ArgumentTypeError, Namespace, RawDescriptionHelpFormatter
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from robot_energy.cli.terminal import add_debug, check_writable, console, progress, write_text
from robot_energy.errors import ModelFileError, NotIdentifiableError

if TYPE_CHECKING:
    from robot_energy.identify.drive_data import DriveData
    from robot_energy.identify.drive_power import DrivePower
    from robot_energy.identify.recordings import Recording
    from robot_energy.model_file import RobotModel

EFFORTS = ("motor_torque", "joint_torque", "motor_current")

DESCRIPTION = """\
Identify how much electrical power the drives take for torque and speed.

With the power of each drive (--drive-power, or drive_power in the mapping of a log): a
reduced efficiency map in four quadrants (paper B, section 6) and beside it a loss model,
both tested on held-out data against a constant efficiency and none. A delay of the power
behind the joint states is found and undone. With one power meter
for all drives: what of the losses its readings tell apart. Where a recording has both,
both are done.

Record motions at several speeds and loads, and several recordings, so that whole ones
can be held out.
"""
EPILOG = """\
examples:
  robot-energy identify drives cold warm --model kr16 --effort motor_torque \\
      --drive-power /drive_power --out my_robot.yaml --plot maps.png
  robot-energy identify drives L0L1.csv L1L2.csv L2L3.csv --ur-rtde --model ur3e \\
      --out my_ur3e.yaml
  robot-energy identify drives --log voraus.csv --mapping voraus.yaml
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "drives",
        help="electrical power of the drives from torque and speed",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("bags", nargs="*", metavar="BAG", help="recordings of one robot")
    parser.add_argument("--model", metavar="FILE|NAME", help="model of the robot")
    parser.add_argument(
        "--effort",
        choices=EFFORTS,
        help="what the effort in the joint states means; without it the model's own torque "
        "is used, rigid bodies and friction",
    )
    parser.add_argument(
        "--drive-power", metavar="TOPIC", help="array with the power of each drive [W]"
    )
    parser.add_argument(
        "--drive-joints",
        nargs="+",
        metavar="JOINT",
        help="joints in the order of that array (default: of the model)",
    )
    parser.add_argument(
        "--ur-rtde", action="store_true", help="the recordings are CSV files of UR's RTDE"
    )
    parser.add_argument(
        "--cutoff",
        type=_frequency,
        default=5.0,
        metavar="HZ",
        help="of the low-pass of the maps (default 5 Hz)",
    )
    parser.add_argument("--out", metavar="FILE", help="write the model with these drives")
    parser.add_argument("--json", metavar="FILE", help="write all figures as JSON; - for stdout")
    parser.add_argument("--plot", metavar="FILE", help="draw the maps (.png, .svg, .pdf)")
    log = parser.add_argument_group("from logs with torque, without a model")
    log.add_argument("--log", nargs="+", metavar="CSV", help="CSV logs, plain or .gz")
    log.add_argument("--mapping", metavar="FILE", help="what their columns mean")
    add_debug(parser)
    parser.set_defaults(run=run)


def _frequency(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise ArgumentTypeError(f"'{text}' is no frequency above 0 Hz")
    return value


def run(args: Namespace) -> int:
    """Identify and report.

    Raises:
        RobotEnergyError: If recordings, logs or model cannot be used, or nothing can be
            identified.
    """
    from robot_energy.identify.drive_data import location
    from robot_energy.identify.drive_delay import estimate_power_delay, with_delay_undone
    from robot_energy.identify.drives import fit_drives, with_drives
    from robot_energy.identify.total_power import compare_total, fit_total, with_total
    from robot_energy.identify.total_sums import sums
    from robot_energy.report.drives import drives_summary, print_drives, total_summary

    check_writable(args.json, "the JSON report")
    check_writable(args.out, "the model file")
    check_writable(args.plot, "the figure")
    _check(args)
    data, model = _data(args)
    source = ", ".join(Path(name).name for name in args.bags or args.log)
    summary: dict[str, Any] = {"torque": args.effort or ("log" if args.log else "model")}
    fitted = None
    written = model
    if data.usable.any():
        delay = estimate_power_delay(data)
        if delay is not None:
            data = with_delay_undone(data, delay.applied)
        fitted = fit_drives(data, source, args.cutoff)
        summary["drives"] = drives_summary(fitted, delay)
        if written is not None:
            written = with_drives(written, fitted, source)
    place = location(data)
    if place is not None:
        total = sums(data, model)
        fit = fit_total(total)
        summary["total"] = total_summary(total, fit, *compare_total(total, model))
        if written is not None and fitted is None:
            written, notes = with_total(written, fit, place, source)
            summary["total"]["notes"] += notes
    elif fitted is None:
        raise NotIdentifiableError(
            "the recordings have neither the power of the drives nor a power meter",
            "measured electrical power beside torque and speed",
            "name the topic of the drives with --drive-power, or record the meter's topic",
        )
    if args.out is not None and written is not None:
        from robot_energy.model_file import save

        save(written, args.out)
    if args.json is not None:
        write_text(args.json, json.dumps(summary, indent=2, allow_nan=False) + "\n")
    if args.plot is not None:
        from robot_energy.report.efficiency_figure import efficiency_maps

        maps = [axis for axis in fitted.axes if axis.map is not None] if fitted else []
        efficiency_maps(maps, args.plot, source)
    if args.json != "-":
        print_drives(summary, console())
    return 0


def _check(args: Namespace) -> None:
    """Refuse options that do not fit together."""
    if bool(args.bags) == bool(args.log):
        raise ModelFileError("neither recordings nor logs, or both", "BAG... or --log")
    if args.bags and args.model is None:
        raise ModelFileError("recordings need --model", "a model file")
    if args.log and args.mapping is None:
        raise ModelFileError("the log has no --mapping", "a YAML file that names its columns")
    if args.log and (args.out or args.model or args.effort):
        raise ModelFileError(
            "a log is used without a model and makes none",
            "--log and --mapping alone, or recordings with --model",
            "import the log to a bag",
        )
    if args.ur_rtde and args.drive_power:
        raise ModelFileError("recordings of RTDE have no power of each drive", "no --drive-power")


def _data(args: Namespace) -> tuple[DriveData, RobotModel | None]:
    from robot_energy.identify.drive_data import drive_data, drive_data_of_logs

    if args.log:
        from robot_energy.logs.mapped_csv import read_csv
        from robot_energy.logs.mapping import load_mapping

        mapping = load_mapping(args.mapping)
        logs = [read_csv(log, mapping) for log in args.log]
        unit = mapping.joints.effort.unit if mapping.joints.effort is not None else ""
        return drive_data_of_logs([(held, list(parts)) for _, held, parts in logs], unit), None
    from robot_energy.blocks import EffortMeaning
    from robot_energy.identify.drive_power import read_drive_power
    from robot_energy.identify.recordings import read_recording
    from robot_energy.logs import import_ur_rtde
    from robot_energy.model_file import load

    model = load(args.model)
    effort = EffortMeaning[args.effort.upper()] if args.effort else EffortMeaning.NONE
    recordings: list[Recording] = []
    powers: list[DrivePower | None] = []
    with ExitStack() as stack:
        for number, name in enumerate(args.bags):
            bag = name
            if args.ur_rtde:
                folder = Path(stack.enter_context(TemporaryDirectory()))
                bag = import_ur_rtde([name], folder / str(number), model.joint_names).bag
            with progress(f"reading {Path(name).name}") as report:
                recordings.append(read_recording(bag, model, effort, progress=report))
            powers.append(
                read_drive_power(bag, args.drive_power, model.joint_names, args.drive_joints)
                if args.drive_power
                else None
            )
    return drive_data(recordings, powers, measured_torque=args.effort is not None), model
