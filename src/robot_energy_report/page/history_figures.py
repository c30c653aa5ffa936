"""Periods of a history, and figures of its rows for the page: sums by robot, bars. [J], [s]"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import date, datetime, timedelta
from itertools import pairwise
from typing import Annotated, Any
from zoneinfo import ZoneInfo

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, HOUR_NS, MINUTE_NS, SECOND_NS
from robot_energy.timeline.time_series import TimeSeries
from robot_energy_history.api import stamp_of
from robot_energy_history.differences import FLAGS, SLOT_NS, UNRESOLVED
from robot_energy_history.queries import Resolution, edges, rows_of
from robot_energy_history.tariffs import day_begin

KINDS: dict[str, Resolution] = {
    "hour": "hour", "day": "day", "week": "week", "month": "month", "year": "year",
}  # fmt: skip
SPAN = "span"
PARTS_OF: dict[str, Resolution] = {
    "hour": "minute", "day": "hour", "week": "day", "month": "day", "year": "month",
}  # fmt: skip
"""Into which parts each kind is divided."""
SPANS: tuple[tuple[int, Resolution], ...] = (
    (3 * HOUR_NS, "minute"), (3 * DAY_NS, "hour"), (100 * DAY_NS, "day"),
    (1200 * DAY_NS, "month"),
)  # fmt: skip
"""Parts of a span up to each length [ns]; of a longer one years."""
MAX_YEARS = 100
MAX_NS = 7_200_000_000 * SECOND_NS  # of an instant that is asked for
LABELS = {"year": "%Y", "month": "%b", "day": "%-d", "hour": "%H", "quarter": "%H:%M"}
NAMES = {
    "hour": "%F %H:%M", "day": "%A %F", "week": "week %V of %G", "month": "%B %Y", "year": "%Y",
}  # fmt: skip


class Period(Described):
    """A time of the history, as a calendar has it."""

    kind: str
    start_ns: Annotated[int, "Its begin. [ns]"]
    stop_ns: Annotated[int, "Its end. [ns]"]
    resolution: Resolution
    zone: ZoneInfo

    @property
    def bounds(self) -> list[int]:
        """Where its parts begin, and its end. [ns]"""
        return edges(self.start_ns, self.stop_ns, self.resolution, self.zone)

    @property
    def name(self) -> str:
        """What people call it."""
        if self.kind != SPAN:
            return self._local(self.start_ns).strftime(NAMES[self.kind])
        first, last = self._local(self.start_ns), self._local(self.stop_ns)
        if first.time() == last.time() == datetime.min.time():
            return f"{first:%F} to {self._local(self.stop_ns - 1):%F}"
        return f"{first:%F %H:%M} to {last:%F %H:%M}"

    def moved(self, step: int) -> Period:
        """Return the period that lies so many steps later; of a span, as long as it."""
        if self.kind == SPAN:
            by = step * (self.stop_ns - self.start_ns)
            return replace(self, start_ns=self.start_ns + by, stop_ns=self.stop_ns + by)
        if self.kind == "hour":
            return period_at("hour", self.start_ns + step * HOUR_NS, self.zone)
        day = self._local(self.start_ns).date()
        if self.kind in ("day", "week"):
            day += timedelta(days=step * (7 if self.kind == "week" else 1))
        else:
            months = step if self.kind == "month" else 12 * step
            year, month = divmod(day.year * 12 + day.month - 1 + months, 12)
            day = date(year, month + 1, 1)
        begin = day_begin(day, self.zone)
        return period_at(self.kind, begin, self.zone)

    def same_part(self, until_ns: int) -> int:
        """Return until when the period before is as long as this one up to a quarter hour. [ns]

        By local clock, so that a day of 23 hours is compared up to the same hour.
        """
        before = self.moved(-1)
        gone = self._wall(until_ns) - self._wall(self.start_ns)
        wall = self._local(before.start_ns).replace(tzinfo=None) + gone
        found = round(wall.replace(tzinfo=self.zone).timestamp()) * SECOND_NS
        return min(max(found, before.start_ns), before.stop_ns)

    def parts(self) -> list[dict[str, Any]]:
        """Return its parts as plain values: begin and end [s], labels, and the part as a period."""
        kind = {"minute": "", "quarter": "", "all": ""}.get(self.resolution, self.resolution)
        return [
            {
                "start": start / SECOND_NS,
                "stop": stop / SECOND_NS,
                "label": self._label(start),
                "name": self._part_name(start, stop),
                "zoom": {"period": kind, "at": self.at(start)} if kind else None,
            }
            for start, stop in pairwise(self.bounds)
        ]

    def at(self, stamp_ns: int) -> str:
        """Return an instant as requests name it."""
        return self._local(stamp_ns).isoformat(timespec="minutes")

    def plain(self) -> dict[str, str]:
        """Return what a request for it holds."""
        if self.kind != SPAN:
            return {"period": self.kind, "at": self.at(self.start_ns)}
        return {
            "period": SPAN, "start": self.at(self.start_ns), "stop": self.at(self.stop_ns),
        }  # fmt: skip

    def _label(self, start: int) -> str:
        local = self._local(start)
        if self.resolution == "minute":
            return f"{local:%H:%M}"
        if self.kind == "week":
            return f"{local:%a %-d}"
        return local.strftime(LABELS[self.resolution])

    def _part_name(self, start: int, stop: int) -> str:
        if self.resolution in NAMES and self.resolution != "hour":
            return self._local(start).strftime(NAMES[self.resolution])
        return f"{self._local(start):%F %H:%M} to {self._local(stop):%H:%M}"

    def _local(self, stamp_ns: int) -> datetime:
        return local_time(stamp_ns, self.zone)

    def _wall(self, stamp_ns: int) -> datetime:
        return self._local(stamp_ns).replace(tzinfo=None)


def period_at(kind: str, stamp_ns: int, zone: ZoneInfo) -> Period:
    """Return the period of a kind that an instant lies in."""
    found = KINDS.get(kind)
    if found is None:
        raise HistoryError(f"period '{kind[:20]}'", ", ".join((*KINDS, SPAN)))
    start, stop = edges(stamp_ns, stamp_ns + 1, found, zone)
    return Period(kind, start, stop, PARTS_OF[kind], zone)


def span_of(start_ns: int, stop_ns: int, zone: ZoneInfo) -> Period:
    """Return any span, made longer so that it has whole parts."""
    start_ns, stop_ns = start_ns // SLOT_NS * SLOT_NS, -(-stop_ns // SLOT_NS) * SLOT_NS
    length = stop_ns - start_ns
    if not 0 < length <= MAX_YEARS * 366 * DAY_NS:
        raise HistoryError("a span that ends before it begins, or is too long",
                           f"up to {MAX_YEARS} years")  # fmt: skip
    parts: Resolution = "year"
    for longest, finer in reversed(SPANS):
        parts = finer if length <= longest else parts
    bounds = edges(start_ns, stop_ns, parts, zone)
    return Period(SPAN, bounds[0], bounds[-1], parts, zone)


def instant(text: str, zone: ZoneInfo) -> int:
    """Return an instant that a request names, local to the zone unless it says its offset. [ns]"""
    stamp_ns = stamp_of(text, zone)
    if not 0 <= stamp_ns < MAX_NS:
        raise HistoryError(f"time '{text[:40]}'", "one from 1970 to 2190")
    return stamp_ns // MINUTE_NS * MINUTE_NS


MAX_SERIES = 8  # bars of one part of the time; further robots or joints are summed up
ALIKE = 0.05  # by which observed times of two periods may differ to be compared
IMPORT = "predicted_import_microjoule"
PARTS: dict[str, tuple[str, ...]] = {
    "friction": ("friction",), "drives": ("drive_loss",), "motion": ("rigid",),
    "brake": ("brake",), "cabinet": ("loss_dc", "loss_grid"), "capacitor": ("capacitor",),
}  # fmt: skip
"""Parts of the net energy from the grid, and the columns whose sum each is."""
PHASES: dict[str, tuple[str, ...]] = {
    "moves": ("motion",), "holds": ("hold",), "generates": ("generating",),
}  # fmt: skip
PARTS_OF_GROUP = {"part": PARTS, "phase": PHASES}
JOINT_PARTS = ("rigid", "friction", "drive_loss")  # electrical energy into the drive of a joint
GROUPS = ("robot", "cell", "part", "phase", "joint", "job")
FIGURES = {
    "energy": IMPORT, "motion": "motion_microjoule", "hold": "hold_microjoule",
    "standby": "standby_microjoule", "friction": "friction_microjoule",
    "measured": "measured_microjoule", "at_meter": "predicted_microjoule_at_meter",
}  # fmt: skip
TIMES = {"observed": "observed_ns", "compared": "compared_ns", "standby_time": "standby_ns"}
RESTS = {"night": "at night", "weekend": "at the weekend, nights included"}
PEAK = "peak_minute_microjoule"
KEPT = ("robot", "stamp_ns", "stop_ns")
Row = dict[str, Any]
DANGEROUS = ("=", "+", "-", "@", "\t", "\r")  # begin a formula where a table is opened


def comparable(now: float | None, before: float | None) -> bool:
    """Whether about as much time was observed in two periods, so that a change says something.

    Args:
        now: Observed time of the later one; None for none. [s]
        before: That of the earlier one, likewise. [s]
    """
    return bool(now and before) and abs((now or 0.0) / (before or 1.0) - 1.0) <= ALIKE


def summed(table: TimeSeries) -> list[Row]:
    """Return the parts of each robot added up, as of one part that is all of the time."""
    flat = table.to_dict()
    order = np.argsort(flat["robot"], kind="stable")
    robots = flat["robot"][order]
    firsts = np.flatnonzero(np.concatenate([[True], robots[1:] != robots[:-1]])[: len(robots)])
    ways = {"flags": np.bitwise_or, PEAK: np.maximum}
    columns = {
        name: values[order][firsts]
        if name in KEPT or not len(firsts)
        else ways.get(name, np.add).reduceat(values[order], firsts)
        for name, values in flat.items()
    }
    return rows_of(TimeSeries(columns.pop("stamp_ns"), columns))


def less(rows: Sequence[Row], open_rows: Sequence[Row]) -> list[Row]:
    """The same without the quarter hour that goes on; who has nothing else is left out."""
    last = {row["robot"]: row for row in open_rows}
    kept = (*KEPT, "flags", PEAK)
    found: list[Row] = []
    for row in rows:
        other = last.get(row["robot"], {})
        found.append({k: v if k in kept else v - other.get(k, 0) for k, v in row.items()})
    return [row for row in found if row["observed_ns"] or row[IMPORT]]


def figures_by_robot(rows: Sequence[Row], emits: bool) -> dict[str, dict[str, Any]]:
    """Return figures of each robot; what has no price or no factor is None."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        priced = row.get("priced_microjoule", 0)
        figures: dict[str, Any] = {name: row[column] / 1e6 for name, column in FIGURES.items()}
        figures |= {name: row[column] / SECOND_NS for name, column in TIMES.items()}
        if not row["compared_ns"]:
            figures["measured"] = figures["at_meter"] = None
        figures["priced"] = priced / 1e6
        figures["cost"] = row["cost"] if priced else None
        figures["co2"] = row["co2_kg"] if priced and emits else None
        figures["peak"] = row[PEAK] / 60e6 or None  # [W]
        found[row["robot"]] = {"robot": row["robot"], **figures}
    return found


