"""`robot-energy history`: energy over years: shown, reported, exported, checked, priced."""

from __future__ import annotations

import csv
import time
from argparse import Namespace
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import HistoryError, ReportError
from robot_energy.foundation.files.output_files import (
    MARKED_CSV,
    METRICS,
    PARQUET,
    SQL,
    STANDARD_OUTPUT,
    TEXT,
    FileKind,
    check_file,
    write_file,
)
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.time_zone import local_time
from robot_energy_cli.command import REQUIRED, Command, Group, Options
from robot_energy_cli.terminal import check_report, console, sign, wrote

WHAT = "the rows of the history"
DAYS_AGAIN = 3  # that are written again by default, as late messages may have changed them
KINDS: dict[str, tuple[str, tuple[FileKind, ...]]] = {
    "csv": (".csv", MARKED_CSV),
    "parquet": (".parquet", PARQUET),
    "line": (".lp", TEXT),
    "sql": (".sql", SQL),
    "openmetrics": (".om", METRICS),
}
ENDS = ", ".join(end for end, _ in KINDS.values())
EXAMPLES = """\
examples:
  robot-energy history export --out days.csv --resolution day --start 2026-10-01
  robot-energy history export --format line --out - | curl --data-binary @- "$INFLUX_URL"
  robot-energy history export --format sql --out - | psql -q -v ON_ERROR_STOP=1 plant
"""
RESOLUTIONS = ("minute", "quarter", "hour", "day", "month")
FOLDER: Options = {
    "folder": (
        "folder of the history (default $ROS_HOME/robot_energy/history, in ~/.ros without it)",
        {"nargs": "?", "default": ""},
    )
}
ZONE: Options = {
    "--timezone NAME": ("where days begin, such as Europe/Berlin", {"default": "UTC"}),
}
ROBOTS: Options = {"--robots NAMES": "which robots, separated by commas (default: all)"}
EXPORT: Options = {
    **FOLDER,
    "--out FILE": (f"{ENDS} by its name; - for standard output", REQUIRED),
    "--format": ("of the standard output, or of any name", {"choices": (*KINDS,), "default": ""}),
    "--resolution": (
        f"time that one row covers: {', '.join(RESOLUTIONS)} (default: quarter)",
        {"metavar": "NAME", "choices": RESOLUTIONS, "default": "quarter"},
    ),
    "--start DAY": f"first day (default: {DAYS_AGAIN} days before the stop)",
    "--stop DAY": "the day after the last (default: today, so that all days are over)",
    **ZONE,
    **ROBOTS,
}
REPORT: Options = {
    **FOLDER,
    "--out FILE": ("the report: .html, or .pdf where a Chromium is installed", REQUIRED),
    "--month MONTH": ("such as 2026-10 (default: the last one that is over)", {"default": ""}),
    "--timezone NAME": (
        "where days begin (default: that of the newest tariff, else UTC)",
        {"default": ""},
    ),
    **ROBOTS,
}
SHOW: Options = {
    **FOLDER,
    **ZONE,
    **ROBOTS,
    "--start DAY": "first day, such as 2026-10-01, in place of today, this week and this month",
    "--stop DAY": "the day after the last (default: tomorrow)",
    "--resolution": (
        "time that one row covers, where --start is given",
        {"choices": ("hour", "day", "week", "month", "year", "all"), "default": "day"},
    ),
}
SAVINGS: Options = {
    **FOLDER,
    "--robot NAME": ("the robot", REQUIRED),
    "--baseline DAYS": (
        "first day of the baseline and the day after its last, such as 2026-03-01:2026-05-01",
        REQUIRED,
    ),
    "--reported DAYS": ("the same for the days that are compared with it", REQUIRED),
    "--drivers NAMES": (
        "what explains energy, separated by commas: parts, motion_hours, on_hours",
        {"default": "parts"},
    ),
    "--further FILE": "CSV table with a column date and more that explains energy, such as "
    "the temperature",
    "--measured": "the energy of the meter, in place of that of the model",
    **ZONE,
}


def _folder(args: Namespace) -> Path:
    from robot_energy_history.database import default_folder

    return Path(args.folder).expanduser() if args.folder else default_folder()


def _robots(args: Namespace) -> tuple[str, ...]:
    return tuple(args.robots.split(",")) if args.robots else ()


def _export(args: Namespace) -> int:
    from robot_energy_history.outputs import WRITERS, Wanted
    from robot_energy_history.queries import zone_of
    from robot_energy_history.tariffs import day_begin

    folder, suffix = _folder(args), Path(args.out).suffix.lower()
    kind = args.format or next((one for one, (end, _) in KINDS.items() if end == suffix), "")
    if not kind:
        raise ReportError(
            f"'{shown(args.out)}' has no known format", f"a name that ends in {ENDS}",
            "or name it: --format line",
        )  # fmt: skip
    if kind == "parquet" and args.out == STANDARD_OUTPUT:
        raise ReportError("Parquet to the standard output", "a file")
    check_file(args.out, KINDS[kind][1], WHAT, [folder])
    zone = zone_of(args.timezone)
    stop = _day(args.stop) if args.stop else datetime.now(zone).date()
    start = _day(args.start) if args.start else stop - timedelta(days=DAYS_AGAIN)
    wanted = Wanted(
        folder, day_begin(start, zone), min(day_begin(stop, zone), time.time_ns()),
        args.resolution, _robots(args), args.timezone,
    )  # fmt: skip
    data = WRITERS[kind](wanted)
    write_file(args.out, data, KINDS[kind][1], WHAT)
    if args.out != STANDARD_OUTPUT:
        wrote(console(), args.out, f"{kind}, from {start} to {stop}, {len(data)} bytes")
    return 0


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise HistoryError(f"the day '{shown(text)}'", "one such as 2026-10-01") from None


