"""Rows of the tables: what one span adds to them, and readings as text."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from robot_energy.foundation.units import DAY_NS
from robot_energy_history.database import LEVELS
from robot_energy_history.differences import CountedSpan, Epoch, Event
from robot_energy_history.readings import COLUMNS, JOINT_COLUMNS, LearnedFriction, Reading

T = TypeVar("T")


def _upsert(table: str, key: str, columns: Sequence[str], further: str = "") -> str:
    names = [*key.split(), *columns]
    added = [f"{name} = {name} + excluded.{name}" for name in columns if name not in further]
    if further:
        added += ["flags = flags | excluded.flags",
                  "peak_microjoule = max(peak_microjoule, excluded.peak_microjoule)"]  # fmt: skip
    return (
        f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))}) "
        f"ON CONFLICT DO UPDATE SET {', '.join(added)}"
    )


_KEY = "start robot epoch stop"
SLOTS = {
    level: _upsert(f"slot{level}", _KEY, ("flags", "peak_microjoule", *COLUMNS), "flags "
                   "peak_microjoule") + " RETURNING predicted_import_microjoule"
    for level in (1, 15, *LEVELS)
}  # fmt: skip
JOINTS = {
    level: _upsert(f"joint{level}", f"{_KEY} joint", JOINT_COLUMNS) for level in (15, *LEVELS)
}


def attempt(connection: sqlite3.Connection, work: Callable[[], T]) -> T | None:
    """Return what work on the tables does; None, with none of it, where they cannot hold a value.

    So what one robot sends keeps no other from being written. A failing disk refuses nothing.
    """
    connection.execute("SAVEPOINT attempt")
    try:
        done = work()
    except (OverflowError, UnicodeError, sqlite3.IntegrityError):
        connection.execute("ROLLBACK TO attempt")
        connection.execute("RELEASE attempt")
        return None
    connection.execute("RELEASE attempt")
    return done


def put_slot(
    connection: sqlite3.Connection, level: int, key: tuple[int, ...], span: CountedSpan
) -> int:
    """Add a span to a slot of a level [min].

    Returns:
        The energy from the grid in the slot. [uJ]
    """
    ((imported,),) = connection.execute(SLOTS[level], (*key, *span.values)).fetchall()
    if level in JOINTS:
        connection.executemany(
            JOINTS[level],
            ((*key[:4], name, *own) for name, own in span.joints.items() if any(own)),
        )
    return int(imported)


def put_epoch(
    connection: sqlite3.Connection, robot: int, origin: str, epoch: Epoch, number: int
) -> int:
    """Return the number of an epoch whose state is noted; 0 makes a new one."""
    texts = (text_of(epoch.last), epoch.known_until_ns, epoch.newest_ns)
    if number:
        connection.execute(
            "UPDATE epoch SET last = ?, known_until = ?, newest = ? WHERE id = ?", (*texts, number)
        )
        return number
    row = connection.execute(
        "INSERT INTO epoch (robot, origin, energy_start, first, last, known_until, newest) "
        "VALUES (?, ?, ?, ?, ?, ?, ?)",
        (robot, origin, epoch.last.energy_start_ns, text_of(epoch.first), *texts),
    )
    return int(row.lastrowid or 0)


def put_events(connection: sqlite3.Connection, robot: int, events: Iterable[Event]) -> None:
    """Note events; one that is there already stays."""
    connection.executemany(
        "INSERT OR IGNORE INTO event VALUES (?, ?, ?, ?)",
        ((robot, one.stamp_ns, one.kind, one.text) for one in events),
    )


def put_friction(connection: sqlite3.Connection, robot: int, one: LearnedFriction) -> None:
    """Note what was learned of the friction of each joint; the newest of a UTC day stays."""
    day = one.stamp_ns // DAY_NS * DAY_NS
    connection.executemany(
        "INSERT INTO friction VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET "
        "stamp = excluded.stamp, model_id = excluded.model_id, ratio = excluded.ratio "
        "WHERE excluded.stamp >= stamp",
        (
            (robot, day, joint, one.stamp_ns, one.model_id, ratio)
            for joint, ratio in one.ratios.items()
        ),
    )


def reading_from(text: str) -> Reading:
    """Return a reading as it was stored."""
    plain: dict[str, Any] = json.loads(text)
    values, joints = tuple(plain.pop("values")), plain.pop("joints")
    return Reading(**plain, values=values, joints={k: tuple(v) for k, v in joints.items()})


def text_of(reading: Reading) -> str:
    """Return a reading as it is stored."""
    return json.dumps(vars(reading))
