"""`robot-energy history`: energy over years: shown, checked, repaired, priced."""

from __future__ import annotations

import csv
import time
from argparse import Namespace
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time
from robot_energy_cli.command import Command, Group, Options
from robot_energy_cli.history_output import EXAMPLES, EXPORT, REPORT, export, report
from robot_energy_cli.terminal import console

FOLDER: Options = {
    "folder": (
        "folder of the history (default $ROS_HOME/robot_energy/history, in ~/.ros without it)",
        {"nargs": "?", "default": ""},
    )
}
SHOW: Options = {
    **FOLDER,
    "--timezone NAME": ("where days begin, such as Europe/Berlin", {"default": "UTC"}),
    "--robots NAMES": "which robots, separated by commas (default: all)",
    "--start DAY": "first day, such as 2026-10-01, in place of today, this week and this month",
    "--stop DAY": "the day after the last (default: tomorrow)",
    "--resolution": (
        "time that one row covers, where --start is given",
        {"choices": ("hour", "day", "week", "month", "year", "all"), "default": "day"},
    ),
}
SAVINGS: Options = {
    **FOLDER,
    "--robot NAME": ("the robot", {"required": True}),
    "--baseline DAYS": (
        "first day of the baseline and the day after its last, such as 2026-03-01:2026-05-01",
        {"required": True},
    ),
    "--reported DAYS": ("the same for the days that are compared with it", {"required": True}),
    "--drivers NAMES": (
        "what explains energy, separated by commas: parts, motion_hours, on_hours",
        {"default": "parts"},
    ),
    "--further FILE": "CSV table with a column date and more that explains energy, such as "
    "the temperature",
    "--measured": (
        "the energy of the meter, in place of that of the model",
        {"action": "store_true"},
    ),
    "--timezone NAME": SHOW["--timezone NAME"],
}
KWH = 3.6e12  # [uJ]
HOUR = 3.6e12  # [ns]
MAX_EVENTS = 50  # that are shown


def _folder(args: Namespace) -> Path:
    from robot_energy_history.files import default_folder

    return Path(args.folder).expanduser() if args.folder else default_folder()


def _show(args: Namespace) -> int:
    from robot_energy_history.queries import zone_of
    from robot_energy_report.document import Document
    from robot_energy_report.printing import print_document

    zone = zone_of(args.timezone)
    today = datetime.now(zone).date()
    page, stop = Document(), args.stop or str(today + timedelta(days=1))
    if args.start:
        _tables(args, page, f"From {args.start} to {stop}", args.start, stop, args.resolution)
    else:
        monday = today - timedelta(days=today.weekday())
        for title, start in (
            ("Today", today),
            ("This week", monday),
            ("This month", today.replace(day=1)),
        ):
            _tables(args, page, title, str(start), stop, "all")
    print_document(page, console())
    return 0


