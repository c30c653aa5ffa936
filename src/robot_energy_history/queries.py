"""Reads a history: sums of slots between instants, of every robot, and what lies in no slot."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date, timedelta
from itertools import pairwise
from operator import add
from typing import Any, Literal
from zoneinfo import ZoneInfo

import numpy as np

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time, time_zone
from robot_energy.foundation.units import DAY_NS, HOUR_NS, MINUTE_NS, SECOND_NS
from robot_energy.timeline.time_series import Column, TimeSeries
from robot_energy_history.database import JOB_SUMS
from robot_energy_history.differences import SLOT_NS
from robot_energy_history.readings import COLUMNS, JOINT_COLUMNS
from robot_energy_history.rollup import FLAGS, REGULAR, Rolled
from robot_energy_history.tariffs import day_begin

Resolution = Literal["minute", "quarter", "hour", "day", "week", "month", "year", "all"]
RESOLUTIONS: tuple[Resolution, ...] = (
    "minute", "quarter", "hour", "day", "week", "month", "year", "all",
)  # fmt: skip
FIXED: dict[str, int] = {"minute": MINUTE_NS, "quarter": SLOT_NS, "hour": HOUR_NS}
MAX_BUCKETS = 200_000
SUMS = ", ".join(f"sum(s.{name})" for name in COLUMNS)
JOINT_SUMS = ", ".join(f"sum(s.{name})" for name in JOINT_COLUMNS)
PEAK = "max(s.peak_microjoule)"
_SLOT_COLUMNS = (*COLUMNS, "peak_minute_microjoule", "flags")
_WITHIN = "{on}.start >= p.start AND {on}.start < p.stop AND {on}.stop <= p.stop"
_SPANS = (
    "piece p CROSS JOIN some r CROSS JOIN {table}1 s ON s.robot = r.id AND "
    + _WITHIN.format(on="s"),
)
_REGULAR = tuple(
    f"piece p CROSS JOIN some r CROSS JOIN {{table}}{length // MINUTE_NS} s ON s.robot = r.id AND "
    f"s.start >= p.start AND s.start < p.stop WHERE p.length = {length}"
    + (f" AND s.stop <= p.stop AND {REGULAR.format(length=length)}" if length == SLOT_NS else "")
    for length in (SLOT_NS, HOUR_NS, DAY_NS)
)
_IRREGULAR = (
    "part p CROSS JOIN some r CROSS JOIN slot15 i ON i.robot = r.id AND i.flags & 1 AND "
    f"{_WITHIN.format(on='i')} CROSS JOIN {{table}}15 s ON s.robot = i.robot AND s.start = i.start "
    "AND s.epoch = i.epoch AND s.stop = i.stop"
)
_JOBS = (
    ("job j ON j.robot = r.id AND j.stop > p.start AND j.stop <= p.stop "
     f"WHERE p.length = {SLOT_NS}", "count(*)"),
    *(
        (f"job{length // MINUTE_NS} j ON j.robot = r.id AND j.start >= p.start AND "
         f"j.start < p.stop WHERE p.length = {length}", "sum(j.jobs)")
        for length in (HOUR_NS, DAY_NS)
    ),
)  # fmt: skip
"""Where jobs are counted by pieces of each length, and how many jobs rows are."""


def zone_of(name: str) -> ZoneInfo:
    """Return a time zone."""
    try:
        return time_zone(name)
    except ValueError as error:
        expected = str(error).removeprefix("expected ")
        raise HistoryError(f"time zone '{name[:64]}'", expected) from error


def edges(start_ns: int, stop_ns: int, resolution: Resolution, zone: ZoneInfo) -> list[int]:
    """Return where parts of a time begin, the first at or before it, and their end. [ns]"""
    if resolution == "all":
        return [start_ns, stop_ns]
    if resolution in FIXED:
        length = FIXED[resolution]
        offset = local_time(start_ns, zone).utcoffset() or timedelta()
        shift = int(offset.total_seconds()) * SECOND_NS % length
        first = (start_ns + shift) // length * length - shift
        if (stop_ns - first) // length >= MAX_BUCKETS:
            raise HistoryError(
                f"{(stop_ns - first) // length} parts of a {resolution}",
                f"at most {MAX_BUCKETS}", "a shorter time, or a coarser resolution",
            )  # fmt: skip
        return [*range(first, stop_ns, length), -(-(stop_ns - first) // length) * length + first]
    day = _first(local_time(start_ns, zone).date(), resolution)
    found = [day_begin(day, zone)]
    while found[-1] < stop_ns:
        day = _next(day, resolution)
        found.append(day_begin(day, zone))
    return found


def robots_of(connection: sqlite3.Connection, names: Sequence[str] = ()) -> dict[str, int]:
    """Return the numbers of robots by name, those of all where none is named."""
    known: dict[str, int] = dict(
        connection.execute("SELECT name, id FROM robot ORDER BY name").fetchall()
    )
    for name in names:
        if name not in known:
            raise HistoryError(f"no robot '{name}' in the history", ", ".join(known) or "a robot")
    return {name: known[name] for name in names or known}


def sums(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int], *,
    table: Literal["slot", "joint"] = "slot", minutes: bool = False,
) -> TimeSeries:  # fmt: skip
    """Return the sums of all slots that lie within each part, in order of time and robot.

    They are of the days, hours and quarters that it is made of, and of spans within it.
    """
    _put_pieces(connection, robots, list(pairwise(bounds)), minutes)
    by_joint = table == "joint"
    by, values = (", s.joint", JOINT_SUMS) if by_joint else ("", f"{SUMS}, {PEAK}, {FLAGS}")
    rows: list[tuple[Any, ...]] = []
    for source in _SPANS if minutes else (*_REGULAR, _IRREGULAR):
        number = "p.id" if source is _IRREGULAR else "p.part"
        rows += connection.execute(
            f"SELECT r.name, {number}{by or ', 0'}, {values} FROM {source.format(table=table)} "
            f"GROUP BY p.id, r.id{by}"
        )
    names = JOINT_COLUMNS if by_joint else _SLOT_COLUMNS
    robot, part, joint, *numbers = _transposed(rows, 3 + len(names))
    keys = [np.array(part, np.int64), np.array(robot, str), np.array(joint, str)]
    order = np.lexsort(keys[::-1] if by_joint else keys[1::-1])
    keys = [key[order] for key in keys]
    new = np.ones(len(order), bool)
    new[1:] = np.any([key[1:] != key[:-1] for key in keys], axis=0)
    firsts = np.flatnonzero(new)
    part, robot, joint = (key[firsts] for key in keys)
    edges = np.array(bounds, np.int64)
    columns: dict[str, Column] = {"robot": robot, "stop_ns": edges[1:][part]}
    if by_joint:
        columns["joint"] = joint
    ways = {"peak_minute_microjoule": np.maximum, "flags": np.bitwise_or}
    for name, column in zip(names, numbers, strict=True):
        own = np.array(column, np.int64)[order]
        columns[name] = ways.get(name, np.add).reduceat(own, firsts) if len(own) else own
    return TimeSeries(edges[:-1][part], columns, units=_units(columns))


def _units(names: Iterable[str]) -> dict[str, str]:
    units = {"_ns": "ns", "_microjoule": "uJ", "_meter": "uJ", "_part": "uJ"}
    return {name: unit for name in names for end, unit in units.items() if name.endswith(end)}


def _put_pieces(
    connection: sqlite3.Connection, robots: dict[str, int], parts: Sequence[tuple[int, int]],
    minutes: bool = False,
) -> None:  # fmt: skip
    """Put parts of time, what they are made of and robots where a query joins them."""
    until = Rolled.of(connection).until_ns
    put_parts(connection, robots, parts)
    connection.executemany(
        "INSERT INTO temp.piece (length, start, stop, part) VALUES (?, ?, ?, ?)",
        (
            (*piece, part)
            for part, (start, stop) in enumerate(parts)
            for piece in ([(MINUTE_NS, start, stop)] if minutes else pieces(start, stop, until))
        ),
    )


def pieces(start_ns: int, stop_ns: int, until_ns: int) -> Iterator[tuple[int, int, int]]:
    """Yield length, begin and end of days, hours, quarters, up to where they are rolled up. [ns]"""

    def cut(start: int, stop: int, lengths: tuple[int, ...]) -> Iterator[tuple[int, int, int]]:
        if start >= stop:
            return
        length, *finer = lengths
        if not finer:
            yield length, start, stop
            return
        first, last = -(-start // length) * length, min(stop // length * length, until_ns)
        if first >= last:
            yield from cut(start, stop, tuple(finer))
            return
        yield from cut(start, first, tuple(finer))
        yield length, first, last
        yield from cut(last, stop, tuple(finer))

    yield from cut(start_ns, stop_ns, (DAY_NS, HOUR_NS, SLOT_NS))


def not_resolved(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int], *,
    minutes: bool = False,
) -> TimeSeries:  # fmt: skip
    """Return the spans that lie in no part, with their true begin and end, in order of time."""
    first, last = bounds[0], bounds[-1]
    put_parts(connection, robots, pairwise(bounds))
    own = "some r CROSS JOIN slot15 s", "s.flags & 1", -1, last
    if minutes:  # spans within a quarter hour are resolved there
        which = f"s.flags & 1 AND s.start / {SLOT_NS} = (s.stop - 1) / {SLOT_NS}"
        finer = "slot1 s CROSS JOIN some r", which, first - SLOT_NS, last
    else:
        kept = min(Rolled.of(connection).quarters_from_ns, last)
        finer = "some r CROSS JOIN slot60 s", "1", first - HOUR_NS, kept
    columns = ", ".join(f"s.{name}" for name in COLUMNS)
    rows: list[tuple[Any, ...]] = connection.execute(
        " UNION ALL ".join(
            f"SELECT s.start, r.name, s.stop, {columns}, 0, s.flags FROM {tables} "
            f"ON s.robot = r.id AND s.start >= {begin} AND s.start < {end} WHERE {which} AND "
            f"s.stop > {first} AND NOT EXISTS (SELECT 1 FROM part p WHERE {_WITHIN.format(on='s')})"
            for tables, which, begin, end in (own, finer)
        ) + " ORDER BY 1, 2"
    ).fetchall()  # fmt: skip
    return span_table(rows)


def span_table(rows: Sequence[tuple[Any, ...]]) -> TimeSeries:
    """Return spans: of each begin [ns], robot, end [ns], by `COLUMNS`, peak [uJ], flags."""
    return table_of(rows, {"robot": str, "stop_ns": int, **dict.fromkeys(_SLOT_COLUMNS, int)})


def table_of(rows: Sequence[tuple[Any, ...]], kinds: Mapping[str, type]) -> TimeSeries:
    """Return rows as a table: of each a stamp [ns], then what the columns of these kinds hold."""
    stamps, *values = _transposed(rows, 1 + len(kinds))
    columns: dict[str, Column] = {
        name: np.array(column, kind)
        for (name, kind), column in zip(kinds.items(), values, strict=True)
    }
    return TimeSeries(np.array(stamps, np.int64), columns, units=_units(columns))


def rows_of(table: TimeSeries) -> list[dict[str, Any]]:
    """Return the rows of a table, each by the names of its columns."""
    flat = table.to_dict()
    columns = [values.tolist() for values in flat.values()]
    return [dict(zip(flat, values, strict=True)) for values in zip(*columns, strict=True)]


def _transposed(rows: Sequence[tuple[Any, ...]], width: int) -> list[tuple[Any, ...]]:
    return list(zip(*rows, strict=True)) or [()] * width


def jobs(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int],
    names: Sequence[str] = JOB_SUMS,
) -> list[tuple[Any, ...]]:  # fmt: skip
    """Return the jobs that ended in each part, in order of time and robot, the largest first.

    Returns:
        Begin of the part [ns], robot, end [ns], name, how many, and their sums [ns], [uJ].
    """
    parts, used = list(pairwise(bounds)), 1 + names.index("predicted_import_microjoule")
    _put_pieces(connection, robots, parts)
    found: dict[tuple[int, str, str], tuple[int, ...]] = {}
    for source, count in _JOBS:
        for part, robot, name, *own in connection.execute(
            f"SELECT p.part, r.name, j.name, {count}, "
            f"{', '.join(f'sum(j.{name})' for name in names)} FROM piece p CROSS JOIN some r "
            f"CROSS JOIN {source} GROUP BY p.id, r.id, j.name"
        ):
            key = (part, robot, name)
            held = found.get(key)
            found[key] = tuple(own if held is None else map(add, own, held))
    order = sorted(found.items(), key=lambda one: (one[0][:2], -one[1][used], one[0][2]))
    return [
        (parts[part][0], robot, parts[part][1], name, *values)
        for (part, robot, name), values in order
    ]


def events(
    connection: sqlite3.Connection, robots: dict[str, int], start_ns: int, stop_ns: int
) -> list[tuple[int, str, str, str]]:
    """Return stamp [ns], robot, kind and text of events in a time, in order of time."""
    put_parts(connection, robots, [])
    return connection.execute(
        "SELECT e.stamp, r.name, e.kind, e.text FROM some r CROSS JOIN event e ON e.robot = r.id "
        "AND e.stamp >= ? AND e.stamp < ? ORDER BY e.stamp, r.name, e.kind",
        (start_ns, stop_ns),
    ).fetchall()


def learned_friction(
    connection: sqlite3.Connection, robots: dict[str, int], bounds: Sequence[int]
) -> list[tuple[Any, ...]]:
    """Return what was learned of the friction of each joint in each part of a time.

    Returns:
        Begin, end [ns], robot, joint, model that it is relative to, how many UTC days, their mean
        ratio, the least and the greatest [-]; in order of time, robot and joint.
    """
    put_parts(connection, robots, pairwise(bounds))
    return connection.execute(
        "SELECT p.start, p.stop, r.name, f.joint, f.model_id, count(*), avg(f.ratio), "
        "min(f.ratio), max(f.ratio) FROM some r CROSS JOIN friction f ON f.robot = r.id AND "
        "f.day >= ? AND f.day < ? JOIN part p ON f.stamp >= p.start AND f.stamp < p.stop "
        "GROUP BY p.id, r.id, f.joint, f.model_id ORDER BY p.id, r.name, f.joint, min(f.stamp)",
        (bounds[0] - DAY_NS, bounds[-1]),
    ).fetchall()


def put_parts(connection: sqlite3.Connection, robots: dict[str, int], parts: Any) -> None:
    """Put parts of time and robots where a query joins them."""
    for name, columns in (
        ("part", "id INTEGER PRIMARY KEY, start INTEGER, stop INTEGER"),
        ("piece", "id INTEGER PRIMARY KEY, length INTEGER, start INTEGER, stop INTEGER, part"),
        ("some", "id INTEGER PRIMARY KEY, name TEXT"),
    ):
        connection.execute(f"CREATE TEMP TABLE IF NOT EXISTS {name} ({columns})")
        connection.execute(f"DELETE FROM temp.{name}")
    connection.executemany(
        "INSERT INTO temp.part VALUES (?, ?, ?)",
        ((number, *one) for number, one in enumerate(parts)),
    )
    connection.executemany(
        "INSERT INTO temp.some VALUES (?, ?)", ((number, name) for name, number in robots.items())
    )


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
