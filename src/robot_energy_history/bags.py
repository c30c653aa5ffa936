"""Puts the registers of a replayed bag into a history: a minute counts once, whoever recorded it.

Live registers count all the time between two readings, so no bag adds to that: live goes before
bags, the bag that came first before later ones. A bag that is replayed again, as with another
model, takes the place of what it gave before.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import DAY_NS
from robot_energy_history.database import LEVELS
from robot_energy_history.differences import SLOT_NS, Epoch, Event, step, zero_of
from robot_energy_history.jobs import drop_jobs, put_job
from robot_energy_history.readings import Reading
from robot_energy_history.rollup import Rolled, change_curve, put_span
from robot_energy_history.rows import put_epoch, put_events, reading_from

BAG = "bag:"  # how the origin of its epochs begins
MAX_JOBS = 2**12  # of a bag


class BagReadings(Described):
    """What a replay gives to a history."""

    robot: Annotated[str, "Name of the robot."]
    name: Annotated[str, "Of bag, state and settings; begins with a hash of its place, a hyphen."]
    readings: Annotated[tuple[Reading, ...], "Its registers at each UTC minute, from zero on."]
    jobs: Annotated[tuple[Mapping[str, Any], ...], "Whole ones, by `JOB_COLUMNS`, from 0 on."] = ()


def has_bag(connection: sqlite3.Connection, name: str) -> bool:
    """Whether a bag was put in, in this state and with these settings."""
    found = connection.execute("SELECT 1 FROM meta WHERE name = ?", (BAG + name,))
    return found.fetchone() is not None


def put_bag(connection: sqlite3.Connection, rolled: Rolled, robot: int, bag: BagReadings) -> int:
    """Return the time that others have recorded, which is left out of a bag that is put in. [ns]"""
    of_bag = f"{BAG}{bag.name.partition('-')[0]}-"
    for number, origin, *_ in _epochs(connection, robot):
        if origin.startswith(of_bag):
            take_out(connection, rolled, robot, number)
    connection.execute("DELETE FROM meta WHERE name >= ? AND name < ?", (of_bag, of_bag + "~"))
    # Below zero, where no job of a monitor is.
    first = -(int(bag.name.partition("-")[0][:12], 16) + 1) * MAX_JOBS
    drop_jobs(connection, rolled.until_ns, robot, first - MAX_JOBS + 1, first)
    taken = [(begin, end) for *_, begin, end in _epochs(connection, robot)]
    left_out = 0
    known: list[tuple[int, int]] = []
    if bag.readings:
        zero = zero_of(bag.readings[0])
        number = 0
        epoch: Epoch = Epoch(zero, zero, zero.stamp_ns, zero.stamp_ns)
        for reading in bag.readings:
            found = step(epoch, reading)
            if found is None:
                continue
            span, before, epoch = found.span, epoch.last, found.epoch
            if span is None:
                continue
            if _overlaps(taken, span.begin_ns, span.end_ns):
                left_out += span.end_ns - span.begin_ns
                number = 0
                continue
            if not number or found.new:
                epoch = replace(epoch, first=before)
                number = 0
            number = put_epoch(connection, robot, BAG + bag.name, epoch, number)
            put_span(connection, rolled, robot, number, span)
            known.append((span.begin_ns, span.end_ns))
    for place, job in enumerate(bag.jobs[:MAX_JOBS]):
        if _overlaps(known, job["stop"] - 1, job["stop"]):
            put_job(connection, rolled.until_ns, robot, {**job, "id": first - place})
    said = f"{left_out / 1e9:.0f} s of a bag were recorded by others already" if left_out else ""
    connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (BAG + bag.name, said))
    if said:
        put_events(connection, robot, [Event(bag.readings[0].stamp_ns, "overlap", said)])
    return left_out


def give_way(
    connection: sqlite3.Connection, rolled: Rolled, robot: int, begin_ns: int, end_ns: int
) -> None:
    """Take bags out that live registers, which came later, have counted as well. [ns]"""
    for number, origin, begin, end in _epochs(connection, robot):
        if origin.startswith(BAG) and begin < end_ns and end > begin_ns:
            take_out(connection, rolled, robot, number)
            seconds = f"{(end - begin) / 1e9:.0f} s"
            text = f"a bag of {seconds} was removed, as its time was also recorded live"
            put_events(connection, robot, [Event(begin, "overlap", text)])


def take_out(connection: sqlite3.Connection, rolled: Rolled, robot: int, epoch: int) -> None:
    """Take all that registers gave out of a history."""
    begin, end = next((b, e) for number, _, b, e in _epochs(connection, robot) if number == epoch)
    if begin < rolled.quarters_from_ns:
        raise HistoryError(
            "the history holds this bag already, and its quarter hours are no longer kept",
            "a bag of later days",
            "put bags into a history without keep_quarters",
        )  # fmt: skip
    where = "WHERE robot = ? AND start >= ? AND start < ? AND epoch = ?"
    span = (robot, begin // DAY_NS * DAY_NS, end + DAY_NS, epoch)
    for start, stop, imported, standby in connection.execute(
        "SELECT start, stop, predicted_import_microjoule, standby_microjoule FROM slot15 " + where,
        span,
    ).fetchall():
        if start < rolled.until_ns and stop - start == SLOT_NS and start % SLOT_NS == 0:
            change_curve(connection, robot, start, -imported, -standby)
    for table in ("slot", "joint"):
        for level in (1, 15, *LEVELS):
            if (table, level) != ("joint", 1):
                connection.execute(f"DELETE FROM {table}{level} {where}", span)
    connection.execute("DELETE FROM epoch WHERE id = ?", (epoch,))


def _epochs(connection: sqlite3.Connection, robot: int) -> list[tuple[int, str, int, int]]:
    """Number, origin, begin and end of all registers of a robot. [ns]"""
    return [
        (number, origin, reading_from(first).stamp_ns, max(reading_from(last).stamp_ns, known))
        for number, origin, first, last, known in connection.execute(
            "SELECT id, origin, first, last, known_until FROM epoch WHERE robot = ?", (robot,)
        ).fetchall()
    ]


def _overlaps(taken: Sequence[tuple[int, int]], begin_ns: int, end_ns: int) -> bool:
    return any(begin < end_ns and end > begin_ns for begin, end in taken)
