"""The history as the page shows it: one period by robot, part, phase or joint, as plain values."""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.history.api import History, history, history_events, history_jobs
from robot_energy.history.differences import FLAGS, SLOT_NS, UNRESOLVED
from robot_energy.history.files import open_reader
from robot_energy.history.spans import robots_of
from robot_energy.history.tariffs import Tariff, add_tariffs, stored_tariffs
from robot_energy.timeline.time_series import TimeSeries
from robot_energy_report.page.history_period import (
    SPAN,
    Period,
    instant,
    period_at,
    span_of,
    zone_of,
)

MAX_SERIES = 8  # bars of one part of the time; further robots or joints are summed up
ALIKE = 0.05  # by which observed times of two periods may differ to be compared
MAX_JOBS = 200
MAX_EVENTS = 100
MAX_SPANS = 50  # of those that no part holds
IMPORT = "predicted_import_microjoule"
PARTS: dict[str, tuple[str, ...]] = {
    "friction": ("friction",), "drives": ("drive_loss",), "motion": ("rigid",),
    "brake": ("brake",), "cabinet": ("loss_dc", "loss_grid"), "capacitor": ("capacitor",),
}  # fmt: skip
"""Parts of the net energy from the grid, and the columns whose sum each is."""
PHASES: dict[str, tuple[str, ...]] = {
    "moves": ("motion",), "holds": ("hold",), "generates": ("generating",),
}  # fmt: skip
JOINT_PARTS = ("rigid", "friction", "drive_loss")  # electrical energy into the drive of a joint
GROUPS = ("robot", "cell", "part", "phase", "joint")
FIGURES = {
    "energy": (IMPORT,), "returned": ("predicted_return_microjoule",),
    "motion": ("motion_microjoule",), "hold": ("hold_microjoule",),
    "standby": ("standby_microjoule",), "friction": ("friction_microjoule",),
    "measured": ("measured_microjoule",), "at_meter": ("predicted_microjoule_at_meter",),
}  # fmt: skip
TIMES = {"observed": "observed_ns", "compared": "compared_ns", "standby_time": "standby_ns"}
RESTS = {"night": "at night", "weekend": "at the weekend, nights included"}
DANGEROUS = ("=", "+", "-", "@", "\t", "\r")  # begin a formula where a table is opened


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes:
        robots: Names; empty for all.
        group: One of `GROUPS`.
    """

    period: Period
    robots: tuple[str, ...] = ()
    group: str = "robot"


class HistoryView:
    """Answers what the page asks of a history; each answer has a connection of its own.

    Args:
        folder: Of the history; it may come later.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def wish(self, asked: Mapping[str, Sequence[str]], now_ns: int) -> Wish:
        """Return what a request asks for.

        Args:
            asked: ``period`` with ``at``, or ``start`` and ``stop``; ``timezone``, else
                ``fallback`` where no tariff has one; ``robot``, several; ``by``.
            now_ns: Time of this computer. [ns]

        Raises:
            HistoryError: If it asks for what there is not.
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
        """Return what the page draws.

        Args:
            now_ns: Time of this computer. [ns]

        Returns:
            Energies in J, times in s since 1970; None where nothing was recorded.

        Raises:
            HistoryError: If there is no history, or no such robot.
        """
        with closing(open_reader(self.folder)) as connection:
            known = list(robots_of(connection))
            robots_of(connection, wish.robots)
        tariffs = stored_tariffs(self.folder)
        emits = any(one.co2_kg_per_kwh is not None for one in tariffs)
        wish, table = self._table(wish)
        bars = table  # of joints: they hold neither times nor costs
        if wish.group == "joint":
            table = self._read(replace(wish, group="robot"))
        period, before = wish.period, wish.period.moved(-1)
        whole = self._sums(wish, period.start_ns, period.stop_ns)
        until = min(period.stop_ns, max(period.start_ns, now_ns // SLOT_NS * SLOT_NS))
        running = until < period.stop_ns
        same = self._sums(wish, period.start_ns, until) if running else whole
        earlier = self._sums(wish, before.start_ns, period.same_part(until))
        rows = _by_robot(whole, emits)
        of_same, of_earlier = _by_robot(same, emits), _by_robot(earlier, emits)
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
            "currency": whole.currency,
            "parts": _parts(period, table, len(rows)),
            "series": _series(wish, bars),
            "group": wish.group,
            "robots": list(rows.values()),
            "total": _total(rows.values()),
            "same": _total(of_same.values()),
            "earlier": _total(of_earlier.values()),
            "fair": comparable(
                *(sum(row["observed"] for row in one.values()) for one in (of_same, of_earlier))
            ),
            "spans": [
                {"robot": row["robot"], "start": row["stamp_ns"] / SECOND_NS,
                 "stop": row["stop_ns"] / SECOND_NS, "energy": row[IMPORT] / 1e6}
                for row in _rows(spans)[:MAX_SPANS]
            ],
            "span_count": len(spans),
            "span_energy": sum(spans[IMPORT].tolist()) / 1e6 if len(spans) else 0.0,
            "remarks": _remarks(whole),
            "rests": _rests(whole),
            "jobs": self._jobs(wish, before),
            "events": self._events(wish),
            "tariffs": [one.model_dump(mode="json") for one in tariffs],
        }  # fmt: skip

    def csv(self, wish: Wish) -> str:
        """Return the parts of a period as a table, by robot, or by joint.

        Raises:
            HistoryError: If there is no history, or no such robot.
        """
        wish, table = self._table(wish)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        flat = table.to_dict()
        begin, end = flat.pop("stamp_ns").tolist(), flat.pop("stop_ns").tolist()
        writer.writerow(["begin", "end", *flat])
        columns = [_harmless(values.tolist()) for values in flat.values()]
        for start, stop, *row in zip(begin, end, *columns, strict=True):
            writer.writerow([wish.period.at(start), wish.period.at(stop), *row])
        return text.getvalue()

    def add_tariff(self, tariff: Tariff, now_ns: int) -> str:
        """Add a tariff.

        Args:
            now_ns: Time of this computer. [ns]

        Returns:
            What was done, in a sentence.

        Raises:
            HistoryError: If there is no history, or it cannot be written now.
        """
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

    def _sums(self, wish: Wish, start_ns: int, stop_ns: int) -> History:
        zone = wish.period.zone.key
        stop_ns = max(stop_ns, start_ns + 1)  # of nothing: nothing
        return history(self.folder, start_ns, stop_ns, "all", wish.robots, zone)

    def _jobs(self, wish: Wish, before: Period) -> list[dict[str, Any]]:
        now, earlier = (
            history_jobs(self.folder, one.start_ns, one.stop_ns, "all", wish.robots, one.zone.key)
            for one in (wish.period, before)
        )
        means = {(one["robot"], one["job"]): one["microjoule_per_part"] for one in _rows(earlier)}
        rows = sorted(_rows(now), key=lambda one: -one[IMPORT])
        return [
            {"robot": one["robot"], "name": one["job"], "count": one["parts"],
             "time": one["observed_ns"] / one["parts"] / SECOND_NS, "energy": one[IMPORT] / 1e6,
             "mean": one["microjoule_per_part"] / 1e6,
             "before": _joule(means.get((one["robot"], one["job"])))}
            for one in rows[:MAX_JOBS]
        ]  # fmt: skip

    def _events(self, wish: Wish) -> list[dict[str, Any]]:
        """The newest events of the period first."""
        period = wish.period
        found = history_events(
            self.folder, period.start_ns, period.stop_ns, wish.robots, period.zone.key
        )
        return [
            {"at": period.at(one["stamp_ns"])[:16].replace("T", " "), "robot": one["robot"],
             "kind": one["kind"], "text": one["text"]}
            for one in _rows(found)[: -MAX_EVENTS - 1 : -1]
        ]  # fmt: skip


def comparable(now: float | None, before: float | None) -> bool:
    """Whether about as much time was observed in two periods, so that a change says something.

    Args:
        now: Observed time of the later one; None for none. [s]
        before: That of the earlier one, likewise. [s]
    """
    return bool(now and before) and abs((now or 0.0) / (before or 1.0) - 1.0) <= ALIKE


def _joule(microjoule: float | None) -> float | None:
    return None if microjoule is None else microjoule / 1e6


def _rows(table: TimeSeries) -> list[dict[str, Any]]:
    flat = table.to_dict()
    columns = [values.tolist() for values in flat.values()]
    return [dict(zip(flat, values, strict=True)) for values in zip(*columns, strict=True)]


def _by_robot(table: History, emits: bool) -> dict[str, dict[str, Any]]:
    """Figures of each robot; what has no price or no factor is None."""
    found: dict[str, dict[str, Any]] = {}
    for row in _rows(table):
        priced = row.get("priced_microjoule", 0)
        figures: dict[str, Any] = {
            name: sum(row[column] for column in columns) / 1e6 for name, columns in FIGURES.items()
        }
        figures |= {name: row[column] / SECOND_NS for name, column in TIMES.items()}
        if not row["compared_ns"]:
            figures["measured"] = figures["at_meter"] = None
        figures["priced"] = priced / 1e6
        figures["cost"] = row["cost"] if priced else None
        figures["co2"] = row["co2_kg"] if priced and emits else None
        figures["peak"] = row["peak_minute_microjoule"] / 60e6 or None  # [W]
        found[row["robot"]] = {"robot": row["robot"], **figures}
    return found


def _total(rows: Iterable[dict[str, Any]]) -> dict[str, float] | None:
    """Sums over robots; a figure that no robot has is left out. None without robots."""
    sums: defaultdict[str, float] = defaultdict(float)
    for row in rows:
        for name, value in row.items():
            if isinstance(value, float) and name not in ("peak", "same", "before"):
                sums[name] += value
    return dict(sums) or None


def _rests(table: History) -> list[dict[str, Any]]:
    """Standby at night and at weekends, with its cost; empty without a tariff."""
    return [
        {
            "name": name,
            "energy": sum(table[f"standby_{rest}_microjoule"].tolist()) / 1e6,
            "cost": sum(table[f"standby_{rest}_cost"].tolist()),
        }
        for rest, name in RESTS.items()
        if f"standby_{rest}_cost" in table and len(table)
    ]


def _parts(period: Period, table: History, robots: int) -> list[dict[str, Any]]:
    """The parts of the time, with the observed share of all robots and the cost of each."""
    observed: defaultdict[int, int] = defaultdict(int)
    cost: defaultdict[int, float] = defaultdict(float)
    for row in _rows(table):
        observed[row["stamp_ns"]] += row["observed_ns"]
        if row.get("priced_microjoule"):
            cost[row["stamp_ns"]] += row["cost"]
    parts = period.parts()
    for one, start, stop in zip(parts, period.bounds, period.bounds[1:], strict=False):
        one["cost"] = cost.get(start)
        one["observed"] = min(1.0, observed[start] / ((stop - start) * robots)) if robots else 0.0
    return parts


def _series(wish: Wish, table: History) -> list[dict[str, Any]]:
    """Energy of each robot, part, phase or joint in each part of the time. [J]"""
    places = {start: place for place, start in enumerate(wish.period.bounds[:-1])}
    sums: dict[str, list[float | None]] = {}
    for row in _rows(table):
        for name, value in _values(wish, row):
            values = sums.setdefault(name, [None] * len(places))
            place = places[row["stamp_ns"]]
            values[place] = (values[place] or 0.0) + value / 1e6
    if wish.group in ("part", "phase"):
        return [{"name": name, "values": values} for name, values in sums.items()]
    order = sorted(sums, key=lambda name: -sum(value or 0.0 for value in sums[name]))
    shown, others = order[:MAX_SERIES], order[MAX_SERIES:]
    series = [{"name": name, "values": sums[name]} for name in shown]
    if others:
        rest = [
            None if all(one is None for one in column) else sum(one or 0.0 for one in column)
            for column in zip(*(sums[name] for name in others), strict=True)
        ]
        series.append({"name": f"{len(others)} others", "values": rest, "rest": True})
    return series


def _values(wish: Wish, row: dict[str, Any]) -> list[tuple[str, int]]:
    def total(names: Sequence[str]) -> int:
        return sum(row[f"{name}_microjoule"] for name in names)

    match wish.group:
        case "part":
            return [(name, total(columns)) for name, columns in PARTS.items()]
        case "phase":
            return [(name, total(columns)) for name, columns in PHASES.items()]
        case "joint":
            alone = len(wish.robots) == 1
            name = row["joint"] if alone else f"{row['robot']} {row['joint']}"
            return [(name, total(JOINT_PARTS))]
        case "cell":  # the first part of its name, as in the name space of its nodes
            return [(row["robot"].partition("/")[0], row[IMPORT])]
        case _:
            return [(row["robot"], row[IMPORT])]


def _remarks(table: History) -> list[str]:
    """What is to be known of these rows."""
    flags = 0
    for one in table["flags"].tolist() if len(table) else ():
        flags |= one
    return [text for flag, text in FLAGS.items() if flags & flag and flag != UNRESOLVED]


def _harmless(values: list[Any]) -> list[Any]:
    """Texts that no table program takes for a formula."""
    return [
        f"'{one}" if isinstance(one, str) and one.startswith(DANGEROUS) else one for one in values
    ]
