"""`robot-energy fleet report`: energy and condition of a fleet.

Report on the dataset of a fleet: energy of robots, programmes and shifts, standby and its cost,
the error of the model by temperature, friction over temperature and time, and robots that
differ from their sisters at equal temperature or have changed: wear, a wrong payload, standby;
with how sure that is.

examples:
  robot-energy fleet report dataset
  robot-energy fleet report dataset --html fleet.html --page-settings prices.yaml
  robot-energy fleet report dataset --json report.json
"""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace

from robot_energy_cli.command import Command, Options
from robot_energy_cli.replay_arguments import PAGE_SETTINGS
from robot_energy_cli.terminal import JSON_OPTION, check_outputs, present


def _hours(text: str) -> tuple[int, ...]:
    try:
        hours = tuple(int(part) for part in text.split(","))
    except ValueError:
        hours = ()
    if not hours or list(hours) != sorted(set(hours)) or not 0 <= hours[0] <= hours[-1] <= 23:
        raise ArgumentTypeError(f"'{text[:40]}' is not a rising list of hours such as 6,14,22")
    return hours


def _run(args: Namespace) -> int:
    from robot_energy_fleet.dataset import read_tables
    from robot_energy_fleet.report import fleet_report
    from robot_energy_report.formats import counted
    from robot_energy_report.page.settings import load_settings

    check_outputs(args, [args.dataset, args.page_settings])
    settings = load_settings(args.page_settings or "")
    report = fleet_report(read_tables(args.dataset), args.dataset, settings, args.shifts)
    present(args, report, f"Fleet: {counted(len(report.robots), 'robot')}", settings=settings)
    return 0


OPTIONS: Options = {
    "dataset": "folder that `fleet run` wrote",
    "--html/--report FILE": (
        "the report as one page: .html, or .pdf where a Chromium is installed",
        {"dest": "report"},
    ),
    **JSON_OPTION,
    "--shifts H,H,...": (
        "hours of the day, local time, at which shifts begin (default 6,14,22)",
        {"type": _hours, "default": (6, 14, 22)},
    ),
    **PAGE_SETTINGS,
}
COMMAND = Command.of(__doc__, _run, OPTIONS)