def total_of(rows: Iterable[dict[str, Any]]) -> dict[str, float] | None:
    """Return sums over robots, without figures that none has; None without robots."""
    sums: defaultdict[str, float] = defaultdict(float)
    for row in rows:
        for name, value in row.items():
            if isinstance(value, float) and name not in ("peak", "same", "before"):
                sums[name] += value
    return dict(sums) or None


def rests_of(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return standby at night and at weekends with its cost; nothing without a tariff."""
    return [
        {
            "name": name,
            "energy": sum(row[f"standby_{rest}_microjoule"] for row in rows) / 1e6,
            "cost": sum(row[f"standby_{rest}_cost"] for row in rows),
        }
        for rest, name in RESTS.items()
        if rows and f"standby_{rest}_cost" in rows[0]
    ]


def parts_of(period: Period, rows: Sequence[Row], robots: int) -> list[dict[str, Any]]:
    """The parts of the time, with the observed share of all robots and the cost of each."""
    observed: defaultdict[int, int] = defaultdict(int)
    cost: defaultdict[int, float] = defaultdict(float)
    for row in rows:
        observed[row["stamp_ns"]] += row["observed_ns"]
        if row.get("priced_microjoule"):
            cost[row["stamp_ns"]] += row["cost"]
    parts = period.parts()
    for one, start, stop in zip(parts, period.bounds, period.bounds[1:], strict=False):
        one["cost"] = cost.get(start)
        one["observed"] = min(1.0, observed[start] / ((stop - start) * robots)) if robots else 0.0
    return parts


def series_of(period: Period, group: str, rows: Sequence[Row], alone: bool) -> list[dict[str, Any]]:
    """Return the energy of each robot, part, phase or joint in each part of the time. [J]"""
    places = {start: place for place, start in enumerate(period.bounds[:-1])}
    sums: dict[str, list[float | None]] = {}
    for row in rows:
        for name, value in _values(group, row, alone):
            values = sums.setdefault(name, [None] * len(places))
            place = places[row["stamp_ns"]]
            values[place] = (values[place] or 0.0) + value / 1e6
    if group in PARTS_OF_GROUP:
        return [{"name": name, "values": values} for name, values in sums.items()]
    order = sorted(sums, key=lambda name: -sum(value or 0.0 for value in sums[name]))
    shown, others = order[:MAX_SERIES], order[MAX_SERIES:]
    series: list[dict[str, Any]] = [{"name": name, "values": sums[name]} for name in shown]
    if others:
        rest = [
            None if all(one is None for one in column) else sum(one or 0.0 for one in column)
            for column in zip(*(sums[name] for name in others), strict=True)
        ]
        series.append({"name": f"{len(others)} others", "values": rest, "rest": True})
    return series


def _values(group: str, row: Row, alone: bool) -> list[tuple[str, int]]:
    def total(names: Sequence[str]) -> int:
        return sum(row[f"{name}_microjoule"] for name in names)

    if group in PARTS_OF_GROUP:
        return [(name, total(columns)) for name, columns in PARTS_OF_GROUP[group].items()]
    if group == "joint":
        name = row["joint"] if alone else f"{row['robot']} {row['joint']}"
        return [(name, total(JOINT_PARTS))]
    name = row["job" if group == "job" else "robot"]
    if group == "cell":  # the first part of its name, as in the name space of its nodes
        name = name.partition("/")[0]
    return [(name, row[IMPORT])]


def remarks_of(rows: Sequence[Row]) -> list[str]:
    """Return what is to be known of these rows, in words."""
    flags = 0
    for row in rows:
        flags |= row["flags"]
    return [text for flag, text in FLAGS.items() if flags & flag and flag != UNRESOLVED]


def harmless(values: list[Any]) -> list[Any]:
    """Return the same, texts made so that no table program takes them for a formula."""
    return [
        f"'{one}" if isinstance(one, str) and one.startswith(DANGEROUS) else one for one in values
    ]