def _tables(args: Namespace, page: Any, title: str, start: str, stop: str, resolution: Any) -> None:
    from robot_energy_history.api import history, history_events, history_jobs
    from robot_energy_history.queries import rows_of
    from robot_energy_report.document import Column
    from robot_energy_report.formats import counted, fixed

    names: list[str] = args.robots.split(",") if args.robots else []
    found = history(_folder(args), start, stop, resolution, names, args.timezone)
    rows = rows_of(found)
    zone = ZoneInfo(args.timezone)

    def local(stamp_ns: int) -> str:
        return f"{local_time(stamp_ns, zone):%F %R}"

    page.heading(title)
    if not rows:
        page.paragraph("nothing was recorded in this time")
    else:
        when = [] if resolution == "all" else [Column("from", lambda row: local(row["stamp_ns"]))]
        money = [Column("cost", "cost", fixed(2), found.currency)] if found.currency else []
        columns = [
            Column("robot", "robot"),
            *when,
            *(
                Column(name, f"{key}_microjoule", _kwh, "kWh")
                for name, key in (
                    ("from the grid", "predicted_import"),
                    ("motion", "motion"),
                    ("at rest", "hold"),
                    ("standby", "standby"),
                    ("friction", "friction"),
                    ("measured", "measured"),
                )
            ),
            Column("observed", "observed_ns", lambda value: f"{value / HOUR:.2f}", "h"),
            *money,
        ]
        page.rows("Energy by robot", columns, rows)
    if found.currency and rows and resolution == "all":
        _standby(page, rows, found.currency)
        _shifts(args, page, start, stop, names, found.currency)
    asked = (_folder(args), start, stop)
    if resolution == "all" and rows:
        ended = rows_of(history_jobs(*asked, "all", names, args.timezone))
        columns = [
            Column("job", "job"),
            Column("robot", "robot"),
            Column("parts", "parts"),
            Column("energy", "predicted_import_microjoule", _kwh, "kWh"),
            Column("of each", "microjoule_per_part", _kwh, "kWh"),
        ]
        page.rows("Jobs that ended", columns, ended)
    if args.start:
        _friction(args, page, asked, names)
        known = rows_of(history_events(*asked, names, args.timezone))
        columns = [
            Column("when", lambda row: local(row["stamp_ns"])),
            Column("robot", "robot"),
            Column("what", "kind"),
            Column("in words", "text"),
        ]
        page.rows(f"Events, the last {MAX_EVENTS} at most", columns, known[-MAX_EVENTS:])
    spans = found.not_resolved
    if len(spans):
        used = int(spans["predicted_import_microjoule"].sum()) / KWH
        page.note(
            f"{used:.4f} kWh more were used in {counted(len(spans), 'span')} while the recorder "
            f"was off, the last until {local(int(spans['stop_ns'].max()))}; they are in no row"
        )
    unpriced = sum(r["predicted_import_microjoule"] - r.get("priced_microjoule", 0) for r in rows)
    if found.currency and unpriced:
        page.note(f"{unpriced / KWH:.4f} kWh have no cost: when they were used is not known, or no "
                  "tariff holds")  # fmt: skip


def _friction(args: Namespace, page: Any, asked: tuple[Path, str, str], names: list[str]) -> None:
    from robot_energy_history.api import history_friction
    from robot_energy_history.queries import rows_of
    from robot_energy_report.document import Column
    from robot_energy_report.formats import fixed

    found = rows_of(history_friction(*asked, "month", names, args.timezone))
    zone = ZoneInfo(args.timezone)
    columns = [
        Column("month", lambda row: f"{local_time(row['stamp_ns'], zone):%Y-%m}"),
        *(Column(name, name) for name in ("robot", "joint")),
        Column("over the model file", "ratio", fixed(3)),
        Column("days", "days"),
        Column("model file", lambda row: row["model_id"][:8]),
    ]
    page.rows("Learned friction", columns, found)


def _standby(page: Any, rows: list[dict[str, Any]], currency: str) -> None:
    from robot_energy_history.use import RESTS
    from robot_energy_report.document import Column
    from robot_energy_report.formats import fixed

    idle = [row for row in rows if any(row[f"standby_{rest}_microjoule"] for rest in RESTS)]
    columns = [Column("robot", "robot")]
    for rest in RESTS:
        place = f"at {rest}" if rest == "night" else f"at the {rest}"
        columns += [
            Column(place, f"standby_{rest}_microjoule", _kwh, "kWh"),
            Column("cost", f"standby_{rest}_cost", fixed(2), currency),
        ]
    page.rows("Standby while nobody worked", columns, idle)


def _shifts(
    args: Namespace, page: Any, start: str, stop: str, names: list[str], currency: str
) -> None:
    from robot_energy_history.api import history
    from robot_energy_history.queries import rows_of
    from robot_energy_history.tariffs import stored_tariffs
    from robot_energy_report.document import Column
    from robot_energy_report.formats import fixed

    if not any(one.shifts for one in stored_tariffs(_folder(args))):
        return
    found = history(_folder(args), start, stop, "all", names, args.timezone, by_shift=True)
    columns = [
        Column("shift from", "shift"),
        Column("robot", "robot"),
        Column("from the grid", "predicted_import_microjoule", _kwh, "kWh"),
        Column("standby", "standby_microjoule", _kwh, "kWh"),
        Column("cost", "cost", fixed(2), currency),
    ]
    page.rows("Energy by shift", columns, rows_of(found))


