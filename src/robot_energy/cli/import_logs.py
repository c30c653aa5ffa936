"""`robot-energy import`: turn logs of robots into bags."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from robot_energy.cli.terminal import add_command, console, wrote
from robot_energy.log_formats import LOG_FORMATS

if TYPE_CHECKING:
    from robot_energy.logs import ImportReport


def add_parser(commands: Any) -> None:
    """Add the sub-command and the formats of logs.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    parser: ArgumentParser = commands.add_parser(
        "import",
        help="turn logs (UR RTDE, KUKA traces, CSV, Parquet) into bags",
        description="Convert logs of robots to bags that replay like others. Rows that "
        "cannot be used are counted by reason and reported.",
    )
    kinds = parser.add_subparsers(title="kinds of logs", metavar="KIND", required=True)
    for kind in LOG_FORMATS.values():
        own = add_command(kinds, kind.name, run, kind.line, kind.description, kind.epilog)
        kind.add_arguments(own)
        own.add_argument("--out", required=True, metavar="BAG", help="folder of the new bag")
        own.add_argument("--overwrite", action="store_true", help="replace the bag of --out")
        own.set_defaults(log_format=kind.name)


def run(args: Namespace) -> int:
    """Import logs of one recording.

    Args:
        args: Of the command, with those of the format of its logs.

    Returns:
        Exit code 0, also where some rows could not be used: they are counted and printed.

    Raises:
        RobotEnergyError: If logs, mapping or bag cannot be used.
    """
    _print(LOG_FORMATS[args.log_format].run(args))
    return 0


def _print(report: ImportReport) -> None:
    out = console()
    start, end = report.start_ns or 0, report.end_ns or 0
    rate = (report.joint_states - 1) / ((end - start) * 1e-9) if end > start else float("nan")
    span = f"{(end - start) * 1e-9:.3f} s, {rate:.4g} joint states a second on average"
    wrote(out, report.bag, span)
    topics = [
        ("/joint_states", report.joint_states),
        ("/motor_temperatures", report.temperatures),
        ("/power_meter", report.readings),
        ("/drive_power", report.drive_powers),
        ("/energy/payload", report.payloads),
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
