"""What comes besides registers and waits for the disk: jobs, events, learned friction."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any

from robot_energy.foundation.units import DAY_NS
from robot_energy_history.differences import Event
from robot_energy_history.jobs import put_job
from robot_energy_history.readings import LearnedFriction
from robot_energy_history.rows import attempt, put_events, put_friction

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
