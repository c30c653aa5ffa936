"""The history as the page shows it, as plain values.

One period by robot, part, phase or joint; savings against a baseline, and learned friction.
"""

from __future__ import annotations

import csv
import io
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, JOULE_PER_KWH, SECOND_NS
from robot_energy.timeline.time_series import TimeSeries
from robot_energy_history.api import History, history, history_events, history_friction, job_sums
from robot_energy_history.database import JOB_SUMS, open_reader, reader
from robot_energy_history.differences import SLOT_NS
from robot_energy_history.queries import Resolution, robots_of, rows_of, zone_of
from robot_energy_history.savings import BAND, DRIVERS, EnergySavings, savings_by_robot
from robot_energy_history.tariffs import Tariff, add_tariffs, day_begin, stored_tariffs
from robot_energy_report.page.history_figures import (
    GROUPS,
    IMPORT,
    SPAN,
    Period,
    Row,
    comparable,
    figures_by_robot,
    harmless,
    instant,
    less,
    parts_of,
    period_at,
    remarks_of,
    rests_of,
    series_of,
    span_of,
    summed,
    total_of,
)

MAX_DAYS = 1200  # of a baseline, and of the days that are compared with it
MAX_DEVIATIONS = 8  # days that are named
MAX_JOINTS = 60  # rows of learned friction


