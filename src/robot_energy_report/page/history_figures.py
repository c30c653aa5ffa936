"""Rows of a history -> figures of the page: sums by robot, bars, remarks. [J], [s]"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.time_series import TimeSeries
from robot_energy_history.differences import FLAGS, UNRESOLVED
from robot_energy_history.queries import rows_of
from robot_energy_report.page.history_period import Period

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
JOINT_PARTS = ("rigid", "friction", "drive_loss")  # electrical energy into the drive of a joint
GROUPS = ("robot", "cell", "part", "phase", "joint", "job")
FIGURES = {
    "energy": (IMPORT,), "returned": ("predicted_return_microjoule",),
    "motion": ("motion_microjoule",), "hold": ("hold_microjoule",),
    "standby": ("standby_microjoule",), "friction": ("friction_microjoule",),
    "measured": ("measured_microjoule",), "at_meter": ("predicted_microjoule_at_meter",),
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
    found = (_less(row, last[row["robot"]]) if row["robot"] in last else row for row in rows)
    return [row for row in found if row["observed_ns"] or row[IMPORT]]


def _less(one: Row, other: Row) -> Row:
    left = {
        name: value - other.get(name, 0)
        for name, value in one.items()
        if name not in (*KEPT, "flags", PEAK)
    }
    return {**one, **left}


def figures_by_robot(rows: Sequence[Row], emits: bool) -> dict[str, dict[str, Any]]:
    """Return figures of each robot; what has no price or no factor is None."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
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
    if group in ("part", "phase"):
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

    match group:
        case "part":
            return [(name, total(columns)) for name, columns in PARTS.items()]
        case "phase":
            return [(name, total(columns)) for name, columns in PHASES.items()]
        case "joint":
            name = row["joint"] if alone else f"{row['robot']} {row['joint']}"
            return [(name, total(JOINT_PARTS))]
        case "job":
            return [(row["job"], row[IMPORT])]
        case "cell":  # the first part of its name, as in the name space of its nodes
            return [(row["robot"].partition("/")[0], row[IMPORT])]
        case _:
            return [(row["robot"], row[IMPORT])]


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
