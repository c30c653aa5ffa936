# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Writes the registers to disk outside the ticks, and publishes them when they are there."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from robot_energy.accounting.account import EnergyAccount
from robot_energy.model import RobotModel
from robot_energy.store.account_store import load_account
from robot_energy.store.slots import Submit
from ros2_energy_monitor.diagnostics.reporter import ERROR, WARN, StatusBuilder

OPENING = 2.0  # how long configure waits for the disk [s]
ANSWERING = 3.0  # how long the answer of a service does; the page gives up after 5 s [s]
POLLED_EVERY = 0.02  # while the disk is at work [s]
CLOSING = 5.0  # how long deactivate does [s]
LATE_PERIODS = 3  # a checkpoint that takes longer than this is in trouble
DURATIONS = 600  # latest ones that the quantiles are taken over
MAX_READINGS = 60  # of whole minutes and before resets, that wait for the disk


class Checkpoints:
    """Brings the registers of a node to disk once a period.

    One thread works on the disk, so that a card that takes seconds to sync does not keep
    the ticks from draining. Registers are published when the checkpoint that holds them
    has been synced; while that is impossible, as they stand in memory, and marked so.

    Args:
        folder: Where the state files lie; None keeps nothing.
        period: Between two checkpoints. [s]
        encode: Gives the message of the registers, marked as persisted or not.
    """

    def __init__(
        self,
        node: Node,
        model: RobotModel,
        account: EnergyAccount,
        folder: Path | None,
        period: float,
        encode: Callable[[bool], Any],
        publish: Callable[[Any], None],
    ) -> None:
        self._node, self._log = node, node.get_logger()
        self._account = account
        self._period = period
        self._encode, self._publish = encode, publish
        self._arguments = (model, folder)
        self._thread: ThreadPoolExecutor | None = None
        self._durations: deque[float] = deque(maxlen=DURATIONS)
        self._begun: float | None = None  # when the checkpoint under way was begun
        self._done: float | None = None  # when the latest one was finished
        self._row: Any = None  # what is published once it is
        self._readings: deque[tuple[Any, Any]] = deque()  # not persisted, and persisted
        self._held = 0  # the first of them, which the checkpoint under way holds
        self._waiting: deque[tuple[float, Callable[[bool], None]]] = deque()  # with their limits
        self._covered = 0  # the first of them, whose registers the checkpoint under way holds
        self._warning = ""
        self._trouble = ""
        self._players = ""  # who plays the recording that is counted
        self.running = False

    def open(self) -> None:
        """Read the registers from disk, take the lock of the folder and start the timer."""
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="checkpoints")
        model, folder = self._arguments
        submit = _timed(self._thread, self._durations)
        owner = self._node.get_fully_qualified_name()
        self.store = load_account(self._account, model, folder, submit, owner)
        self.store.open(OPENING)
        self._log_news()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self._node.create_timer(self._period, self._begin, clock=steady)
        self._poller = self._node.create_timer(POLLED_EVERY, self._poll, clock=steady)

    def add_reading(self, encode: Callable[[bool], Any]) -> None:
        """Publish the registers as they stand now as well, once a checkpoint holds them.

        Args:
            encode: Gives their message, marked as persisted or not.
        """
        self._readings.append((encode(False), encode(True)))
        if not self._keeps:
            self._publish_readings(len(self._readings), False)
        elif len(self._readings) > MAX_READINGS:
            self._publish_readings(1, False)

    @property
    def _keeps(self) -> bool:
        """Whether what is counted is to be brought to disk."""
        return self.store.folder is not None and not self.store.is_aside

    def begin_recording(self, players: str) -> None:
        """Count a recording from zero from now on, apart from the robot's registers."""
        if self._keeps and self.running and not self.store.busy:
            self._start()  # what the robot has used until now
        self._players = players
        self.store.set_aside()
        self._log.warning(self._recording())

    def end_recording(self) -> None:
        """Go on with the robot's registers; what was counted of the recording is dropped."""
        self._publish_readings(len(self._readings), False)
        self.store.take_back()
        self._log.info("joint states come from a robot again: its registers go on")

    def _recording(self) -> str:
        return (
            f"{self._players} plays a recording: its energy is counted from zero and not stored; "
            "the registers of the robot do not change and go on when a robot publishes again"
        )

    def change_period(self, period: float) -> None:
        """Change how often the registers are kept.

        Args:
            period: Between two checkpoints. [s]
        """
        self._period = period
        self._timer.timer_period_ns = round(period * 1e9)

    def when_kept(self, answer: Callable[[bool], None]) -> None:
        """Call back once the registers as they stand now are on disk, without waiting here."""
        if not self._keeps:
            self._publish(self._encode(False))
            answer(False)
            return
        self._waiting.append((time.monotonic() + ANSWERING, answer))
        if not self.store.busy:
            self._start()

    def now(self) -> bool:
        """Whether the registers are on disk as they stand; waits for it, and publishes them."""
        self._row = None  # of a checkpoint that is overtaken
        kept = self.store.checkpoint(CLOSING)
        if kept:
            self._begun, self._done = None, time.monotonic()
        self._publish_readings(len(self._readings), kept)
        self._publish(self._encode(kept))
        self._log_news()
        self._poller.reset()
        self._answer(len(self._waiting), kept)
        return kept

    def close(self) -> None:
        """Release the folder, so that another monitor can write."""
        if hasattr(self, "store"):
            kept = self.store.close(CLOSING)
            self._log_news()
            self._answer(len(self._waiting), kept)
        if self._thread is not None:
            self._thread.shutdown(wait=False)

    def findings(self) -> StatusBuilder:
        """Say how the checkpoints are doing."""
        store, now = self.store, time.monotonic()
        found = StatusBuilder("registers")
        waiting = math.nan if self._begun is None else now - self._begun
        durations = np.array(self._durations) if self._durations else np.array([math.nan])
        found.values |= {
            "sequence": store.sequence,
            "checkpoints": store.checkpoints,
            "checkpoint_age_s": math.nan if self._done is None else now - self._done,
            "checkpoint_failures": store.failures,
            "checkpoint_duration_p50_s": float(np.quantile(durations, 0.5)),
            "checkpoint_duration_p99_s": float(np.quantile(durations, 0.99)),
            "restarts": self._account.restarts,
            "samples_repeated": self._account.repeated,
            "intervals_open": len(self._account.intervals.open_entries),
        }
        if waiting > LATE_PERIODS * self._period:
            found.add(
                ERROR,
                f"a checkpoint in {store.folder} has been under way for {waiting:.1f} s",
                "check the disk",
            )
        elif store.trouble:
            found.add(ERROR, store.cause.rstrip("."), store.remedy)
        if self._warning:
            found.add(WARN, self._warning.rstrip("."))
        if store.is_aside:
            found.notes.append(self._recording())
        return found

    def _begin(self) -> None:
        """Begin the checkpoint of this period."""
        if not self.running:
            return
        if not self._keeps:
            self._publish(self._encode(False))
            return
        if self.store.busy:
            # Still at the last one. What is shown now must not be followed by less.
            self._row = None
            self._publish_readings(len(self._readings), False)
            self._publish(self._encode(False))
            return
        self._start()

    def _start(self) -> None:
        """Begin a checkpoint of the registers as they stand; the next is due a period later."""
        if not self._keeps:
            self._answer(len(self._waiting), kept=False)
            return
        row = self._encode(True)
        self._begun = time.monotonic()
        self._row = row if self.store.begin() else None
        self._covered = 0 if self._row is None else len(self._waiting)
        self._held = len(self._readings)
        self._timer.reset()
        self._poller.reset()

    def _poll(self) -> None:
        """Publish the registers of a checkpoint that has been finished, and answer for it."""
        outcome = self.store.poll()
        if self.store.busy:
            now = time.monotonic()
            self._answer(sum(limit <= now for limit, _ in self._waiting), kept=False)
            return
        self._poller.cancel()
        self._begun = None
        if outcome:
            self._done = time.monotonic()
            self._publish_readings(self._held, True)
            self._publish(self._row)
        elif outcome is not None and self.running:
            self._publish_readings(len(self._readings), False)
            self._publish(self._encode(False))
        self._row = None
        self._log_news()
        self._answer(len(self._waiting) if outcome is False else self._covered, bool(outcome))
        if self._waiting:
            self._start()

    def _publish_readings(self, count: int, persisted: bool) -> None:
        """Publish the first readings that wait."""
        self._held = max(0, self._held - count)
        for _ in range(min(count, len(self._readings))):
            self._publish(self._readings.popleft()[persisted])

    def _answer(self, count: int, kept: bool) -> None:
        """Answer the first that wait."""
        self._covered = max(0, self._covered - count)
        for answer in [self._waiting.popleft()[1] for _ in range(count)]:
            answer(kept)

    def _log_news(self) -> None:
        """Log what is new."""
        for notice in self.store.notices:
            self._warning = notice
            self._log.warning(notice)
        self.store.notices.clear()
        if self.store.trouble != self._trouble:
            if self.store.trouble:
                self._log.error(self.store.trouble)
            else:
                self._log.info("the registers are kept on disk again")
            self._trouble = self.store.trouble


def _timed(thread: ThreadPoolExecutor, durations: deque[float]) -> Submit:
    """Return what hands jobs to a thread and notes how long each took. [s]"""

    def submit(job: Callable[[], Any]) -> Future[Any]:
        def timed() -> Any:
            begin = time.perf_counter()
            try:
                return job()
            finally:
                durations.append(time.perf_counter() - begin)

        return thread.submit(timed)

    return submit
