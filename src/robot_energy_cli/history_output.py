"""`robot-energy history export` and `report`: the history for other programs, and as a page."""

from __future__ import annotations

import time
from argparse import Namespace
from datetime import date, datetime, timedelta
from pathlib import Path

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
from robot_energy_cli.command import Options
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
EXAMPLES = """\
examples:
  robot-energy history export --out days.csv --resolution day --start 2026-10-01
  robot-energy history export --format line --out - | curl --data-binary @- "$INFLUX_URL"
  robot-energy history export --format sql --out - | psql -q -v ON_ERROR_STOP=1 plant
"""
RESOLUTIONS = ("minute", "quarter", "hour", "day", "month")
EXPORT: Options = {
    "--out FILE": (
        f"{', '.join(end for end, _ in KINDS.values())} by its name; - for standard output",
        {"required": True},
    ),
    "--format": ("of the standard output, or of any name", {"choices": (*KINDS,), "default": ""}),
    "--resolution": (
        f"time that one row covers: {', '.join(RESOLUTIONS)} (default: quarter)",
        {"metavar": "NAME", "choices": RESOLUTIONS, "default": "quarter"},
    ),
    "--start DAY": f"first day (default: {DAYS_AGAIN} days before the stop)",
    "--stop DAY": "the day after the last (default: today, so that all days are over)",
    "--timezone NAME": ("where days begin, such as Europe/Berlin", {"default": "UTC"}),
    "--robots NAMES": "which robots, separated by commas (default: all)",
}


REPORT: Options = {
    "--out FILE": (
        "the report: .html, or .pdf where a Chromium is installed",
        {"required": True},
    ),
    "--month MONTH": ("such as 2026-10 (default: the last one that is over)", {"default": ""}),
    "--timezone NAME": (
        "where days begin (default: that of the newest tariff, else UTC)",
        {"default": ""},
    ),
    "--robots NAMES": "which robots, separated by commas (default: all)",
}


def report(args: Namespace, folder: Path) -> int:
    """Return the exit code of writing the report of a month."""
    from robot_energy_report.history_month import month_document
    from robot_energy_report.html import write_page

    check_report(args.out, [str(folder)])
    robots = tuple(args.robots.split(",")) if args.robots else ()
    page = month_document(folder, args.month, time.time_ns(), args.timezone, robots)
    sign(args, page)
    write_page(page, args.out)
    wrote(console(), args.out, page.title)
    return 0


def export(args: Namespace, folder: Path) -> int:
    """Return the exit code of writing the rows of a time for another program."""
    from robot_energy_history.outputs import WRITERS, Wanted
    from robot_energy_history.queries import zone_of
    from robot_energy_history.tariffs import day_begin

    suffix = Path(args.out).suffix.lower()
    kind = args.format or next((one for one, (end, _) in KINDS.items() if end == suffix), "")
    if not kind:
        ends = ", ".join(end for end, _ in KINDS.values())
        raise ReportError(
            f"'{shown(args.out)}' has no known format", f"a name that ends in {ends}",
            "or name it: --format line",
        )  # fmt: skip
    if kind == "parquet" and args.out == STANDARD_OUTPUT:
        raise ReportError("Parquet to the standard output", "a file")
    check_file(args.out, KINDS[kind][1], WHAT, [folder])
    zone = zone_of(args.timezone)
    stop = day_of(args.stop) if args.stop else datetime.now(zone).date()
    start = day_of(args.start) if args.start else stop - timedelta(days=DAYS_AGAIN)
    wanted = Wanted(
        folder, day_begin(start, zone), min(day_begin(stop, zone), time.time_ns()),
        args.resolution,
        tuple(args.robots.split(",")) if args.robots else (), args.timezone,
    )  # fmt: skip
    data = WRITERS[kind](wanted)
    write_file(args.out, data, KINDS[kind][1], WHAT)
    if args.out != STANDARD_OUTPUT:
        wrote(console(), args.out, f"{kind}, from {start} to {stop}, {len(data)} bytes")
    return 0


def day_of(text: str) -> date:
    """Return a day that was typed."""
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise HistoryError(f"the day '{shown(text)}'", "one such as 2026-10-01") from None
