"""Joins the robots of one page, and gives web server, metrics and saved page what they need."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from robot_energy_report.page.json_numbers import json_text
from robot_energy_report.page.robot_state import RobotState
from robot_energy_report.page.settings import PageSettings

MAX_ROBOTS = 200
MAX_WHOLE = 16  # of more robots a page gets one whole, and an overview of all
STATE_PERIOD = 1.0  # between two complete states; powers go out at each tick [s]
FLEET_PERIOD = 2.0  # between two overviews [s]
ACTIONS = ("open_interval", "close_interval", "reset_registers")

Control = Callable[[str, str, str], "Future[tuple[bool, str]]"]
"""Does an action for a robot with a text (name of a job, reason); gives success and a sentence."""


EVENTS = ("state", "fleet", "power")  # in the order in which they are sent
PageEvents = dict[str, tuple[int, bytes]]
"""What pages that show one robot, or few, were last sent: of each kind the number of its tick."""


@dataclass
class PageHub:
    """The robots of one page.

    Figures are taken in under ``lock`` by the thread that receives them; web server and metrics
    read under it.

    Attributes:
        title: What the page shows, such as the name of a recording.
        control: Does what the buttons ask for; None for a page without.
        history_folder: Of the history that the page shows; None without one.
        on_tick: Called after every tick, from the thread of the tick.
        watched: How many pages show each robot; an empty name is the first one.
    """

    title: str
    settings: PageSettings
    live: bool = True
    control: Control | None = None
    history_folder: Path | None = None
    on_tick: Callable[[], None] | None = None
    robots: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    events: dict[str, PageEvents] = field(default_factory=dict[str, PageEvents])
    watched: Counter[str] = field(default_factory=Counter[str])
    lock: threading.Lock = field(default_factory=threading.Lock)
    _number: int = 0
    _due: dict[str, float] = field(default_factory=dict[str, float])

    def robot(self, name: str) -> RobotState | None:
        """Return the state of a robot, new if there is room; None beyond `MAX_ROBOTS`."""
        if name not in self.robots and len(self.robots) < MAX_ROBOTS:
            self.robots[name] = RobotState(name, self.settings, self.live)
        return self.robots.get(name)

    def tick(self, now: float) -> None:
        """Make the events of this instant.

        Args:
            now: On the steady clock of `RobotState.take_power`. [s]
        """
        with self.lock:
            self._number += 1
            full, overview = self._is_due("state", now), self.many and self._is_due("fleet", now)
            fleet = (self._number, _event("fleet", self._fleet(now))) if overview else None
            made: dict[str, PageEvents] = {}
            for name in {"", *(self.watched if self.many else ())}:
                own = made[name] = dict(self.events.get(name, {}))
                if full or "state" not in own:
                    own["state"] = self._number, _event("state", self._state(now, name))
                if fleet is not None:
                    own["fleet"] = fleet
                powers = [robot.power(now) for robot in self.whole(name)]
                power = _event("power", {"number": self._number, "robots": powers})
                own["power"] = self._number, power
            self.events = made  # whole: it is read without the lock
        if self.on_tick is not None:
            self.on_tick()

    @property
    def many(self) -> bool:
        """Whether there are more robots than a page gets whole."""
        return len(self.robots) > MAX_WHOLE

    def events_of(self, name: str) -> PageEvents:
        """Return what the pages that show a robot were last sent; call it under no lock."""
        events = self.events
        return events.get(name) or events.get("", {})

    def whole(self, name: str) -> list[RobotState]:
        """Return the robots that a page gets whole: all, or of many the one named, or the first."""
        robots = list(self.robots.values())
        if not self.many:
            return robots
        return [next((one for one in robots if one.name == name), robots[0])]

    def state(self, now: float, name: str = "") -> dict[str, Any]:
        """Return what a page begins with, with the rings; time as in `PageHub.tick`."""
        with self.lock:
            found = self._state(now, name)
            if self.many:
                found["fleet"] = self._fleet(now)
            found["history"] = [robot.history() for robot in self.whole(name)]
            return found

    def snapshots(self, now: float) -> list[dict[str, Any]]:
        """Return all robots, the lock free in between; time as in `PageHub.tick`."""
        found: list[dict[str, Any]] = []
        for robot in list(self.robots.values()):
            with self.lock:
                found.append(robot.snapshot(now))
        return found

    def _is_due(self, what: str, now: float) -> bool:
        if now < self._due.get(what, -math.inf):
            return False
        self._due[what] = now + (STATE_PERIOD if what == "state" else FLEET_PERIOD) - 1e-3
        return True

    def _fleet(self, now: float) -> list[dict[str, Any]]:
        return [robot.overview(now) for robot in self.robots.values()]

    def _state(self, now: float, name: str) -> dict[str, Any]:
        return {
            "title": self.title,
            "live": self.live,
            "control": self.control is not None,
            "recorded": self.history_folder is not None,
            "number": self._number,
            "count": len(self.robots),
            "robots": [robot.snapshot(now) for robot in self.whole(name)],
        }


def _event(name: str, values: Any) -> bytes:
    return f"event: {name}\ndata: {json_text(values)}\n\n".encode()
