"""`robot-energy import`: turn logs of robots into bags."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from typing import TYPE_CHECKING, Any

from robot_energy.cli.terminal import add_debug, console

if TYPE_CHECKING:
    from robot_energy.logs import ImportReport

UR_DESCRIPTION = """\
Turn a recording of UR's real-time interface (RTDE, CSV) into a bag.

Needs the columns timestamp and actual_q_0 ... actual_q_5; uses, where they are there,
actual_qd_*, actual_current_*, joint_temperatures_*, actual_robot_voltage and
actual_robot_current. Several files of one recording are joined in the order of their time.
"""
UR_EPILOG = """\
example:
  robot-energy import ur-rtde part_1.csv part_2.csv --out ur_bag
  robot-energy replay ur_bag --model ur3e
"""
CSV_DESCRIPTION = """\
Turn any CSV log (plain or .gz, with a header) into a bag, by a small YAML file that says
which column means what, in which unit. Commented examples: src/examples/mappings.
"""
CSV_EPILOG = """\
example:
  robot-energy import csv log.csv.gz --mapping kr300.yaml --out kr300_bag
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command and the kinds of logs."""
    parser: ArgumentParser = commands.add_parser(
        "import",
        help="turn logs (UR RTDE, any CSV) into bags",
        description="Turn logs of robots into bags that replay like any other. Rows that "
        "cannot be used are counted by reason and reported.",
    )
    kinds = parser.add_subparsers(title="kinds of logs", metavar="KIND", required=True)
    ur: ArgumentParser = kinds.add_parser(
        "ur-rtde",
        help="CSV recordings of UR robots",
        description=UR_DESCRIPTION,
        epilog=UR_EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    ur.add_argument("logs", nargs="+", metavar="LOG", help="CSV files of one recording")
    ur.add_argument(
        "--joints",
        nargs=6,
        metavar="NAME",
        help="names of the six joints, base first (default: those of the UR URDF)",
    )
    ur.add_argument("--prefix", default="", help="put before each joint name")
    ur.set_defaults(run=run_ur)
    other: ArgumentParser = kinds.add_parser(
        "csv",
        help="any CSV log, by a mapping of its columns",
        description=CSV_DESCRIPTION,
        epilog=CSV_EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    other.add_argument("log", metavar="LOG", help="CSV file, plain or .gz")
    other.add_argument("--mapping", required=True, metavar="FILE", help="YAML file")
    other.set_defaults(run=run_csv)
    for kind in (ur, other):
        kind.add_argument("--out", required=True, metavar="BAG", help="folder of the new bag")
        kind.add_argument("--overwrite", action="store_true", help="replace the bag of --out")
        add_debug(kind)


def run_ur(args: Namespace) -> int:
    """Import a UR recording.

    Raises:
        RobotEnergyError: If logs or bag cannot be used.
    """
    from robot_energy.logs import UR_JOINTS, import_ur_rtde

    names = [f"{args.prefix}{name}" for name in args.joints or UR_JOINTS]
    _print(import_ur_rtde(args.logs, args.out, names, args.overwrite))
    return 0


def run_csv(args: Namespace) -> int:
    """Import a CSV log.

    Raises:
        RobotEnergyError: If mapping, log or bag cannot be used.
    """
    from robot_energy.logs import import_csv, load_mapping

    _print(import_csv(args.log, load_mapping(args.mapping), args.out, args.overwrite))
    return 0


def _print(report: ImportReport) -> None:
    out = console()
    start, end = report.start_ns or 0, report.end_ns or 0
    rate = (report.joint_states - 1) / ((end - start) * 1e-9) if end > start else float("nan")
    span = f"{(end - start) * 1e-9:.3f} s, {rate:.4g} joint states a second on average"
    out.print(f"wrote {report.bag}: {span}", soft_wrap=True)
    topics = [
        ("/joint_states", report.joint_states),
        ("/motor_temperatures", report.temperatures),
        ("/power_meter", report.readings),
        ("/drive_power", report.drive_powers),
    ]
    for topic, count in topics:
        out.print(f"  {topic:<20} {count or 'none'}", soft_wrap=True)
    for account in report.files:
        reasons = ", ".join(
            f"{count} {reason.replace('_', ' ')} (first at line {account.first_line[reason]})"
            for reason, count in account.rejected.items()
        )
        out.print(
            f"{account.path}: {account.received} rows, {account.accepted} used, "
            f"rejected: {reasons or 'none'}",
            soft_wrap=True,
        )
    for note in report.notes:
        out.print(f"note: {note}", soft_wrap=True)
