"""What robots saved against a baseline, and their learned friction, as the page shows both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, JOULE_PER_KWH
from robot_energy_history.api import history_friction
from robot_energy_history.baseline import BAND
from robot_energy_history.savings import DRIVERS, EnergySavings, savings_by_robot
from robot_energy_history.spans import Resolution, rows_of
from robot_energy_history.tariffs import day_begin
from robot_energy_report.page.history_figures import Row
from robot_energy_report.page.history_period import Period, instant, period_at

MAX_DAYS = 1200  # of a baseline, and of the days that are compared with it
MAX_DEVIATIONS = 8  # days that are named
MAX_JOINTS = 60  # rows of learned friction


@dataclass(frozen=True)
class SavingsWish:
    """What days are compared, and what explains their energy.

    Attributes:
        baseline: Begin of its first day and end of its last. [ns]
        reported: The same of the days that are compared: whole ones that are over. [ns]
        measured: Whether the energy is that of the meter.
    """

    baseline: tuple[int, int]
    reported: tuple[int, int]
    drivers: tuple[str, ...]
    measured: bool


def savings_wish(asked: Mapping[str, Sequence[str]], period: Period, now_ns: int) -> SavingsWish:
    """Return what a request asks for."""
    zone = period.zone
    first = {name: values[0] for name, values in asked.items() if values}
    start, stop = (
        period_at("day", instant(first.get(name, ""), zone), zone).start_ns
        for name in ("baseline_start", "baseline_stop")
    )
    today = day_begin(local_time(now_ns, zone).date(), zone)
    reported = period.start_ns, min(period.stop_ns, today)
    if reported[0] >= reported[1] or period.kind == "hour":
        raise HistoryError(f"{period.name}, which has no day that is over", "whole days")
    for begin, end in ((start, stop), reported):
        days = (end - begin) / DAY_NS
        if not 0 < days <= MAX_DAYS:
            raise HistoryError(f"{days:.0f} days", f"1 to {MAX_DAYS} days")
    if stop > reported[0] and start < reported[1]:
        raise HistoryError("a baseline that holds days that are compared with it", "other days")
    drivers = tuple(dict.fromkeys(asked.get("driver", ())))
    if unknown := [name for name in drivers if name not in DRIVERS]:
        raise HistoryError(f"a driver '{unknown[0][:20]}'", ", ".join(DRIVERS))
    return SavingsWish((start, stop), reported, drivers, first.get("measured") == "1")


def savings_answer(
    folder: Path, robots: Sequence[str], period: Period, wish: SavingsWish
) -> dict[str, Any]:
    """Return what robots saved, those with the surest change first; one robot day by day."""
    found, failed = savings_by_robot(
        folder, wish.baseline, wish.reported, wish.drivers, robots, period.zone.key,
        measured=wish.measured,
    )  # fmt: skip
    rows: list[dict[str, Any]] = [{"robot": name, **_total(one)} for name, one in found.items()]
    rows.sort(key=lambda row: -abs(float(row["saved"])) / max(float(row["band"]), 1e-9))
    alone = next(iter(found.values())) if len(found) == 1 and not failed else None
    name = Period("span", *wish.baseline, "day", period.zone).name
    return {
        "baseline": name,
        "drivers": wish.drivers,
        "measured": wish.measured,
        "reported": Period("span", *wish.reported, "day", period.zone).name,
        "rows": rows,
        "left_out": [{"robot": name, "why": str(error)} for name, error in failed.items()],
        "one": None if alone is None else _one(alone, period),
    }


def _total(found: EnergySavings) -> dict[str, Any]:
    trend = found.trend
    return {
        "saved": found.saved * JOULE_PER_KWH,
        "band": found.band * JOULE_PER_KWH,
        "expected": found.expected * JOULE_PER_KWH,
        "claimed": found.claimed,
        "cv_rmse": found.baseline.cv_rmse,
        "per_part": None if trend is None else trend.mean * JOULE_PER_KWH,
        "change": None if trend is None else trend.change,
        "change_band": None if trend is None else trend.band,
    }


def _one(found: EnergySavings, period: Period) -> dict[str, Any]:
    model = found.baseline
    days: list[dict[str, Any]] = []
    for row in rows_of(found):
        own = Period("day", row["stamp_ns"], row["stamp_ns"] + 1, "hour", period.zone)
        energy = {
            name: row[name] * JOULE_PER_KWH for name in ("energy", "expected", "saved", "band")
        }
        per_part = energy["energy"] / row["parts"] if row["parts"] > 0 else None
        deviation = (row["energy"] - row["expected"]) / model.deviation if model.deviation else None
        days.append(
            {"name": own.name, "label": own.at(own.start_ns)[5:10], "zoom": own.plain(), **energy,
             "parts": row["parts"], "per_part": per_part, "deviation": deviation}
        )  # fmt: skip
    halves = model.half_width(BAND) * model.std
    most = sorted(days, key=lambda day: -abs(day["deviation"] or 0.0))[:MAX_DEVIATIONS]
    return {
        "terms": [
            {"name": name, "value": value * JOULE_PER_KWH, "band": half * JOULE_PER_KWH}
            for name, value, half in zip(
                model.names, model.values.tolist(), halves.tolist(), strict=True
            )
        ],
        "baseline_days": model.days,
        "scatter": model.deviation * JOULE_PER_KWH,
        "days": days,
        "deviations": most,
        "notes": list(found.notes),
    }


def friction_answer(folder: Path, robots: Sequence[str], period: Period) -> dict[str, Any]:
    """Return learned friction of each joint over the parts of a period, largest changes first."""
    fine = period.resolution in ("minute", "quarter", "hour")
    parts: Resolution = "day" if fine else period.resolution
    own = Period(period.kind, period.start_ns, period.stop_ns, parts, period.zone)
    bounds = own.bounds
    places = {start: place for place, start in enumerate(bounds[:-1])}
    zone = period.zone.key
    found: dict[tuple[str, str, str], Row] = {}
    for row in rows_of(history_friction(folder, bounds[0], bounds[-1], parts, robots, zone)):
        key = (row["robot"], row["joint"], row["model_id"])
        one = found.setdefault(
            key,
            {"robot": key[0], "joint": key[1], "model": key[2], "days": 0, "first": row["ratio"],
             "values": [None] * len(places)},
        )  # fmt: skip
        one["values"][places[row["stamp_ns"]]] = one["last"] = row["ratio"]
        one["days"] += row["days"]
    rows = sorted(found.values(), key=lambda row: -abs(row["last"] / row["first"] - 1.0))
    return {
        "parts": [{"label": one["label"], "name": one["name"]} for one in own.parts()],
        "rows": rows[:MAX_JOINTS],
        "count": len(rows),
        "resolution": parts,
    }