def _kwh(microjoule: float) -> str:
    return f"{microjoule / KWH:.4f}"


def _savings(args: Namespace) -> int:
    from robot_energy_history.queries import rows_of
    from robot_energy_history.savings import history_savings
    from robot_energy_report.document import Column, Document
    from robot_energy_report.formats import fixed
    from robot_energy_report.printing import print_document

    found = history_savings(
        _folder(args), args.robot, _span(args.baseline), _span(args.reported),
        args.drivers.split(","), args.timezone, _further(args.further), args.measured,
    )  # fmt: skip
    model, page = found.baseline, Document()
    page.heading(f"Savings of {args.robot}")
    page.paragraph(
        f"saved {found.saved:.3f} +-{found.band:.3f} kWh of {found.expected:.3f} kWh expected "
        f"({found.saved / found.expected:.1%} +-{found.band / found.expected:.1%}, 90 % band): "
        + ("a saving" if found.claimed else "not certain to be a saving")
    )
    page.rows(
        f"Baseline of {model.days} days, CV(RMSE) {model.cv_rmse:.1%}",
        [
            Column("explained by", 0),
            Column("kWh of each", 1, fixed(4)),
            Column("+-", 2, fixed(4)),
        ],
        list(zip(model.names, model.values, model.std * model.half_width(0.9), strict=True)),
    )
    zone, rows = ZoneInfo(args.timezone), rows_of(found)
    weekly = [*rows[6:-1:7], *rows[-1:]]
    page.rows(
        "Saved up to the end of each seventh day",
        [
            Column("day", lambda row: f"{local_time(row['stamp_ns'], zone):%F}"),
            Column("saved", "saved", fixed(3), "kWh"),
            Column("+-", "band", fixed(3), "kWh"),
        ],
        weekly,
    )
    for note in found.notes:
        page.note(note)
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

    said = repair(_folder(args), time.time_ns())
    for one in said or ["nothing was wrong"]:
        console().print(one)
    return 0


def _tariff(args: Namespace) -> int:
    from robot_energy_history.tariffs import add_tariffs, load_tariffs, stored_tariffs

    folder = _folder(args)
    if args.add:
        add_tariffs(folder, load_tariffs(args.add), time.time_ns())
    known = stored_tariffs(folder)
    for one in known:
        begin = local_time(one.begin_ns)
        price = "no price" if one.price_per_kwh is None else f"{one.price_per_kwh:g} {one.currency}"
        console().print(
            f"from {one.begin} ({begin:%F %R} UTC), {one.timezone}: {price} per kWh, "
            f"{len(one.time_of_use)} times of use, "
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
    "what",
    "WHAT",
    lambda: (
        Command(
            "export",
            "export it for other databases: CSV, Parquet, line protocol, SQL, OpenMetrics",
            lambda args: export(args, _folder(args)),
            {**FOLDER, **EXPORT},
            epilog=EXAMPLES,
        ),
        Command(
            "report",
            "a month as one page: verdict, days, robots, losses, standby, jobs",
            lambda args: report(args, _folder(args)),
            {**FOLDER, **REPORT},
        ),
        Command(
            "show", "what robots and jobs used: today, this week, this month", _show, SHOW
        ),
        Command("savings", "what a robot saved against earlier days, with its band", _savings,
                SAVINGS),
        Command(
            "check", "check that its sums equal the registers, to the microjoule", _check, FOLDER
        ),
        Command(
            "repair",
            "keep what can be read of a damaged history, and correct its sums",
            _repair,
            FOLDER,
        ),
        Command(
            "tariff",
            "show or add prices, CO2 factors and shifts, each valid from a day on",
            _tariff,
            {**FOLDER, "--add FILE": "tariffs to add, also while the recorder runs"},
        ),
    ),
)  # fmt: skip
