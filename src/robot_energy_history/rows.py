"""Rows of the tables: what one span adds to them, readings as text, jobs and their sums.

Sums of jobs by name, UTC hour and day are those of the jobs always. Jobs, events and learned
friction wait here for the disk.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any, TypeVar

from robot_energy.foundation.units import DAY_NS, MINUTE_NS
from robot_energy_history.differences import CountedSpan, Epoch, Event
from robot_energy_history.files import JOB_COLUMNS, JOB_SUMS, LEVELS, ROLL_JOBS
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


_HELD = ", ".join(JOB_COLUMNS)
_ADD = {
    level: f"INSERT INTO job{level} (robot, start, name, jobs, {', '.join(JOB_SUMS)}) VALUES "
    f"({', '.join('?' * (4 + len(JOB_SUMS)))}) ON CONFLICT DO UPDATE SET "
    + ", ".join(f"{name} = {name} + excluded.{name}" for name in ("jobs", *JOB_SUMS))
    for level in LEVELS
}


def put_job(
    connection: sqlite3.Connection, until_ns: int, robot: int, job: Mapping[str, Any]
) -> None:
    """Put a job in, by `JOB_COLUMNS`, perhaps in place of itself; sums go up to ``until_ns``."""
    held = connection.execute(
        f"SELECT {_HELD} FROM job WHERE robot = ? AND start = ? AND id = ?",
        (robot, job["start"], job["id"]),
    ).fetchone()
    row = tuple(job[name] for name in JOB_COLUMNS)
    if held == row:  # monitors list a job for as long as they keep it
        return
    if held is not None:
        _add(connection, until_ns, robot, held, -1)
    connection.execute(
        f"INSERT OR REPLACE INTO job (robot, {_HELD}) VALUES (?, {', '.join('?' * len(row))})",
        (robot, *row),
    )
    _add(connection, until_ns, robot, row, 1)


def drop_jobs(
    connection: sqlite3.Connection, until_ns: int, robot: int, first_id: int, last_id: int
) -> None:
    """Take jobs out by their numbers, both ends included; sums go up to ``until_ns``."""
    which = "FROM job WHERE robot = ? AND id >= ? AND id <= ?"
    span = (robot, first_id, last_id)
    for row in connection.execute(f"SELECT {_HELD} {which}", span).fetchall():
        _add(connection, until_ns, robot, row, -1)
    connection.execute(f"DELETE {which}", span)


def roll_jobs(connection: sqlite3.Connection, after_ns: int, until_ns: int) -> None:
    """Roll up the jobs that ended after one midnight and up to another. [ns]"""
    for level in LEVELS:
        connection.execute(ROLL_JOBS[level], (after_ns, until_ns))


def roll_jobs_again(connection: sqlite3.Connection, until_ns: int) -> None:
    """Make all sums of jobs again. [ns]"""
    for level in LEVELS:
        connection.execute(f"DELETE FROM job{level}")
    roll_jobs(connection, 0, until_ns)


def unlike_jobs(connection: sqlite3.Connection, until_ns: int) -> list[str]:
    """Return which sums are not those of their jobs, a sentence each. [ns]"""
    found: list[str] = []
    for level in LEVELS:
        columns = f"robot, start, name, jobs, {', '.join(JOB_SUMS)}"
        counted = ROLL_JOBS[level].partition(" SELECT ")[2]
        held = set(connection.execute(f"SELECT {columns} FROM job{level}"))
        wrong = held ^ set(connection.execute(f"SELECT {counted}", (0, until_ns)))
        if wrong:
            found.append(f"job{level} and job differ in {len({row[:3] for row in wrong})} rows")
    return found


def _add(
    connection: sqlite3.Connection, until_ns: int, robot: int, row: tuple[Any, ...], sign: int
) -> None:
    """Add a job to the sums of its hour and day, or take it from them."""
    job: dict[str, Any] = dict(zip(JOB_COLUMNS, row, strict=True))
    if (job["stop"] - 1) // DAY_NS * DAY_NS >= until_ns:
        return
    for level in LEVELS:
        length = level * MINUTE_NS
        start = (job["stop"] - 1) // length * length
        values = (sign * job[name] for name in JOB_SUMS)
        connection.execute(_ADD[level], (robot, start, job["name"], sign, *values))
        if sign < 0:
            connection.execute(
                f"DELETE FROM job{level} WHERE robot = ? AND start = ? AND name = ? AND jobs = 0",
                (robot, start, job["name"]),
            )


MAX_JOBS = 24_000  # that wait
MAX_EVENTS = 10_000  # that wait
MAX_FRICTION = 10_000  # days of robots that wait


@dataclass
class WaitingNotes:
    """Jobs, events and learned friction of robots that wait; of too many the oldest go."""

    _jobs: dict[tuple[str, int, int], Mapping[str, Any]] = field(
        default_factory=dict[tuple[str, int, int], Mapping[str, Any]]
    )
    _events: list[tuple[str, Event]] = field(default_factory=list[tuple[str, Event]])
    _friction: dict[tuple[str, int], LearnedFriction] = field(
        default_factory=dict[tuple[str, int], LearnedFriction]
    )

    def add_jobs(self, robot: str, jobs: Iterable[Mapping[str, Any]]) -> None:
        """Take job intervals, by `JOB_COLUMNS`."""
        for job in jobs:
            self._jobs[robot, int(job["start"]), int(job["id"])] = job
        _shorten(self._jobs, MAX_JOBS)

    def add_events(self, robot: str, events: Iterable[Event]) -> None:
        """Take events."""
        self._events += ((robot, one) for one in events)
        del self._events[:-MAX_EVENTS]

    def add_friction(self, robot: str, learned: Iterable[LearnedFriction]) -> None:
        """Take what was learned of friction; of a UTC day the newest stays."""
        for one in learned:
            self._friction[robot, one.stamp_ns // DAY_NS] = one
        _shorten(self._friction, MAX_FRICTION)

    def add(self, newer: WaitingNotes) -> None:
        """Take what came later."""
        self._jobs |= newer._jobs
        self._events += newer._events
        self._friction |= newer._friction

    def write(
        self, connection: sqlite3.Connection, until_ns: int, number: Callable[[str], int]
    ) -> int:
        """Return how many the tables cannot hold, of all that is put into a history."""
        jobs = (
            (robot, partial(put_job, connection, until_ns), job)
            for (robot, _, _), job in self._jobs.items()
        )
        events = ((robot, partial(put_events, connection), [one]) for robot, one in self._events)
        friction = ((robot, partial(put_friction, connection), one)
                    for (robot, _), one in self._friction.items())  # fmt: skip
        return sum(
            not attempt(connection, partial(_done, put, number(robot), one))
            for robot, put, one in chain[tuple[str, Callable[[int, Any], None], Any]](
                jobs, events, friction
            )
        )


def _done(put: Callable[[int, Any], None], robot: int, one: Any) -> bool:
    put(robot, one)
    return True


def _shorten(held: dict[Any, Any], most: int) -> None:
    while len(held) > most:
        del held[next(iter(held))]
