"""A history of one month as a document: verdict, days, robots, losses, standby, jobs, terms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.units import JOULE_PER_KWH
from robot_energy_report.canvas import MAX_TICK, PART_COLOURS, SERIES, canvas
from robot_energy_report.document import Column, Document, Tiles
from robot_energy_report.formats import NOTHING, counted, fixed, number, percent, signed_percent
from robot_energy_report.page.energy_flow import PARTS
from robot_energy_report.page.history_view import HistoryView

MEANINGS = {
    "friction": "lost in bearings, gears and seals; falls as they warm up, grows as they wear",
    "drives": "lost in motors and inverters",
    "motion": "into the bodies, less what came back; small over a month",
    "brake": "turned into heat, as nothing else took it",
    "cabinet": "drawn by controller, fans and supplies all the time",
    "capacitor": "left in the DC link",
}
EXPLAINED = (
    ("energy from the grid", "what the models say that the robots drew from the grid"),
    ("at rest", "the energy of the time without motion"),
    ("observed", "time for which joint states came; nothing is known of the rest, and no energy is "
                 "assumed for it"),
    ("change", "compared with the month before; a dash where the observed times differ by more "
               "than 5 %"),
    ("error", "predicted minus measured energy at the meter, over measured"),
    ("cost, CO2", "energy of each quarter of an hour times the price and factor that held then"),
    ("peak", "the highest mean power of a minute"),
)  # fmt: skip
Figures = Mapping[str, Any]


def month_document(
    folder: Path, month: str, now_ns: int, timezone: str = "", robots: Sequence[str] = ()
) -> Document:
    """Return the report of a month such as 2026-10; without it of the last one that is over."""
    view = HistoryView(folder)
    if month and not re.fullmatch(r"\d{4}-(0[1-9]|1[0-2])", month):
        raise HistoryError(f"the month '{shown(month)}'", "one such as 2026-10")
    asked = {"period": ["month"], "robot": [*robots], "timezone": [timezone] if timezone else []}
    asked["at"] = [f"{month}-01"] if month else []
    wish = view.wish(asked, now_ns)
    wish = wish if month else replace(wish, period=wish.period.moved(-1))
    by_robot = view.answer(wish, now_ns)
    total, name = by_robot["total"], by_robot["period"]["name"]
    if total is None:
        raise HistoryError(f"nothing was recorded in {name}", "a month of the history")
    by_part = view.answer(replace(wish, group="part"), now_ns)
    page = Document(
        f"Energy of {counted(len(by_robot['robots']), 'robot')} in {name}",
        f"Days of {by_robot['timezone']}. Energies are predicted by the models of the robots, "
        "unless it says measured. A dash is not known or not recorded.",
    )
    _verdict(page, by_robot)
    _days(page, by_robot)
    _robots(page, by_robot)
    _losses(page, by_part)
    _standby(page, by_robot)
    _jobs(page, by_robot)
    _quality(page, by_robot)
    _tariffs(page, by_robot)
    page.heading("What the figures are")
    page.table("", ("figure", "meaning"), EXPLAINED)
    return page


def _verdict(page: Document, answer: Figures) -> None:
    total, before = answer["total"], answer["before"]["name"]
    currency, running = answer["currency"], answer["running"]
    page.heading("Verdict")
    same: Figures = answer["same"] or {}
    earlier: Figures = answer["earlier"] or {}
    change = _ratio(same.get("energy"), earlier.get("energy")) if answer["fair"] else None
    until = f" up to the same time ({running.replace('T', ' ')[:16]})" if running else ""
    if change is not None:
        against = f"{signed_percent(change)} against {before}{until}"
    elif answer["earlier"] is None:
        against = f"nothing was recorded in {before}{until}"
    else:
        against = f"not compared with {before}: less or more of that time was observed"
    money = f", {number(total['cost'], 2)} {currency}" if "cost" in total else ""
    page.paragraph(f"{_kwh(total['energy'])} kWh from the grid{money}: {against}.", "strong")
    share = total["standby"] / total["energy"] if total["energy"] else None
    resting = [one for one in answer["rests"] if one["cost"]]
    page.paragraph(
        f"Standby took {_kwh(total['standby'])} kWh, {percent(share)} of it"
        + "".join(f"; {number(one['cost'], 2)} {currency} {one['name']}" for one in resting)
        + ".",
    )
    moved = [
        (row["same"] / row["before"] - 1.0, row["robot"])
        for row in answer["robots"]
        if row["fair"] and row["before"] and row["same"] is not None
    ]
    if moved:
        most = max(moved, key=lambda one: abs(one[0]))
        page.paragraph(f"The largest change: {shown(most[1])}, {signed_percent(most[0])}.")
    co2 = f"{number(total['co2'], 1)} kg" if "co2" in total else NOTHING
    cost = f"{number(total['cost'], 2)} {currency}" if "cost" in total else NOTHING
    tiles = (
        ("Energy from the grid", f"{_kwh(total['energy'])} kWh", against),
        ("Cost", cost, "at the tariff of the time of use" if money else "no tariff"),
        ("CO2", co2, "by the factor of the tariff" if "co2" in total else "no factor"),
        ("Standby", f"{_kwh(total['standby'])} kWh", percent(share)),
        ("Observed", f"{number(total['observed'] / 3600.0, 1)} h", _observed(answer)),
    )
    with page.only("page"):
        page.add(Tiles(tiles))


def _days(page: Document, answer: Figures) -> None:
    page.heading("Days")
    page.figure(
        partial(draw_days, answer),
        "Energy from the grid on each day, by robot. A day without a bar was not recorded.",
    )


def _robots(page: Document, answer: Figures) -> None:
    page.heading("Robots")
    columns = [
        Column("robot", "robot"),
        Column("energy", "energy", _kwh, "kWh", total=True),
        Column(
            "change",
            lambda row: _ratio(row["same"], row["before"]) if row["fair"] else None,
            signed_percent,
        ),
        Column("in motion", "motion", _kwh, "kWh", total=True),
        Column("at rest", "hold", _kwh, "kWh", total=True),
        Column("standby", "standby", _kwh, "kWh", total=True),
        Column("friction", "friction", _kwh, "kWh", total=True),
        Column("measured", "measured", _kwh, "kWh"),
        Column("error", lambda row: _ratio(row["at_meter"], row["measured"]), signed_percent),
        Column("peak", "peak", fixed(0), "W"),
        Column("observed", lambda row: row["observed"] / 3600.0, fixed(1), "h", total=True),
    ]
    if answer["currency"]:
        columns.insert(2, Column("cost", "cost", fixed(2), answer["currency"], True))
    rows = sorted(answer["robots"], key=lambda row: -row["energy"])
    page.rows("", columns, rows, "all" if len(rows) > 1 else "")


def _losses(page: Document, answer: Figures) -> None:
    page.heading("Where the energy goes")
    sums = {  # None: 0, or in no model; a history does not hold which
        one["name"]: sum(v for v in one["values"] if v is not None) or None
        for one in answer["series"]
    }
    net = sum(value or 0.0 for value in sums.values())
    page.table(
        "",
        ("part", "kWh", "share", "meaning"),
        [
            (PARTS[name], _kwh(value), percent(value and net and value / net), MEANINGS[name])
            for name, value in sums.items()
        ],
        ("net from the grid", _kwh(net), percent(1.0 if net else None), "less what was fed back"),
    )
    if None in sums.values():
        page.paragraph("A dash: the part is 0, or no model has it.")
    page.figure(partial(draw_days, answer), "The same on each day.")


def _standby(page: Document, answer: Figures) -> None:
    if not answer["rests"]:
        return
    page.heading("Standby while nobody works")
    page.rows(
        "",
        [
            Column("when", "name"),
            Column("standby", "energy", _kwh, "kWh", total=True),
            Column("cost", "cost", fixed(2), answer["currency"], total=True),
        ],
        answer["rests"],
        "together",
    )
    page.paragraph("Drives that are switched off in this time save at most this.")


def _jobs(page: Document, answer: Figures) -> None:
    if not answer["jobs"]:
        return
    page.heading("Jobs that ended")
    page.rows(
        "",
        [
            Column("job", "name"),
            Column("robot", "robot"),
            Column("parts", "count", total=True),
            Column("energy", "energy", _kwh, "kWh", total=True),
            Column("of each", lambda row: row["mean"] / 3600.0, fixed(2), "Wh"),
            Column("change", lambda row: _ratio(row["mean"], row["before"]), signed_percent),
        ],
        answer["jobs"],
    )


def _quality(page: Document, answer: Figures) -> None:
    page.heading("What was not recorded")
    page.paragraph(f"Observed: {_observed(answer)}.")
    for remark in answer["remarks"]:
        page.note(f"Some of the energy: {remark}.")
    if answer["span_count"]:
        page.note(
            f"{_kwh(answer['span_energy'])} kWh were used in "
            f"{counted(answer['span_count'], 'span')} while the recorder was off; they are in no "
            "day above."
        )
    unpriced = answer["total"]["energy"] - answer["total"]["priced"]
    if answer["currency"] and unpriced > 1.0:
        page.note(f"{_kwh(unpriced)} kWh have no cost: no tariff holds, or the time is not known.")
    page.table(
        "Events, the newest first",
        ("when", "robot", "what", "in words"),
        [(one["at"], one["robot"], one["kind"], one["text"]) for one in answer["events"]],
    )


def _tariffs(page: Document, answer: Figures) -> None:
    if not answer["tariffs"]:
        return
    page.heading("Tariffs")
    page.rows(
        "",
        [
            Column("from", "begin"),
            Column("price per kWh", lambda one: _priced(one["price_per_kwh"], one["currency"])),
            Column("other times", lambda one: _times(one["time_of_use"]) or None),
            Column("CO2", "co2_kg_per_kwh", lambda value: f"{value:g}", "kg/kWh"),
            Column("source", lambda one: one["co2_source"] or None),
            Column("time zone", "timezone"),
        ],
        answer["tariffs"],
    )


def draw_days(answer: Figures, target: BytesIO) -> None:
    """Draw stacked bars, one of each day."""
    places = range(1, len(answer["parts"]) + 1)
    with canvas(target, (9.0, 3.4)) as figure:
        axes = figure.subplots()
        up, down = [0.0] * len(places), [0.0] * len(places)
        colours = dict(enumerate(SERIES))
        for order, one in enumerate(answer["series"]):
            values = [(value or 0.0) / JOULE_PER_KWH for value in one["values"]]
            base = [d if v < 0 else u for v, u, d in zip(values, up, down, strict=True)]
            colour = PART_COLOURS.get(one["name"], colours.get(order, "#9a9a9a"))
            name = PARTS[one["name"]] if answer["group"] == "part" else one["name"]
            label = shown(name, MAX_TICK)
            axes.bar(places, values, 0.8, bottom=base, color=colour, label=label)
            up = [u + max(v, 0.0) for u, v in zip(up, values, strict=True)]
            down = [d + min(v, 0.0) for d, v in zip(down, values, strict=True)]
        axes.set_xticks([*places][::2] if len(places) > 16 else [*places])
        axes.set_xlim(0.4, len(places) + 0.6)
        axes.set_xlabel("day")
        axes.set_ylabel("energy [kWh]")
        axes.grid(axis="x", visible=False)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, fontsize=8)


def _kwh(joule: float | None) -> str:
    return NOTHING if joule is None else number(joule / JOULE_PER_KWH, 2)


def _ratio(now: float | None, before: float | None) -> float | None:
    return now / before - 1.0 if now is not None and before else None


def _observed(answer: Figures) -> str:
    """The observed share of all robots, up to now in a month that goes on."""
    period = answer["period"]
    length = min(period["stop"], answer["now"]) - period["start"]
    share = answer["total"]["observed"] / (length * len(answer["robots"])) if length > 0 else None
    return f"{percent(share)} of the time of {counted(len(answer['robots']), 'robot')}"


def _priced(price: float | None, currency: str) -> str:
    return NOTHING if price is None else f"{price:g} {currency}"


def _times(periods: Sequence[Figures]) -> str:
    return ", ".join(
        f"{'' if len(one['days']) == 7 else ' '.join(one['days']) + ' '}"
        f"{one['begin']}-{one['end']} {one['price_per_kwh']:g}"
        for one in periods
    )