def _report(args: Namespace) -> int:
    from robot_energy_report.history_month import month_document
    from robot_energy_report.html import write_page

    folder = _folder(args)
    check_report(args.out, [str(folder)])
    page = month_document(folder, args.month, time.time_ns(), args.timezone, _robots(args))
    sign(args, page)
    write_page(page, args.out)
    wrote(console(), args.out, page.title)
    return 0


def _show(args: Namespace) -> int:
    from robot_energy_history.queries import zone_of
    from robot_energy_report.document import Document
    from robot_energy_report.history_tables import time_section
    from robot_energy_report.printing import print_document

    zone = zone_of(args.timezone)
    today = datetime.now(zone).date()
    page, stop = Document(), args.stop or str(today + timedelta(days=1))
    times = {f"From {args.start} to {stop}": args.start}
    if not args.start:
        monday, first = today - timedelta(days=today.weekday()), today.replace(day=1)
        times = {"Today": today, "This week": monday, "This month": first}
    resolution: Any = args.resolution if args.start else "all"
    for title, start in times.items():
        span = (str(start), stop)
        time_section(
            page, title, _folder(args), span, resolution, _robots(args), zone, bool(args.start)
        )
    print_document(page, console())
    return 0


def _savings(args: Namespace) -> int:
    from robot_energy_history.queries import zone_of
    from robot_energy_history.savings import history_savings
    from robot_energy_report.document import Document
    from robot_energy_report.history_tables import savings_section
    from robot_energy_report.printing import print_document

    zone, page = zone_of(args.timezone), Document()
    found = history_savings(
        _folder(args), args.robot, _span(args.baseline), _span(args.reported),
        args.drivers.split(","), args.timezone, _further(args.further), args.measured,
    )  # fmt: skip
    savings_section(page, args.robot, found, zone)
    print_document(page, console())
    return 0


def _span(text: str) -> tuple[str, str]:
    first, _, last = text.partition(":")
    if not last:
        raise HistoryError(f"days '{text}'", "two days, such as 2026-03-01:2026-05-01")
    return first, last


def _further(path: str | None) -> dict[str, dict[date, float]]:
    found: dict[str, dict[date, float]] = {}
    if path is None:
        return found
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                day = date.fromisoformat(row.pop("date"))
                for name, text in row.items():
                    if text:
                        found.setdefault(name, {})[day] = float(text)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise HistoryError(
            f"{path} cannot be read ({error})", "CSV: date,ambient and rows such as 2026-03-01,21.5"
        ) from error
    return found


def _check(args: Namespace) -> int:
    from robot_energy_history.check import check

    folder = _folder(args)
    found = check(folder)
    if found:
        raise HistoryError(
            f"{folder}: {'; '.join(found[:3])}", "slots that add up to the registers",
            f"robot-energy history repair {folder}",
        )  # fmt: skip
    console().print(f"{folder}: the sums of all slots equal the registers, to the microjoule")
    return 0


def _repair(args: Namespace) -> int:
    from robot_energy_history.check import repair

    for one in repair(_folder(args), time.time_ns()) or ["nothing was wrong"]:
        console().print(one)
    return 0


def _tariff(args: Namespace) -> int:
    from robot_energy_history.tariffs import add_tariffs, load_tariffs, stored_tariffs
    from robot_energy_report.formats import counted

    folder = _folder(args)
    if args.add:
        add_tariffs(folder, load_tariffs(args.add), time.time_ns())
    known = stored_tariffs(folder)
    for one in known:
        begin = local_time(one.begin_ns)
        price = "no price" if one.price_per_kwh is None else f"{one.price_per_kwh:g} {one.currency}"
        console().print(
            f"from {one.begin} ({begin:%F %R} UTC), {one.timezone}: {price} per kWh, "
            f"{counted(len(one.time_of_use), 'time of use', 'times of use')}, "
            + (f"shifts from {', '.join(one.shifts)}, " if one.shifts else "")
            + ("no CO2 factor" if one.co2_kg_per_kwh is None else f"{one.co2_kg_per_kwh:g} kg/kWh")
        )
    if not known:
        console().print("no tariff: --add FILE adds some, as src/doc/howto_history.md shows")
    return 0


COMMAND = Group(
    "history",
    "energy over years, as energy_recorder writes it",
    "Energy over years, as energy_recorder writes it.",
    "actions",
    "ACTION",
    lambda: (
        Command("export",
                "the history for other databases: CSV, Parquet, line protocol, SQL, OpenMetrics",
                _export, EXPORT, epilog=EXAMPLES),
        Command("report", "a month as one page: verdict, days, robots, losses, standby, jobs",
                _report, REPORT),
        Command("show", "what robots and jobs used: today, this week, this month", _show, SHOW),
        Command("savings", "what a robot saved against earlier days, with its band", _savings,
                SAVINGS),
        Command("check", "check that its sums equal the registers, to the microjoule", _check,
                FOLDER),
        Command("repair", "keep what can be read of a damaged history, and correct its sums",
                _repair, FOLDER),
        Command("tariff", "show or add prices, CO2 factors and shifts, each valid from a day on",
                _tariff,
                {**FOLDER, "--add FILE": "tariffs to add, also while the recorder runs"}),
    ),
)  # fmt: skip