def savings_answer(
    folder: Path, wish: Wish, asked: Mapping[str, Sequence[str]], now_ns: int
) -> dict[str, Any]:
    """Return what robots saved, those with the surest change first; one robot day by day.

    Args:
        asked: ``baseline_start``, ``baseline_stop``, ``driver``, several, and ``measured``.
    """
    period, zone = wish.period, wish.period.zone
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
    baseline, measured = (start, stop), first.get("measured") == "1"
    found, failed = savings_by_robot(
        folder, baseline, reported, drivers, wish.robots, zone.key, measured=measured
    )
    rows: list[dict[str, Any]] = [{"robot": name, **_total(one)} for name, one in found.items()]
    rows.sort(key=lambda row: -abs(float(row["saved"])) / max(float(row["band"]), 1e-9))
    alone = next(iter(found.values())) if len(found) == 1 and not failed else None
    return {
        "baseline": Period("span", *baseline, "day", zone).name,
        "drivers": drivers,
        "measured": measured,
        "reported": Period("span", *reported, "day", zone).name,
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


SHOWN_OF_JOBS = ("observed_ns", IMPORT)
MAX_JOBS = 200
MAX_EVENTS = 100
MAX_SPANS = 50  # of those that no part holds


@dataclass(frozen=True)
class Wish:
    """What is asked for."""

    period: Period
    robots: tuple[str, ...] = ()
    group: str = "robot"


class HistoryView:
    """Answers what the page asks of a history; each answer has a connection of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def wish(self, asked: Mapping[str, Sequence[str]], now_ns: int) -> Wish:
        """Return what a request asks for.

        Args:
            asked: ``period`` with ``at``, or ``start`` and ``stop``; ``timezone``, else
                ``fallback`` where no tariff has one; ``robot``, several; ``by``.
        """
        first = {name: values[0] for name, values in asked.items() if values}
        name = first.get("timezone") or self._zone() or first.get("fallback") or "UTC"
        zone = zone_of(name)
        group = first.get("by", "robot")
        if group not in GROUPS:
            raise HistoryError(f"by '{group[:20]}'", ", ".join(GROUPS))
        kind = first.get("period", "day")
        if kind == SPAN:
            start, stop = (instant(first.get(one, ""), zone) for one in ("start", "stop"))
            period = span_of(start, stop, zone)
        else:
            at = first.get("at")
            period = period_at(kind, instant(at, zone) if at else now_ns, zone)
        return Wish(period, tuple(dict.fromkeys(asked.get("robot", ()))), group)

    def answer(self, wish: Wish, now_ns: int) -> dict[str, Any]:
        """Return what the page draws: energies in J, times in s since 1970; None: not recorded."""
        with reader(self.folder) as connection:
            known = list(robots_of(connection))
            robots_of(connection, wish.robots)
        tariffs = stored_tariffs(self.folder)
        emits = any(one.co2_kg_per_kwh is not None for one in tariffs)
        wish, table = self._table(wish)
        bars = rows_of(table)
        if wish.group == "joint":  # they hold neither times nor costs
            table = self._read(replace(wish, group="robot"))
        period, before = wish.period, wish.period.moved(-1)
        by_job = wish.group == "job"
        ended = rows_of(self._ended(wish, period, whole=not by_job))
        bars = ended if by_job else bars
        whole = self._whole(wish, table)
        until = min(period.stop_ns, max(period.start_ns, now_ns // SLOT_NS * SLOT_NS))
        running = until < period.stop_ns
        same = less(whole, self._sums(wish, until, until + SLOT_NS)) if running else whole
        earlier = self._sums(wish, before.start_ns, period.same_part(until))
        rows = figures_by_robot(whole, emits)
        of_same, of_earlier = figures_by_robot(same, emits), figures_by_robot(earlier, emits)
        for name, row in rows.items():
            now, then = of_same.get(name, {}), of_earlier.get(name, {})
            row["same"], row["before"] = now.get("energy"), then.get("energy")
            row["fair"] = comparable(now.get("observed"), then.get("observed"))
        spans = table.not_resolved
        return {
            "known": known,
            "timezone": period.zone.key,
            "period": {**period.plain(), "name": period.name, "resolution": period.resolution,
                       "start": period.start_ns / SECOND_NS, "stop": period.stop_ns / SECOND_NS},
            "before": {**before.plain(), "name": before.name},
            "next": period.moved(1).plain(),
            "now": now_ns / SECOND_NS,
            "running": period.at(until) if running else None,
            "currency": tariffs[-1].currency if tariffs else "",
            "parts": parts_of(period, rows_of(table), len(rows)),
            "series": series_of(period, wish.group, bars, len(wish.robots) == 1),
            "group": wish.group,
            "robots": list(rows.values()),
            "total": total_of(rows.values()),
            "same": total_of(of_same.values()),
            "earlier": total_of(of_earlier.values()),
            "fair": comparable(
                *(sum(row["observed"] for row in one.values()) for one in (of_same, of_earlier))
            ),
            "spans": [
                {"robot": row["robot"], "start": row["stamp_ns"] / SECOND_NS,
                 "stop": row["stop_ns"] / SECOND_NS, "energy": row[IMPORT] / 1e6}
                for row in rows_of(spans)[:MAX_SPANS]
            ],
            "span_count": len(spans),
            "span_energy": sum(spans[IMPORT].tolist()) / 1e6 if len(spans) else 0.0,
            "remarks": remarks_of(whole),
            "rests": rests_of(whole),
            "jobs": self._jobs(wish, ended, before),
            "events": self._events(wish),
            "tariffs": [one.model_dump(mode="json") for one in tariffs],
        }  # fmt: skip

    def shifts(self, wish: Wish) -> dict[str, Any]:
        """Return what all robots used in each shift of a period; no rows without shifts."""
        tariffs, period = stored_tariffs(self.folder), wish.period
        found: dict[str, Row] = {}
        if any(one.shifts for one in tariffs):
            table = history(
                self.folder, period.start_ns, period.stop_ns, "all", wish.robots,
                period.zone.key, by_shift=True,
            )  # fmt: skip
            for row in rows_of(table):
                own = found.setdefault(row["shift"], {"energy": 0.0, "standby": 0.0, "cost": None})
                own["energy"] += row[IMPORT] / 1e6
                own["standby"] += row["standby_microjoule"] / 1e6
                if row["priced_microjoule"]:
                    own["cost"] = (own["cost"] or 0.0) + row["cost"]
        currency = tariffs[-1].currency if tariffs else ""
        rows = [{"shift": name, **found[name]} for name in sorted(found)]
        return {"currency": currency, "rows": rows}

    def csv(self, wish: Wish) -> str:
        """Return the parts of a period as a table, by robot, by joint, or by job.

        Spans that no part holds are rows with ``resolved`` 0.
        """
        wish, parts = self._table(wish)
        by_job = wish.group == "job"
        table = self._ended(wish, wish.period, False, JOB_SUMS) if by_job else parts
        spans = [] if by_job else rows_of(parts.not_resolved)
        names = [name for name in table.to_dict() if name not in ("stamp_ns", "stop_ns")]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["begin", "end", *names, "resolved"])
        for rows, resolved in ((rows_of(table), 1), (spans, 0)):
            for row in rows:
                when = (wish.period.at(row[name]) for name in ("stamp_ns", "stop_ns"))
                values = harmless([row.get(name) for name in names])
                writer.writerow([*when, *values, resolved])
        return text.getvalue()

    def add_tariff(self, tariff: Tariff, now_ns: int) -> str:
        """Return what was done to add a tariff, in a sentence."""
        open_reader(self.folder).close()
        add_tariffs(self.folder, [tariff], now_ns)
        return f"holds from {tariff.begin} on"

    def _zone(self) -> str:
        """Time zone of the newest tariff; empty without one."""
        tariffs = stored_tariffs(self.folder)
        return tariffs[-1].timezone if tariffs else ""

    def _table(self, wish: Wish) -> tuple[Wish, History]:
        """The parts of a period, by quarter hours where its minutes are not kept."""
        table = self._read(wish)
        if wish.period.resolution == "minute" and (wish.group == "joint" or not len(table)):
            wish = replace(wish, period=replace(wish.period, resolution="quarter"))
            table = self._read(wish)
        return wish, table

    def _read(self, wish: Wish) -> History:
        period = wish.period
        by_joint = wish.group == "joint" and period.resolution != "minute"
        return history(
            self.folder, period.start_ns, period.stop_ns, period.resolution, wish.robots,
            period.zone.key, by_joint,
        )  # fmt: skip

    def _whole(self, wish: Wish, table: History) -> list[Row]:
        """Sums of a period by robot: of its parts, unless they lack spans or costs."""
        period = wish.period
        inside = (
            row["stamp_ns"] >= period.start_ns and row["stop_ns"] <= period.stop_ns
            for row in rows_of(table.not_resolved)
        )  # fmt: skip
        if period.resolution == "minute" or any(inside):
            return self._sums(wish, period.start_ns, period.stop_ns)
        return summed(table)

    def _sums(self, wish: Wish, start_ns: int, stop_ns: int) -> list[Row]:
        zone = wish.period.zone.key
        stop_ns = max(stop_ns, start_ns + 1)  # of nothing: nothing
        return rows_of(history(self.folder, start_ns, stop_ns, "all", wish.robots, zone))

    def _ended(
        self, wish: Wish, period: Period, whole: bool, names: Sequence[str] = SHOWN_OF_JOBS
    ) -> TimeSeries:
        bounds = [period.start_ns, period.stop_ns] if whole else period.bounds
        return job_sums(self.folder, bounds, wish.robots, names)

    def _jobs(self, wish: Wish, ended: Sequence[Row], before: Period) -> list[dict[str, Any]]:
        earlier = rows_of(self._ended(wish, before, whole=True))
        means = {(one["robot"], one["job"]): one["microjoule_per_part"] / 1e6 for one in earlier}
        sums: defaultdict[tuple[str, str], Counter[str]] = defaultdict(Counter)
        for one in ended:
            held = sums[one["robot"], one["job"]]
            for name in ("parts", *SHOWN_OF_JOBS):
                held[name] += one[name]
        rows = sorted(sums.items(), key=lambda item: -item[1][IMPORT])
        return [
            {"robot": key[0], "name": key[1], "count": one["parts"],
             "time": one["observed_ns"] / one["parts"] / SECOND_NS, "energy": one[IMPORT] / 1e6,
             "mean": one[IMPORT] / one["parts"] / 1e6, "before": means.get(key)}
            for key, one in rows[:MAX_JOBS]
        ]  # fmt: skip

    def _events(self, wish: Wish) -> list[dict[str, Any]]:
        period = wish.period
        found = history_events(
            self.folder, period.start_ns, period.stop_ns, wish.robots, period.zone.key
        )
        return [
            {"at": period.at(one["stamp_ns"])[:16].replace("T", " "), "robot": one["robot"],
             "kind": one["kind"], "text": one["text"]}
            for one in rows_of(found)[: -MAX_EVENTS - 1 : -1]
        ]  # fmt: skip
