"""Jobs and their sums by name, UTC hour and day, which are those of the jobs always."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from typing import Any

from robot_energy.foundation.units import DAY_NS, MINUTE_NS
from robot_energy_history.database import JOB_COLUMNS, JOB_SUMS, LEVELS, ROLL_JOBS

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
