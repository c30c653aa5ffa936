"""Quarter hours -> hours, days and curves of a day, once each UTC day.

Only regular slots are rolled up, and jobs by their names: a span with its own begin and end stays
in ``slot15`` alone. What comes late is added to all. Sums are of whole numbers, so every level adds
up to the same.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.units import DAY_NS, MINUTE_NS
from robot_energy_history.database import LEVELS
from robot_energy_history.differences import SLOT_NS, UNRESOLVED, CountedSpan
from robot_energy_history.jobs import roll_jobs, roll_jobs_again
from robot_energy_history.readings import COLUMNS, IMPORT, JOINT_COLUMNS
from robot_energy_history.rows import put_slot

QUARTERS = DAY_NS // SLOT_NS
MAX_DAYS = 2**20  # since 1970, of which stamps reach 106,751
STANDBY = COLUMNS.index("standby_microjoule")
DAYS_AT_ONCE = 7  # that one transaction rolls up or thins
MINUTES_AT_ONCE = 20_000  # rows of minutes that one transaction drops
LATE_NS = 15 * MINUTE_NS  # after its end a day is rolled up [ns]
REGULAR = "s.stop - s.start = {length} AND s.start % {length} = 0"
FLAGS = "max(s.flags & 2) | max(s.flags & 4) | max(s.flags & 8)"


class Rolled(Described):
    """Up to where a history is rolled up."""

    until_ns: Annotated[int, "Begin of the first UTC day that is not. [ns]"] = 0
    quarters_from_ns: Annotated[int, "Begin of the first UTC day with quarter hours. [ns]"] = 0

    @classmethod
    def of(cls, connection: sqlite3.Connection) -> Rolled:
        """Return where a history stands."""
        rows = dict(
            connection.execute(
                "SELECT name, value FROM meta WHERE name IN ('rolled_until', 'quarters_from')"
            ).fetchall()
        )
        return cls(int(rows.get("rolled_until", 0)), int(rows.get("quarters_from", 0)))

    def write(self, connection: sqlite3.Connection) -> None:
        """Note it in the file."""
        connection.executemany(
            "INSERT OR REPLACE INTO meta VALUES (?, ?)",
            (
                ("rolled_until", str(self.until_ns)),
                ("quarters_from", str(self.quarters_from_ns)),
            ),
        )


def put_span(
    connection: sqlite3.Connection, rolled: Rolled, robot: int, epoch: int, span: CountedSpan
) -> None:
    """Add a span to its minute and its quarter hour, and to all that is rolled up from these."""
    start, stop, flags = span.slot(MINUTE_NS)
    minute = put_slot(connection, 1, (start, robot, epoch, stop, flags, 0), span)
    peak = minute if stop - start == MINUTE_NS else 0
    start, stop, flags = span.slot(SLOT_NS)
    own = bool(flags & UNRESOLVED)
    if own or start >= rolled.quarters_from_ns:
        put_slot(connection, 15, (start, robot, epoch, stop, flags, peak), span)
    if own or start >= rolled.until_ns:
        return
    for level in LEVELS:
        length = level * MINUTE_NS
        begin = start // length * length
        put_slot(connection, level, (begin, robot, epoch, begin + length, flags, peak), span)
    change_curve(connection, robot, start, span.values[IMPORT], span.values[STANDBY])


def change_curve(
    connection: sqlite3.Connection, robot: int, start_ns: int, imported: int, standby: int
) -> None:
    """Add energy to a quarter hour of a curve. [ns], [uJ]"""
    number = curve_id(robot, start_ns)
    row = connection.execute("SELECT energy FROM curve WHERE id = ?", (number,)).fetchone()
    curve = curves_of([row[0] if row else bytes(16 * QUARTERS)])[0].copy()
    curve[start_ns % DAY_NS // SLOT_NS] += (imported, standby)
    _put_curve(connection, number, curve)


def curve_id(robot: int, day_ns: int) -> int:
    """Return the number of the curve of a robot on a UTC day; those of a robot are in order."""
    return robot * MAX_DAYS + day_ns // DAY_NS


def curves_of(blobs: Sequence[bytes]) -> NDArray[np.int64]:
    """Return stored curves: energy from the grid and in standby of each quarter hour. [uJ]"""
    return np.frombuffer(b"".join(blobs), "<i8").reshape(-1, QUARTERS, 2)


def roll(connection: sqlite3.Connection, rolled: Rolled, now_ns: int) -> Rolled:
    """Roll up days that have ended, some at once.

    Returns:
        Up to where it is rolled up.
    """
    until, target = rolled.until_ns, (now_ns - LATE_NS) // DAY_NS * DAY_NS
    for _ in range(DAYS_AT_ONCE):
        day = _next_day(connection, until)
        if day is None or day >= target:
            until = max(until, target)
            break
        _roll_day(connection, day)
        until = day + DAY_NS
    roll_jobs(connection, rolled.until_ns, until)
    return Rolled(until, rolled.quarters_from_ns)


def thin(connection: sqlite3.Connection, rolled: Rolled, keep_from_ns: int) -> Rolled:
    """Return what it holds, once quarter hours of some old days that are rolled up are dropped."""
    begin = rolled.quarters_from_ns
    target = min(rolled.until_ns, keep_from_ns // DAY_NS * DAY_NS)
    for _ in range(DAYS_AT_ONCE):
        day = _next_day(connection, begin)
        if day is None or day >= target:
            begin = max(begin, target)
            break
        begin = day + DAY_NS
        for table in ("slot15", "joint15"):
            connection.execute(
                f"DELETE FROM {table} AS s WHERE s.robot IN (SELECT id FROM robot) AND "
                f"s.start >= ? AND s.start < ? AND {REGULAR.format(length=SLOT_NS)}", (day, begin),
            )  # fmt: skip
    return Rolled(rolled.until_ns, begin)


def forget_minutes(connection: sqlite3.Connection, before_ns: int) -> None:
    """Drop minutes that are too old, some at once. [ns]"""
    connection.execute(
        "DELETE FROM slot1 WHERE (start, robot, epoch, stop) IN (SELECT start, robot, epoch, "
        "stop FROM slot1 WHERE start < ? LIMIT ?)",
        (before_ns, MINUTES_AT_ONCE),
    )


def roll_again(connection: sqlite3.Connection, rolled: Rolled) -> None:
    """Make hours, days and curves again, from the quarter hours that are kept, and sums of jobs."""
    for level in LEVELS:
        for table in (f"slot{level}", f"joint{level}"):
            connection.execute(f"DELETE FROM {table} WHERE start >= ?", (rolled.quarters_from_ns,))
    connection.execute(
        f"DELETE FROM curve WHERE id % {MAX_DAYS} >= ?", (rolled.quarters_from_ns // DAY_NS,)
    )
    day = _next_day(connection, rolled.quarters_from_ns)
    while day is not None and day < rolled.until_ns:
        _roll_day(connection, day)
        day = _next_day(connection, day + DAY_NS)
    roll_jobs_again(connection, rolled.until_ns)


def _next_day(connection: sqlite3.Connection, from_ns: int) -> int | None:
    """The first UTC day with regular quarter hours, from one on."""
    (start,) = connection.execute(
        "SELECT min((SELECT s.start FROM slot15 s WHERE s.robot = r.id AND s.start >= ? AND "
        "NOT s.flags & 1 ORDER BY s.start LIMIT 1)) FROM robot r", (from_ns,),
    ).fetchone()  # fmt: skip
    return None if start is None else int(start) // DAY_NS * DAY_NS


def _roll_day(connection: sqlite3.Connection, day: int) -> None:
    whole = (
        "FROM robot r CROSS JOIN {table} s ON s.robot = r.id AND s.start >= ? AND s.start < ? "
        f"WHERE {REGULAR.format(length=SLOT_NS)}"
    )
    for level in LEVELS:
        begin = f"s.start / {level * MINUTE_NS} * {level * MINUTE_NS}"
        key = f"{begin} AS begin, s.robot, s.epoch, {begin} + {level * MINUTE_NS}"
        for table, further, columns, names in (
            ("slot", "flags, peak_microjoule", COLUMNS, f"{FLAGS}, max(s.peak_microjoule)"),
            ("joint", "joint", JOINT_COLUMNS, "s.joint"),
        ):
            by = ", s.joint" if table == "joint" else ""
            connection.execute(
                f"INSERT INTO {table}{level} (start, robot, epoch, stop, {further}, "
                f"{', '.join(columns)}) SELECT {key}, {names}, "
                f"{', '.join(f'sum(s.{name})' for name in columns)} "
                f"{whole.format(table=f'{table}15')} GROUP BY s.robot, begin, s.epoch{by}",
                (day, day + DAY_NS),
            )
    curves: dict[int, NDArray[np.int64]] = {}
    for robot, start, *used in connection.execute(
        "SELECT s.robot, s.start, s.predicted_import_microjoule, s.standby_microjoule "
        + whole.format(table="slot15"), (day, day + DAY_NS),
    ):  # fmt: skip
        if robot not in curves:
            curves[robot] = np.zeros((QUARTERS, 2), np.int64)
        curves[robot][(start - day) // SLOT_NS] += used
    for robot, curve in curves.items():
        _put_curve(connection, curve_id(robot, day), curve)


def _put_curve(connection: sqlite3.Connection, number: int, curve: NDArray[np.int64]) -> None:
    connection.execute(
        "INSERT OR REPLACE INTO curve VALUES (?, ?)", (number, curve.astype("<i8").tobytes())
    )
