"""`robot-energy import`: turn logs of robots into bags."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from robot_energy.messages.fields import JOINT_STATES_TOPIC, METER_TOPIC, TEMPERATURES_TOPIC
from robot_energy_cli.command import Command, Group, add_option
from robot_energy_cli.terminal import console, wrote
from robot_energy_logs.log_formats import LOG_FORMATS, LogFormat

if TYPE_CHECKING:
    from robot_energy_logs.recording import ImportReport


def _command(kind: LogFormat) -> Command:
    def options(parser: ArgumentParser) -> None:
        kind.add_arguments(parser)
        add_option(parser, "--out BAG", "folder of the new bag", required=True)
        add_option(parser, "--overwrite", "replace the bag of --out")

    def run(args: Namespace) -> int:
        _print(kind.run(args))
        return 0

    return Command(kind.name, kind.line, run, options, kind.description, kind.epilog)


def _print(report: ImportReport) -> None:
    out = console()
    start, end = report.start_ns or 0, report.end_ns or 0
    rate = (report.joint_states - 1) / ((end - start) * 1e-9)
    span = f"{(end - start) * 1e-9:.3f} s, {rate:.4g} joint states a second on average"
    wrote(out, report.bag, span)
    topics = [
        (JOINT_STATES_TOPIC, report.joint_states),
        (TEMPERATURES_TOPIC, report.temperatures),
        (METER_TOPIC, report.readings),
        ("/drive_power", report.drive_powers),
        ("/energy/payload", report.payloads),
    ]
    for topic, count in topics:
        out.print(f"  {topic:<20} {count or 'none'}")
    for account in report.files:
        reasons = ", ".join(
            f"{count} {reason.replace('_', ' ')} (first at line {account.first_line[reason]}"
            f"{account.offending(reason)})"
            for reason, count in account.rejected.items()
        )
        out.print(
            f"{account.path}: {account.received} rows, {account.accepted} used, "
            f"rejected: {reasons or 'none'}"
        )
    for note in report.notes:
        out.print(f"note: {note}")


COMMAND = Group(
    "import",
    "turn logs (UR RTDE, CSV, Parquet) into bags",
    "Convert logs of robots to bags that replay like others. Rows that "
    "cannot be used are counted by reason and reported.",
    "kinds of logs",
    "KIND",
    lambda: map(_command, LOG_FORMATS.values()),
)
