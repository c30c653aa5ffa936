"""Checks a history against the registers that it was made from, and repairs it."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from operator import itemgetter
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import DAY_NS, HOUR_NS, MINUTE_NS
from robot_energy_history.database import (
    DAMAGED,
    FILE,
    LEVELS,
    TABLES,
    VERSION,
    open_reader,
    open_writer,
    prepare,
    require_version,
    take_lock,
    version_of,
)
from robot_energy_history.differences import REPAIRED, CountedSpan, Event
from robot_energy_history.jobs import unlike_jobs
from robot_energy_history.readings import COLUMNS, GAP, JOINT_COLUMNS, OBSERVED, Reading
from robot_energy_history.rollup import MAX_DAYS, REGULAR, Rolled, curves_of, put_span, roll_again
from robot_energy_history.rows import put_events, reading_from

MAX_ASIDE = 20
Missing = tuple[int, int, str, Reading, Reading, tuple[int, ...], dict[str, tuple[int, ...]]]
"""Number of robot and epoch, name, first and last reading, and what slots and joints lack."""


def check(folder: str | Path) -> list[str]:
    """Return what is wrong with a history; nothing is changed.

    Sums of slots must be the difference of the registers, to the microjoule, of every robot, and
    hours and days those of the quarter hours that they were made from.
    """
    with closing(open_reader(folder)) as connection:
        try:
            found = [
                str(row[0])
                for row in connection.execute("PRAGMA quick_check(10)")
                if row[0] != "ok"
            ]
            return found or [*map(_said, _missing(connection)), *_unlike(connection)]
        except DAMAGED as error:
            return [f"the file is damaged: {error}"]


def repair(folder: str | Path, now_ns: int) -> list[str]:
    """Repair a history: what can be read of a damaged file is kept, and sums are made right.

    Of quarter hours that cannot be read, hours hold the sums. What a sum lacks still is put in as
    one span over the whole time of these registers, marked as repaired: it is known how much it
    was, not when.

    Returns:
        What was done, a sentence each.
    """
    path = Path(folder).expanduser() / FILE
    if not path.is_file():
        raise HistoryError(f"there is no history in {path.parent}", FILE)
    lock = take_lock(path.parent)
    try:
        said = [_rewritten(path)] if check_file(path) else []
        with closing(open_writer(path.parent)) as connection:
            prepare(connection, path)
            connection.execute("BEGIN IMMEDIATE")
            rolled = Rolled.of(connection)
            if said:
                for robot, epoch, span in _lost_of_hours(connection, rolled):
                    put_span(connection, rolled, robot, epoch, span)
            if said or _unlike(connection):
                said += _unlike(connection)
                roll_again(connection, rolled)
            for one in _missing(connection):
                robot, epoch, _, first, last, lacking, joints = one
                span = CountedSpan(first.stamp_ns, last.stamp_ns, lacking, joints, REPAIRED)
                put_span(connection, rolled, robot, epoch, span)
                put_events(connection, robot, [Event(now_ns + epoch, "repair", _said(one))])
                said.append(f"{_said(one)}; it is now one span over all of their time")
            connection.execute("COMMIT")
        return said
    except DAMAGED as error:
        raise HistoryError(f"{path} cannot be repaired ({error})", "a disk with space") from error
    finally:
        os.close(lock)


def check_file(path: Path) -> str:
    """Return what is wrong with a file as a database; empty if nothing is."""
    try:
        with closing(sqlite3.connect(path)) as connection:
            rows = [str(row[0]) for row in connection.execute("PRAGMA quick_check(1)")]
            version = version_of(connection)
            columns = _columns(connection)
    except DAMAGED as error:
        return str(error)
    if version:
        require_version(version, path)
        with closing(sqlite3.connect(":memory:")) as fresh:
            fresh.executescript(TABLES)
            if not _columns(fresh) <= columns:
                return "its tables have other columns"
    return "" if rows == ["ok"] else rows[0]


def _columns(connection: sqlite3.Connection) -> set[tuple[str, str]]:
    return set(
        connection.execute(
            "SELECT t.name, c.name FROM sqlite_master t, pragma_table_info(t.name) c"
        )
    )


def _missing(connection: sqlite3.Connection) -> list[Missing]:
    """Epochs whose slots do not add up to the difference of their readings."""
    kept = (Rolled.of(connection).quarters_from_ns,)
    sums = ", ".join(f"total_{name}" for name in COLUMNS)
    inner = ", ".join(f"sum({name}) AS total_{name}" for name in COLUMNS)
    rows = connection.execute(
        f"SELECT e.id, e.robot, r.name, e.first, e.last, {sums} FROM epoch e JOIN robot r ON "
        f"r.id = e.robot LEFT JOIN (SELECT epoch, {inner} FROM ({_both('slot', COLUMNS)}) "
        "GROUP BY epoch) s ON s.epoch = e.id",
        kept,
    ).fetchall()
    of_joints: dict[int, dict[str, tuple[int, ...]]] = {}
    for epoch, joint, *values in connection.execute(
        f"SELECT epoch, joint, {', '.join(f'sum({name})' for name in JOINT_COLUMNS)} FROM "
        f"({_both('joint', ('joint', *JOINT_COLUMNS))}) GROUP BY epoch, joint",
        kept,
    ):
        of_joints.setdefault(epoch, {})[joint] = tuple(values)
    found: list[Missing] = []
    none = (0,) * len(JOINT_COLUMNS)
    for epoch, robot, name, first_text, last_text, *held in rows:
        first, last = reading_from(first_text), reading_from(last_text)
        lacking = tuple(
            b - a - (own or 0) for a, b, own in zip(first.values, last.values, held, strict=True)
        )
        held_joints = of_joints.get(epoch, {})
        joints = {
            joint: tuple(
                b - a - c
                for a, b, c in zip(
                    first.joints.get(joint, none), own, held_joints.get(joint, none), strict=True
                )
            )
            for joint, own in last.joints.items()
        }
        if any(lacking) or any(map(any, joints.values())):
            found.append((robot, epoch, name, first, last, lacking, joints))
    return found


def _lost_of_hours(
    connection: sqlite3.Connection, rolled: Rolled
) -> list[tuple[int, int, CountedSpan]]:
    """What hours hold and their quarter hours lack, as spans of robots and epochs."""
    joints: dict[tuple[int, int, int], dict[str, tuple[int, ...]]] = {}
    for key, joint, lacking in _less_quarters(connection, rolled, "joint", JOINT_COLUMNS):
        joints.setdefault(key, {})[joint] = lacking
    own = {key: lacking for key, _, lacking in _less_quarters(connection, rolled, "slot", COLUMNS)}
    none = (0,) * len(COLUMNS)
    found: list[tuple[int, int, CountedSpan]] = []
    for key in sorted({*own, *joints}):
        robot, epoch, start = key
        lacking = own.get(key, none)
        if min(lacking[OBSERVED], lacking[GAP]) >= 0:
            span = CountedSpan(start, start + HOUR_NS, lacking, joints.get(key, {}), REPAIRED)
            found.append((robot, epoch, span))
    return found


def _less_quarters(
    connection: sqlite3.Connection, rolled: Rolled, table: str, columns: Sequence[str]
) -> Iterator[tuple[tuple[int, int, int], str, tuple[int, ...]]]:
    """Robot, epoch, begin, joint and sums of each hour less those of its quarters, where not 0."""
    joint = "joint" if table == "joint" else "''"
    rows = " UNION ALL ".join(
        f"SELECT robot, epoch, start / {HOUR_NS} * {HOUR_NS} AS hour, {joint} AS joint, "
        f"{', '.join(f'{sign}{name} AS {name}' for name in columns)}, {own} AS own "
        f"FROM {table}{level} s WHERE start >= {rolled.quarters_from_ns} AND "
        f"start < {rolled.until_ns} AND {REGULAR.format(length=level * MINUTE_NS)}"
        for level, sign, own in ((60, "", 1), (15, "-", 0))
    )
    sums = [f"sum({name})" for name in columns]
    for robot, epoch, start, part, *lacking in connection.execute(
        f"SELECT robot, epoch, hour, joint, {', '.join(sums)} FROM ({rows}) "
        f"GROUP BY 1, 2, 3, 4 HAVING max(own) AND ({' OR '.join(sums)})"
    ):
        yield (robot, epoch, start), part, tuple(lacking)


def _both(table: str, columns: Sequence[str]) -> str:
    """Quarter hours, and hours of the days of which these are not kept."""
    names = ", ".join(("epoch", *columns))
    return f"SELECT {names} FROM {table}15 UNION ALL SELECT {names} FROM {table}60 WHERE start < ?"


def _unlike(connection: sqlite3.Connection) -> list[str]:
    """Levels that do not add up to what they were rolled up from, a sentence each."""
    rolled = Rolled.of(connection)
    found: list[str] = []
    for table, by, columns in (("slot", "", COLUMNS), ("joint", ", joint", JOINT_COLUMNS)):
        sums = ", ".join(f"sum({name})" for name in columns)
        of: dict[int, set[Any]] = {}
        for level in (15, *LEVELS):
            length = level * MINUTE_NS
            of[level] = set(
                connection.execute(
                    f"SELECT robot, epoch, start / {DAY_NS}{by}, {sums} FROM {table}{level} s "
                    f"WHERE start >= ? AND start < ? AND {REGULAR.format(length=length)} "
                    f"GROUP BY robot, epoch, start / {DAY_NS}{by}",
                    (rolled.quarters_from_ns, rolled.until_ns),
                )
            )
        found += [
            f"{table}{level} and {table}15 differ on {len(own)} days of robots"
            for level in LEVELS
            if (own := {row[:3] for row in of[level] ^ of[15]})
        ]
    imported = {
        divmod(number, MAX_DAYS): int(curves_of([blob])[0, :, 0].sum())
        for number, blob in connection.execute("SELECT id, energy FROM curve")
    }
    days = {
        (robot, start // DAY_NS): used
        for robot, start, used in connection.execute(
            "SELECT robot, start, sum(predicted_import_microjoule) FROM slot1440 "
            "GROUP BY robot, start"
        )
    }
    if wrong := len(imported.items() ^ days.items()):
        found.append(f"curves and slot1440 differ in {wrong} rows")
    return found + unlike_jobs(connection, rolled.until_ns)


def _said(one: Missing) -> str:
    _, epoch, name, _, _, lacking, joints = one
    wrong = [
        f"{column} {value:+d}" for column, value in zip(COLUMNS, lacking, strict=True) if value
    ]
    wrong += [f"{joint} {value:+d} uJ" for joint, own in joints.items() for value in own if value]
    return f"{name}: slots and registers {epoch} differ: {', '.join(wrong[:3])}" + (
        f" and {len(wrong) - 3} more" if len(wrong) > 3 else ""
    )


def _rewritten(path: Path) -> str:
    """Put all rows that can be read into a new file; the damaged one is moved aside."""
    fresh = path.with_name(f"{path.name}.repaired")
    fresh.unlink(missing_ok=True)
    lost = 0
    with closing(sqlite3.connect(fresh, isolation_level=None)) as target:
        fresh.chmod(0o600)
        for statement in TABLES.split(";"):
            target.execute(statement)
        target.execute("BEGIN")
        with closing(sqlite3.connect(path, isolation_level=None)) as source:
            for (table,) in target.execute(
                "SELECT name FROM sqlite_master WHERE type = 'table'"
            ).fetchall():
                lost += _copied(source, target, table)
        target.execute("COMMIT")
        target.execute(f"PRAGMA user_version = {VERSION}")
    for number in range(1, MAX_ASIDE + 1):
        aside = path.with_name(f"{path.name}.bad-{number}")
        if not aside.exists():
            break
    else:
        raise HistoryError(f"{MAX_ASIDE} damaged files lie next to {path}", "fewer", "move them")
    path.rename(aside)
    for end in ("-wal", "-shm"):
        path.with_name(path.name + end).unlink(missing_ok=True)
    fresh.rename(path)
    return (
        f"{path.name} was damaged and is written again, {lost} of its tables in part; "
        f"{aside.name} is as before"
    )


def _copied(source: sqlite3.Connection, target: sqlite3.Connection, table: str) -> int:
    """Copy the rows of a table that can be read; return whether it is damaged.

    Rows next to each other in a file are of many robots: where a key range cannot be read, each of
    its halves is tried.
    """
    try:
        info = [(str(r[1]), str(r[2]), r[5]) for r in source.execute(f"PRAGMA table_info({table})")]
    except DAMAGED:
        return 1
    put = f"INSERT OR IGNORE INTO {table} VALUES ({', '.join('?' * len(info))})"
    keys = [(name, kind) for name, kind, place in sorted(info, key=itemgetter(2)) if place]

    def read(which: str, order: str = "ASC") -> bool:
        by = ", ".join(f"{name} {order}" for name, _ in keys)
        try:
            for row in source.execute(f"SELECT * FROM {table} WHERE {which} ORDER BY {by}"):
                target.execute(put, row)
        except DAMAGED:
            return False
        return True

    def halve(which: str, key: str, first: int, last: int, least: int) -> None:
        if read(f"{which} AND {key} >= {first} AND {key} < {last}") or last - first <= least:
            return
        middle = (first + last) // 2
        halve(which, key, first, middle, least)
        halve(which, key, middle, last, least)

    if read("1"):
        return 0
    read("1", "DESC")
    robots, begin, end = target.execute(
        "SELECT max(robot), min(min(energy_start, newest)), max(newest) FROM epoch"
    ).fetchone()
    begin, end = (begin or 0) - DAY_NS, (end or 0) + DAY_NS
    match keys:
        case [("robot", _), (key, "INTEGER"), *_]:
            for robot in range(1, (robots or 0) + 1):
                halve(f"robot = {robot}", key, begin, end, HOUR_NS)
        case [("start", _), *_]:
            halve("1", "start", begin, end, MINUTE_NS)
        case [("id", "INTEGER")] if table == "curve":
            halve("1", "id", 0, MAX_DAYS * ((robots or 0) + 1), 1)
        case _:  # small: from both ends
            pass
    return 1
