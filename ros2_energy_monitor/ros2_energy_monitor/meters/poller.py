# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Reads a meter in a thread of its own: connects, asks, connects again after a loss.

What waits on the network must not hold up the node, and a request must not wait for the node's
tick: the thread gives readings with times of the steady clock, the node takes them.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, TypeVar

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError
from ros2_energy_monitor.meters.link import MeterLink
from ros2_energy_monitor.meters.reading import NetworkReading, ReadingFilter

T = TypeVar("T")
Guarded = Callable[[str, Callable[[], None]], object]

MAX_WAITING = 10_000  # readings that the node has not taken yet
MIN_BACKOFF = 0.5  # after the first loss; doubled with each further one [s]
MAX_REFUSALS = 10  # in a row, after which a meter is connected again
JOINED = 1.0  # longest wait for the end of the thread, which ends by itself in time [s]


@documented
@dataclass
class PollerState:
    """What a poller says of itself. Written by its thread, read by the node."""

    connected: Annotated[
        bool, "Whether the last attempt to connect succeeded and no loss came since."
    ] = False
    connections: int = 0
    failures: Annotated[
        int, "Losses and failed attempts since the last answer; 0 while all is well."
    ] = 0
    refusals: Annotated[int, "Answers in a row that held no numbers."] = 0
    errors: Annotated[Counter[str], "Losses and refusals in all, by class of error."] = field(
        default_factory=lambda: Counter[str]()
    )
    last_error: Annotated[str, "What the last one said; empty before the first."] = ""
    backoff: Annotated[float, "Time until the next attempt to connect. [s]"] = 0.0
    dropped: Annotated[int, "Readings lost as the node did not take them."] = 0


class Poller:
    """Polls one meter until it is stopped.

    Args:
        period: Time from one request to the next. [s]
        max_backoff: Longest time between two attempts to connect. [s]
        guarded: Runs the work of the thread by name and notes what it raises.
    """

    def __init__(
        self,
        link: MeterLink,
        readings: ReadingFilter,
        period: float,
        max_backoff: float,
        guarded: Guarded,
    ) -> None:
        self.state = PollerState()
        self.readings = readings
        self._link, self._period, self._max_backoff = link, period, max_backoff
        self._waiting: deque[NetworkReading] = deque(maxlen=MAX_WAITING)
        self._stopped = threading.Event()
        self._guarded = guarded
        self._thread = threading.Thread(target=self._run, name="meter", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """End the thread and disconnect."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(JOINED)

    def take(self) -> list[NetworkReading]:
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stopped.is_set():
            self._guarded("poll", self._step)
            due = self._pause(due)
        self._guarded("close", self._link.close)

    def _pause(self, due: float) -> float:
        """Wait for the next step and return when it is due."""
        now = time.monotonic()
        if self.state.connected and self._link.waits:
            return now
        if self.state.connected:
            due = max(due + self._period, now)  # no burst after a slow answer
        else:
            due = now + max(self.state.backoff, MIN_BACKOFF)
        self._stopped.wait(due - now)
        return due

    def _step(self) -> None:
        state = self.state
        try:
            if not state.connected:
                self._link.connect()
                state.connected = True
                state.connections += 1
                self.readings.reconnected()
            exchanges = self._link.read()
        except MeterAnswerError as error:
            self._note(error)
            state.refusals += 1
            if state.refusals % MAX_REFUSALS == 0:
                self._disconnect()
            return
        except Exception as error:
            self._note(error)
            self._disconnect()
            if not isinstance(error, MeterLinkError):
                raise  # the guard counts it
            return
        if exchanges:
            state.failures = state.refusals = 0
        for exchange in exchanges:
            reading = self.readings.step(exchange)
            if reading is not None:
                state.dropped += len(self._waiting) == MAX_WAITING
                self._waiting.append(reading)

    def _disconnect(self) -> None:
        """Close the link; the pause before the next attempt doubles from loss to loss."""
        state = self.state
        state.connected = False
        self._link.close()
        state.backoff = min(MIN_BACKOFF * 2.0 ** min(state.failures, 30), self._max_backoff)
        state.failures += 1

    def _note(self, error: Exception) -> None:
        self.state.errors[type(error).__name__] += 1
        self.state.last_error = str(error) or type(error).__name__
