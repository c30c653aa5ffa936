"""Joins the robots of one page, and gives web server, metrics and saved page what they need."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from robot_energy_report.page.json_numbers import json_text
from robot_energy_report.page.robot_state import RobotState
from robot_energy_report.page.settings import PageSettings

MAX_ROBOTS = 16
STATE_PERIOD = 1.0  # between two complete states; powers go out at each tick [s]
ACTIONS = ("open_interval", "close_interval", "reset_registers")

Control = Callable[[str, str, str], "Future[tuple[bool, str]]"]
"""Does an action for a robot with a text (name of a job, reason); gives success and a sentence."""


@dataclass(frozen=True)
class PageEvents:
    """What the page was last sent.

    Attributes:
        number: Grows by one at each tick.
        state_number: ``number`` of the tick of the last complete state.
    """

    number: int = 0
    state_number: int = 0
    power: bytes = b""
    state: bytes = b""


@dataclass
class PageHub:
    """The robots of one page.

    Figures are taken in under ``lock`` by the thread that receives them; web server and metrics
    read under it.

    Attributes:
        title: What the page shows, such as the name of a recording.
        live: Whether figures grow stale.
        control: Does what the buttons ask for; None for a page without.
        history_folder: Of the history that the page shows; None without one.
        on_tick: Called after every tick, from the thread of the tick.
        robots: By namespace.
    """

    title: str
    settings: PageSettings
    live: bool = True
    control: Control | None = None
    history_folder: Path | None = None
    on_tick: Callable[[], None] | None = None
    robots: dict[str, RobotState] = field(default_factory=dict[str, RobotState])
    events: PageEvents = field(default_factory=PageEvents)
    lock: threading.Lock = field(default_factory=threading.Lock)
    _state_due: float = 0.0

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
            number = self.events.number + 1
            full = now >= self._state_due or not self.events.state
            if full:
                self._state_due = now + STATE_PERIOD - 1e-3
            powers = [robot.power(now) for robot in self.robots.values()]
            self.events = PageEvents(
                number,
                number if full else self.events.state_number,
                _event("power", {"number": number, "robots": powers}),
                _event("state", self._state(now)) if full else self.events.state,
            )
        if self.on_tick is not None:
            self.on_tick()

    def state(self, now: float, history: bool = True) -> dict[str, Any]:
        """Return all robots as plain values.

        Args:
            now: As of `tick`. [s]
            history: Whether the rings come with it.
        """
        with self.lock:
            found = self._state(now)
            if history:
                found["history"] = [robot.history() for robot in self.robots.values()]
            return found

    def _state(self, now: float) -> dict[str, Any]:
        return {
            "title": self.title,
            "live": self.live,
            "control": self.control is not None,
            "recorded": self.history_folder is not None,
            "number": self.events.number,
            "robots": [robot.snapshot(now) for robot in self.robots.values()],
        }


def _event(name: str, values: Any) -> bytes:
    return f"event: {name}\ndata: {json_text(values)}\n\n".encode()
