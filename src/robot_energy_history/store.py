"""Writes the history of all robots: one transaction holds what was counted and up to where.

So a crash repeats and loses nothing: the next reading is cumulative. What is late, doubled or of
another recorder adds nothing. A transaction that fails, as on a full disk, leaves all readings
waiting; of too many the ones in between go, which costs resolution and no energy.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import DAY_NS
from robot_energy_history.bags import BAG, BagReadings, give_way, has_bag, put_bag
from robot_energy_history.database import FILE, open_writer, prepare, take_lock, unusable
from robot_energy_history.differences import (
    Epoch,
    Event,
    begun,
    finished,
    gone_back,
    is_behind,
    refuse_nonsense,
    step,
    supersedes,
    thinned,
)
from robot_energy_history.readings import OBSERVED, LearnedFriction, Reading
from robot_energy_history.rollup import Rolled, forget_minutes, put_span, roll, thin
from robot_energy_history.rows import attempt, put_epoch, put_events, reading_from
from robot_energy_history.waiting_notes import WaitingNotes

MAX_ROBOTS = 200
MAX_WAITING = 120  # readings of a robot that wait for the disk
LIVE = "live"


@dataclass
class _Robot:
    number: int
    has_bags: bool = False
    epochs: dict[tuple[str, int], tuple[int, Epoch]] = field(
        default_factory=lambda: dict[tuple[str, int], tuple[int, Epoch]]()
    )


Waiting = dict[tuple[str, str], list[Reading]]


@dataclass(frozen=True)
class _Written:
    """What a transaction has written: robots as they stand, readings of each, how many were not."""

    robots: dict[str, _Robot]
    done: dict[tuple[str, str], int]
    ignored: int
    refused: int


class HistoryStore:
    """The only writer of a history.

    One thread at a time calls `open`, `write` and `close`; `add` and `add_jobs` may be called by
    another one meanwhile.

    Args:
        folder: Where it lies; made if there is none.
        keep_days: How long minutes are kept. [days]
        min_free: Space that is left on the disk; with less nothing is written. [bytes]
        keep_quarters: How long quarter hours are kept, hours for ever; 0 for ever. [days]

    Attributes:
        ignored: Readings that were late or doubled.
        refused: Readings, jobs and events with values that no robot has.
        dropped: Readings in between that were dropped as the disk took none.
        commits: Transactions that were written.
        size: Of the file and its journal, at the last write. [bytes]
        trouble: Why nothing is written now; empty while it is.
    """

    def __init__(
        self, folder: Path, keep_days: float = 35.0, min_free: int = 0, keep_quarters: float = 0.0
    ) -> None:
        self.folder, self._keep_ns, self._min_free = folder, int(keep_days * DAY_NS), min_free
        self._keep_quarters_ns = int(keep_quarters * DAY_NS)
        self.ignored = self.refused = self.dropped = self.commits = self.size = 0
        self.trouble = ""
        self._lock: int | None = None
        self._connection: sqlite3.Connection | None = None
        self._robots: dict[str, _Robot] = {}
        self._mutex = Lock()
        self._waiting: Waiting = {}
        self._writing: Waiting = {}
        self._behind: dict[tuple[str, str, int], Reading] = {}
        self._notes = WaitingNotes()

    def open(self) -> None:
        """Take the lock and read up to where robots were recorded."""
        try:
            if self._lock is None:
                self._lock = take_lock(self.folder)
            self._connection = open_writer(self.folder)
            prepare(self._connection, self.folder / FILE)
            self._robots = self._read()
        except (OSError, sqlite3.Error, ValueError) as error:
            self._disconnect()
            if isinstance(error, HistoryError):
                raise
            raise unusable(self.folder, error) from error

    def close(self) -> None:
        """Give up the lock; what waits must have been written with `write`."""
        self._disconnect()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the robots that were recorded."""
        return tuple(self._robots)

    @property
    def waiting(self) -> int:
        """Readings that wait for `write`, or are being written."""
        with self._mutex:
            held = (*self._waiting.values(), *self._writing.values())
            return sum(map(len, held))

    def add(self, robot: str, readings: Iterable[Reading], origin: str = LIVE) -> None:
        """Take readings, never waiting for the disk; the last one within a minute is enough."""
        with self._mutex:
            known = {*self._robots, *(name for name, _ in (*self._waiting, *self._writing))}
            if robot not in known and len(known) >= MAX_ROBOTS:
                raise HistoryError(f"a robot more than {MAX_ROBOTS}: {robot}", f"{MAX_ROBOTS}")
            self._queue((robot, origin), readings)

    def _queue(self, key: tuple[str, str], readings: Iterable[Reading]) -> None:
        waiting = self._waiting.setdefault(key, [])
        for one in readings:
            if waiting and supersedes(one, waiting[-1]):
                waiting[-1] = one
            else:
                waiting.append(one)
        if len(waiting) > MAX_WAITING:
            kept = thinned(waiting)
            self.dropped += len(waiting) - len(kept)
            waiting[:] = kept

    def add_jobs(self, robot: str, jobs: Iterable[Mapping[str, Any]]) -> None:
        """Take job intervals that have ended; one that is there already is replaced."""
        with self._mutex:
            self._notes.add_jobs(robot, jobs)

    def add_events(self, robot: str, events: Iterable[Event]) -> None:
        """Take events, of which one robot has one at an instant of each kind."""
        with self._mutex:
            self._notes.add_events(robot, events)

    def add_friction(self, robot: str, learned: Iterable[LearnedFriction]) -> None:
        """Take what was learned of the friction of a robot; of a UTC day the newest is kept."""
        with self._mutex:
            self._notes.add_friction(robot, learned)

    def has_bag(self, name: str) -> bool:
        """Whether a replayed bag is there, in this state and with these settings."""
        return self._connection is not None and has_bag(self._connection, name)

    def add_bag(self, bag: BagReadings) -> int:
        """Put a replayed bag in at once.

        Returns:
            The time of it that others have recorded, which is left out. [ns]
        """
        connection = self._connection
        if connection is None:
            raise HistoryError(f"the history in {self.folder} is not open", "an open one")
        try:
            connection.execute("BEGIN IMMEDIATE")
            try:
                robots = {name: replace(one) for name, one in self._robots.items()}
                number = self._robot(connection, robots, bag.robot).number
                left_out = put_bag(connection, Rolled.of(connection), number, bag)
                connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):
                    connection.execute("ROLLBACK")
                raise
        except sqlite3.Error as error:
            raise unusable(self.folder, error) from error
        self._robots = self._read()
        return left_out

    def write(self, now_ns: int, newest: bool = False) -> bool:
        """Write what waits in one transaction, and drop minutes that are too old.

        Args:
            now_ns: Time of this computer. [ns]
            newest: Whether the last reading of a minute that goes on counts as well, as at the end.

        Returns:
            Whether it is on disk; else `trouble` says why, and all waits.
        """
        with self._mutex:
            taken, self._writing, self._waiting = self._waiting, self._waiting, {}
            notes, self._notes = self._notes, WaitingNotes()
        written: _Written | None = None
        fault: Exception | None = None
        try:
            if self._connection is None:
                self.open()
            self._check_space()
            assert self._connection is not None
            written = self._transact(self._connection, taken, notes, now_ns, newest)
            self.size = sum(
                path.stat().st_size
                for path in (self.folder / f"{FILE}{end}" for end in ("", "-wal"))
                if path.is_file()
            )
        except (HistoryError, sqlite3.Error, OSError) as error:
            self._disconnect()
            wrapped = error if isinstance(error, HistoryError) else unusable(self.folder, error)
            self.trouble = str(wrapped)
        except Exception as error:  # a fault of the program costs no reading
            self._disconnect()
            fault = error
        with self._mutex:
            since, self._waiting, self._writing = self._waiting, {}, {}
            for key, readings in taken.items():
                left = readings[written.done[key] :] if written else readings
                if left or key in since:
                    self._queue(key, [*left, *since.pop(key, [])])
            for key, readings in since.items():
                self._queue(key, readings)
            if written is None:
                notes.add(self._notes)
                self._notes = notes
                if fault is not None:
                    raise fault
                return False
            self._robots = written.robots
        self.ignored += written.ignored
        self.refused += written.refused
        self.trouble = ""
        self.commits += 1
        return True

    def _transact(
        self,
        connection: sqlite3.Connection,
        taken: Waiting,
        notes: WaitingNotes,
        now_ns: int,
        newest: bool,
    ) -> _Written:
        robots = {name: replace(one, epochs=dict(one.epochs)) for name, one in self._robots.items()}
        done: dict[tuple[str, str], int] = {}
        ignored = refused = 0
        connection.execute("BEGIN IMMEDIATE")
        try:
            rolled = Rolled.of(connection)
            for (name, origin), waiting in taken.items():
                count = len(waiting) if newest else finished(waiting, now_ns)
                done[name, origin] = count
                for reading in waiting[:count]:
                    robot = self._robot(connection, robots, name)
                    work = partial(self._record, connection, rolled, name, robot, origin, reading)
                    new = attempt(connection, work)
                    refused += new is None
                    ignored += new is False
            refused += notes.write(
                connection,
                rolled.until_ns,
                lambda name: self._robot(connection, robots, name).number,
            )
            forget_minutes(connection, now_ns - self._keep_ns)
            reached = roll(connection, rolled, now_ns)
            if self._keep_quarters_ns:
                reached = thin(connection, reached, now_ns - self._keep_quarters_ns)
            if reached != rolled:
                reached.write(connection)
            connection.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):
                connection.execute("ROLLBACK")
            raise
        return _Written(robots, done, ignored, refused)

    def _robot(
        self, connection: sqlite3.Connection, robots: dict[str, _Robot], name: str
    ) -> _Robot:
        if name not in robots:
            row = connection.execute("INSERT INTO robot (name) VALUES (?)", (name,))
            robots[name] = _Robot(int(row.lastrowid or 0))
        return robots[name]

    def _record(
        self,
        connection: sqlite3.Connection,
        rolled: Rolled,
        name: str,
        robot: _Robot,
        origin: str,
        reading: Reading,
    ) -> bool:
        """Record a reading; return whether it said something new."""
        key, behind = (origin, reading.energy_start_ns), (name, origin, reading.energy_start_ns)
        number, epoch = robot.epochs.get(key, (0, None))
        if epoch is None:
            taken = begun(reading, bool(robot.epochs))
        elif is_behind(epoch, reading):
            again = self._behind.get(behind)
            self._behind[behind] = reading
            if again is None or reading.counted_ns <= again.counted_ns:
                return False
            taken = gone_back(reading)
        else:
            taken = step(epoch, reading)
        self._behind.pop(behind, None)
        if taken is None:
            return False
        number = put_epoch(
            connection, robot.number, origin, taken.epoch, 0 if taken.new else number
        )
        if taken.span is not None:
            span = taken.span
            refuse_nonsense(span)
            if robot.has_bags and span.values[OBSERVED]:
                give_way(connection, rolled, robot.number, span.begin_ns, span.end_ns)
            put_span(connection, rolled, robot.number, number, taken.span)
        put_events(connection, robot.number, taken.events)
        robot.epochs[key] = number, taken.epoch  # once all of it is in the tables
        return True

    def _read(self) -> dict[str, _Robot]:
        assert self._connection is not None
        rows = self._connection.execute("SELECT name, id FROM robot").fetchall()
        robots = {name: _Robot(number) for name, number in rows}
        by_number = {one.number: one for one in robots.values()}
        for number, robot, origin, start, first, last, known, newest in self._connection.execute(
            "SELECT id, robot, origin, energy_start, first, last, known_until, newest FROM epoch "
            "ORDER BY id"
        ):
            epoch = Epoch(reading_from(first), reading_from(last), known, newest)
            if origin.startswith(BAG):
                by_number[robot].has_bags = True
            else:
                by_number[robot].epochs[origin, start] = number, epoch
        return robots

    def _check_space(self) -> None:
        free = shutil.disk_usage(self.folder).free
        if free < self._min_free:
            raise HistoryError(
                f"{self.folder} has {free // 2**20} MB of free space",
                f"at least {self._min_free // 2**20} MB",
                "free space there; counting goes on, and this energy is then recorded as one span",
            )

    def _disconnect(self) -> None:
        if self._connection is not None:
            with suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None
