"""Reads a history: sums of slots between instants, of every robot, and what lies in no slot."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from itertools import pairwise
from typing import Any, Literal
from zoneinfo import ZoneInfo

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import HOUR_NS, MINUTE_NS, SECOND_NS
from robot_energy.history.differences import SLOT_NS
from robot_energy.history.readings import COLUMNS, JOINT_COLUMNS
from robot_energy.history.tariffs import MICROJOULE_PER_KWH, Tariff, day_begin, priced_parts

Resolution = Literal["minute", "quarter", "hour", "day", "week", "month", "year", "all"]
RESOLUTIONS: tuple[Resolution, ...] = (
    "minute", "quarter", "hour", "day", "week", "month", "year", "all",
)  # fmt: skip
FIXED: dict[str, int] = {"minute": MINUTE_NS, "quarter": SLOT_NS, "hour": HOUR_NS}
MAX_BUCKETS = 200_000
SUMS = ", ".join(f"sum(s.{name})" for name in COLUMNS)
JOINT_SUMS = ", ".join(f"sum(s.{name})" for name in JOINT_COLUMNS)


@dataclass(frozen=True)
class SlotSums:
    """What one robot used in a time.

    Attributes:
        start_ns: Begin of the time. [ns]
        stop_ns: End of it; of a span in no slot its own. [ns]
        robot: Its name.
        values: By `COLUMNS`, or by `JOINT_COLUMNS` of one joint. [ns], [uJ]
        flags: Of the slots.
        peak_microjoule: Most energy from the grid within a minute; 0 if no minute is known. [uJ]
        joint: Its name; empty for the whole robot.
    """

    start_ns: int
    stop_ns: int
    robot: str
    values: tuple[int, ...]
    flags: int = 0
    peak_microjoule: int = 0
    joint: str = ""


@dataclass(frozen=True)
class Jobs:
    """Jobs of one name of one robot that ended in a time.

    Attributes:
        robot: Its name.
        name: Of the jobs.
        count: How many.
        observed_ns: Their time. [ns]
        import_microjoule: Energy from the grid. [uJ]
    """

    robot: str
    name: str
    count: int
    observed_ns: int
    import_microjoule: int


@dataclass(frozen=True)
class SlotCost:
    """What energy from the grid cost in a time.

    Attributes:
        priced_microjoule: Energy whose price is known. [uJ]
        amount: Its cost. [currency]
        co2_kg: Its emission, where a factor is known. [kg]
    """

    priced_microjoule: int = 0
    amount: float = 0.0
    co2_kg: float = 0.0


def edges(start_ns: int, stop_ns: int, resolution: Resolution, zone: ZoneInfo) -> list[int]:
    """Return where the parts of a time begin, and its end. [ns]

    Args:
        start_ns: Begin of the time; its part begins at or before it. [ns]
        stop_ns: End of the time. [ns]
        zone: Where days, weeks (from Monday), months and years begin at midnight; hours
            begin where those of the zone do.

    Raises:
        HistoryError: If there are too many.
    """
    if resolution == "all":
        return [start_ns, stop_ns]
    if resolution in FIXED:
        length = FIXED[resolution]
        offset = _local(start_ns, zone).utcoffset() or timedelta()
        shift = int(offset.total_seconds()) * SECOND_NS % length
        first = (start_ns + shift) // length * length - shift
        if (stop_ns - first) // length >= MAX_BUCKETS:
            raise HistoryError(
                f"{(stop_ns - first) // length} parts of a {resolution}",
                f"at most {MAX_BUCKETS}", "a shorter time, or a coarser resolution",
            )  # fmt: skip
        return [*range(first, stop_ns, length), -(-(stop_ns - first) // length) * length + first]
    day = _first(_local(start_ns, zone).date(), resolution)
    found = [day_begin(day, zone)]
    while found[-1] < stop_ns:
        day = _next(day, resolution)
        found.append(day_begin(day, zone))
    return found


def robots_of(connection: sqlite3.Connection, names: Sequence[str] = ()) -> dict[str, int]:
    """Return the numbers of robots by their names.

    Args:
        names: Which; empty for all.

    Raises:
        HistoryError: If one is not there.
    """
    known: dict[str, int] = dict(
        connection.execute("SELECT name, id FROM robot ORDER BY name").fetchall()
    )
    for name in names:
        if name not in known:
            raise HistoryError(f"no robot '{name}' in the history", ", ".join(known) or "a robot")
    return {name: known[name] for name in names or known}


def sums(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int], *,
    minutes: bool = False,
) -> list[SlotSums]:  # fmt: skip
    """Return the sums of all slots that lie within each part, in order of time and robot.

    Args:
        bounds: Where parts begin, and the end of the last. [ns]
        minutes: Whether minutes are summed, which are kept for some weeks, or quarter hours.
    """
    _parts(connection, robots, pairwise(bounds))
    rows = connection.execute(
        f"SELECT p.start, p.stop, r.name, {SUMS}, max(s.peak_microjoule), max(s.flags & 2) | "
        "max(s.flags & 4) | max(s.flags & 8) FROM part p CROSS JOIN some r CROSS JOIN "
        f"{'slot1' if minutes else 'slot15'} s ON s.robot = r.id AND s.start >= p.start AND "
        "s.start < p.stop AND s.stop <= p.stop GROUP BY p.start, r.name ORDER BY p.start, r.name"
    )
    return [
        SlotSums(start, stop, name, tuple(values), flags, peak)
        for start, stop, name, *values, peak, flags in rows
    ]


def joint_sums(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int]
) -> list[SlotSums]:
    """Return the same of every joint; the sums of a joint are by `JOINT_COLUMNS`."""
    _parts(connection, robots, pairwise(bounds))
    rows = connection.execute(
        f"SELECT p.start, p.stop, r.name, s.joint, {JOINT_SUMS} FROM part p CROSS JOIN some r "
        "CROSS JOIN joint15 s ON s.robot = r.id AND s.start >= p.start AND s.start < p.stop "
        "AND s.stop <= p.stop GROUP BY p.start, r.name, s.joint ORDER BY p.start, r.name, s.joint"
    )
    return [
        SlotSums(start, stop, name, tuple(values), joint=joint)
        for start, stop, name, joint, *values in rows
    ]


def not_resolved(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int]
) -> list[SlotSums]:
    """Return the spans that lie in no part, with their true begin and end, in order of time.

    Args:
        bounds: As in `sums`, of quarter hours or coarser.
    """
    first, last = bounds[0], bounds[-1]
    _parts(connection, robots, pairwise(bounds))
    rows = connection.execute(
        f"SELECT s.start, s.stop, r.name, {', '.join(f's.{name}' for name in COLUMNS)}, s.flags "
        "FROM some r CROSS JOIN slot15 s ON s.robot = r.id AND s.start < ? "
        "WHERE s.flags & 1 AND s.stop > ? AND NOT EXISTS (SELECT 1 FROM part p WHERE "
        "s.start >= p.start AND s.start < p.stop AND s.stop <= p.stop) ORDER BY s.start, r.name",
        (last, first),
    )
    return [
        SlotSums(start, stop, name, tuple(values), flags)
        for start, stop, name, *values, flags in rows
    ]


def jobs(
    connection: sqlite3.Connection, robots: dict[str, int], start_ns: int, stop_ns: int
) -> list[Jobs]:
    """Return the jobs that ended in a time, those that used most first.

    Args:
        start_ns: Begin of the time. [ns]
        stop_ns: End of the time. [ns]
    """
    _parts(connection, robots, [])
    rows = connection.execute(
        "SELECT r.name, j.name, count(*), sum(j.observed_ns), sum(j.predicted_import_microjoule) "
        "AS used FROM some r CROSS JOIN job j ON j.robot = r.id AND j.stop > ? AND j.stop <= ? "
        "GROUP BY r.name, j.name ORDER BY used DESC",
        (start_ns, stop_ns),
    )
    return [Jobs(*row) for row in rows]


def costs(
    connection: sqlite3.Connection,
    robots: dict[str, int],
    bounds: Sequence[int],
    tariffs: Sequence[Tariff],
) -> dict[tuple[int, str], SlotCost]:
    """Return what energy from the grid cost in each part, by its begin and robot.

    Energy of each price is summed exactly and multiplied once.

    Args:
        bounds: As in `sums`, of quarter hours or coarser. [ns]
        tariffs: In order of their begin.
    """
    parts = [
        (begin, end, start, tariff, price)
        for start, stop in pairwise(bounds)
        for begin, end, tariff, price in priced_parts(tariffs, start, stop)
        if price is not None
    ]
    _parts(connection, robots, ((begin, end) for begin, end, *_ in parts))
    said = {begin: (start, tariff, price) for begin, _, start, tariff, price in parts}
    energy: dict[tuple[int, str, float, float | None], int] = {}
    for begin, name, microjoule in connection.execute(
        "SELECT p.start, r.name, sum(s.predicted_import_microjoule) FROM part p CROSS JOIN some r "
        "CROSS JOIN slot15 s ON s.robot = r.id AND s.start >= p.start AND s.start < p.stop "
        "AND s.stop <= p.stop GROUP BY p.start, r.name"
    ):
        start, tariff, price = said[begin]
        key = (start, name, price or 0.0, tariff.co2_kg_per_kwh)
        energy[key] = energy.get(key, 0) + microjoule
    found: dict[tuple[int, str], SlotCost] = {}
    for (start, name, price, factor), microjoule in energy.items():
        before, used = found.get((start, name), SlotCost()), microjoule / MICROJOULE_PER_KWH
        found[start, name] = SlotCost(
            before.priced_microjoule + microjoule,
            before.amount + used * price,
            before.co2_kg + used * (factor or 0.0),
        )
    return found


def _parts(connection: sqlite3.Connection, robots: dict[str, int], parts: Any) -> None:
    """Put parts of time and robots where a query joins them."""
    connection.execute("PRAGMA temp_store = MEMORY")
    for name, columns in (
        ("part", "start INTEGER, stop INTEGER"),
        ("some", "id INTEGER, name TEXT"),
    ):
        connection.execute(f"CREATE TEMP TABLE IF NOT EXISTS {name} ({columns})")
        connection.execute(f"DELETE FROM temp.{name}")
    connection.execute("BEGIN")
    connection.executemany("INSERT INTO temp.part VALUES (?, ?)", parts)
    connection.executemany(
        "INSERT INTO temp.some VALUES (?, ?)", ((number, name) for name, number in robots.items())
    )
    connection.execute("COMMIT")


def _local(stamp_ns: int, zone: ZoneInfo) -> datetime:
    return datetime.fromtimestamp(stamp_ns // SECOND_NS, UTC).astimezone(zone)


def _first(day: date, resolution: Resolution) -> date:
    match resolution:
        case "week":
            return day - timedelta(days=day.weekday())
        case "month":
            return day.replace(day=1)
        case "year":
            return day.replace(month=1, day=1)
        case _:
            return day


def _next(day: date, resolution: Resolution) -> date:
    match resolution:
        case "week":
            return day + timedelta(days=7)
        case "month":
            return (day.replace(day=1) + timedelta(days=32)).replace(day=1)
        case "year":
            return day.replace(year=day.year + 1)
        case _:
            return day + timedelta(days=1)
