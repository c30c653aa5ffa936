"""What `history show` and `history savings` print: tables of a time, and a robot against before."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from zoneinfo import ZoneInfo

from robot_energy.foundation.time_zone import local_time
from robot_energy_history.api import (
    history,
    history_events,
    history_friction,
    history_jobs,
)
from robot_energy_history.queries import Resolution, rows_of
from robot_energy_history.savings import BAND, EnergySavings
from robot_energy_history.tariffs import MICROJOULE_PER_KWH, stored_tariffs
from robot_energy_history.use import RESTS
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import counted, fixed

HOUR = 3.6e12  # [ns]
MAX_EVENTS = 50  # that are shown
ENERGIES = {
    "from the grid": "predicted_import",
    "motion": "motion",
    "at rest": "hold",
    "standby": "standby",
    "friction": "friction",
    "measured": "measured",
}


def time_section(
    page: Document,
    title: str,
    folder: Path,
    span: tuple[str, str],
    resolution: Resolution,
    robots: Sequence[str],
    zone: ZoneInfo,
    details: bool,
) -> None:
    """Add what robots used in a time; with details events and learned friction of it."""

    def local(stamp_ns: int, form: str = "%F %R") -> str:
        return f"{local_time(stamp_ns, zone):{form}}"

    asked, within, whole = (folder, *span), (robots, zone.key), resolution == "all"
    found = history(*asked, resolution, *within)
    rows, cost = rows_of(found), Column("cost", "cost", fixed(2), found.currency)
    robot = Column("robot", "robot")
    used = Column("from the grid", "predicted_import_microjoule", _kwh, "kWh")
    standby = Column("standby", "standby_microjoule", _kwh, "kWh")
    page.heading(title)
    if not rows:
        page.paragraph("nothing was recorded in this time")
    columns = [
        robot,
        *([] if whole else [Column("from", lambda row: local(row["stamp_ns"]))]),
        *(Column(name, f"{key}_microjoule", _kwh, "kWh") for name, key in ENERGIES.items()),
        Column("observed", lambda row: row["observed_ns"] / HOUR, fixed(2), "h"),
        *([cost] if found.currency else []),
    ]
    page.rows("Energy by robot", columns, rows)
    if found.currency and rows and whole:
        columns = [robot]
        for rest in RESTS:
            place = f"at {rest}" if rest == "night" else f"at the {rest}"
            columns += [
                Column(place, f"standby_{rest}_microjoule", _kwh, "kWh"),
                Column("cost", f"standby_{rest}_cost", fixed(2), found.currency),
            ]
        idle = [row for row in rows if any(row[f"standby_{rest}_microjoule"] for rest in RESTS)]
        page.rows("Standby while nobody worked", columns, idle)
        if any(one.shifts for one in stored_tariffs(folder)):
            shifts = rows_of(history(*asked, "all", *within, by_shift=True))
            columns = [Column("shift from", "shift"), robot, used, standby, cost]
            page.rows("Energy by shift", columns, shifts)
    if whole and rows:
        columns = [
            Column("job", "job"),
            robot,
            Column("parts", "parts"),
            Column("energy", "predicted_import_microjoule", _kwh, "kWh"),
            Column("of each", "microjoule_per_part", _kwh, "kWh"),
        ]
        page.rows("Jobs that ended", columns, rows_of(history_jobs(*asked, "all", *within)))
    if details:
        columns = [
            Column("month", lambda row: local(row["stamp_ns"], "%Y-%m")),
            robot,
            Column("joint", "joint"),
            Column("over the model file", "ratio", fixed(3)),
            Column("days", "days"),
            Column("model file", lambda row: row["model_id"][:8]),
        ]
        page.rows("Learned friction", columns, rows_of(history_friction(*asked, "month", *within)))
        columns = [
            Column("when", lambda row: local(row["stamp_ns"])),
            robot,
            Column("what", "kind"),
            Column("in words", "text"),
        ]
        known = rows_of(history_events(*asked, *within))[-MAX_EVENTS:]
        page.rows(f"Events, the last {MAX_EVENTS} at most", columns, known)
    spans = found.not_resolved
    if len(spans):
        page.note(
            f"{_kwh(spans['predicted_import_microjoule'].sum())} kWh more were used in "
            f"{counted(len(spans), 'span')} while the recorder was off, the last until "
            f"{local(int(spans['stop_ns'].max()))}; they are in no row"
        )
    unpriced = sum(r["predicted_import_microjoule"] - r.get("priced_microjoule", 0) for r in rows)
    if found.currency and unpriced:
        page.note(
            f"{_kwh(unpriced)} kWh have no cost: when they were used is not known, or no tariff "
            "holds"
        )


def _kwh(microjoule: float) -> str:
    return f"{microjoule / MICROJOULE_PER_KWH:.4f}"


def savings_section(page: Document, robot: str, found: EnergySavings, zone: ZoneInfo) -> None:
    """Add what a robot saved against a baseline."""
    model, rows = found.baseline, rows_of(found)
    page.heading(f"Savings of {robot}")
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
        list(zip(model.names, model.values, model.std * model.half_width(BAND), strict=True)),
    )
    page.rows(
        "Saved up to the end of each seventh day",
        [
            Column("day", lambda row: f"{local_time(row['stamp_ns'], zone):%F}"),
            Column("saved", "saved", fixed(3), "kWh"),
            Column("+-", "band", fixed(3), "kWh"),
        ],
        [*rows[6:-1:7], *rows[-1:]],
    )
    page.notes(found.notes)
