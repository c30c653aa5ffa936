"""Keeps the registers on disk beside the ticks, and publishes them when they are there."""

from __future__ import annotations

import math
import os
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

from robot_energy.model_file import RobotModel
from robot_energy.pipeline import Ledger
from robot_energy.state_file import Submit, books_of
from ros2_energy_monitor.findings import ERROR, WARN, Findings

OPENING = 2.0  # how long configure waits for the disk [s]
ANSWERING = 0.5  # how long a service does; joint states wait for it meanwhile [s]
CLOSING = 5.0  # how long deactivate does [s]
LATE_PERIODS = 3  # a checkpoint that takes longer than this is in trouble
ROS_HOME = "$ROS_HOME"
DURATIONS = 600  # latest ones that the quantiles are taken over


def folder_of(parameter: str) -> Path | None:
    """Return the folder that a parameter names.

    Args:
        parameter: A path; ``$ROS_HOME`` at its beginning stands for that variable, or for
            ``~/.ros`` where it is not set. Empty for no folder.
    """
    if not parameter:
        return None
    home = os.environ.get("ROS_HOME") or "~/.ros"
    if parameter == ROS_HOME or parameter.startswith(f"{ROS_HOME}/"):
        parameter = home + parameter[len(ROS_HOME) :]
    return Path(parameter).expanduser()


class Checkpoints:
    """Brings the registers of a node to disk once a period.

    One thread works on the disk, so that a card that takes seconds to sync does not keep
    the ticks from draining. Registers are published when the checkpoint that holds them
    has been synced; while that is impossible, as they stand in memory, and marked so.

    Args:
        node: The node.
        model: The robot's model.
        ledger: The books.
        folder: Where the state files lie; None keeps nothing.
        period: Between two checkpoints. [s]
        encode: Gives the message of the registers, marked as persisted or not.
        publish: Takes such a message.
    """

    def __init__(
        self,
        node: Node,
        model: RobotModel,
        ledger: Ledger,
        folder: Path | None,
        period: float,
        encode: Callable[[bool], Any],
        publish: Callable[[Any], None],
    ) -> None:
        self._log = node.get_logger()
        self._ledger = ledger
        self._period = period
        self._encode, self._publish = encode, publish
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="checkpoints")
        self._durations: deque[float] = deque(maxlen=DURATIONS)
        self._begun: float | None = None  # when the checkpoint under way was begun
        self._done: float | None = None  # when the latest one was finished
        self._row: Any = None  # what is published once it is
        self._warning = ""
        self._trouble = ""
        self.books = books_of(ledger, model, folder, _timed(self._thread, self._durations))
        self.books.open(OPENING)
        self._tell()
        self.running = False
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(period, self._begin, clock=steady)

    def poll(self) -> None:
        """Publish the registers of a checkpoint that has been finished; call every tick."""
        if not self.books.busy:
            return
        outcome = self.books.poll()
        if outcome is None and self.books.busy:
            return
        self._begun = None
        if outcome:
            self._done = time.monotonic()
            self._publish(self._row)
        elif outcome is not None and self.running:
            self._publish(self._encode(False))
        self._row = None
        self._tell()

    def now(self, patience: float = ANSWERING) -> bool:
        """Bring the registers to disk as they stand, and publish them.

        Args:
            patience: How long to wait for the disk, twice at most. [s]

        Returns:
            Whether they are on disk.
        """
        self._row = None  # of a checkpoint that is overtaken
        kept = self.books.checkpoint(patience)
        if kept:
            self._begun, self._done = None, time.monotonic()
        self._publish(self._encode(kept))
        self._tell()
        return kept

    def close(self) -> None:
        """Let another monitor write."""
        self.books.close(CLOSING)
        self._tell()
        self._thread.shutdown(wait=False)

    def findings(self) -> Findings:
        """Say how the checkpoints are doing."""
        books, now = self.books, time.monotonic()
        found = Findings("registers")
        waiting = math.nan if self._begun is None else now - self._begun
        durations = np.array(self._durations) if self._durations else np.array([math.nan])
        found.values |= {
            "sequence": books.sequence,
            "checkpoints": books.checkpoints,
            "checkpoint_age": math.nan if self._done is None else now - self._done,
            "checkpoint_failures": books.failures,
            "checkpoint_duration_p50": float(np.quantile(durations, 0.5)),
            "checkpoint_duration_p99": float(np.quantile(durations, 0.99)),
            "restarts": self._ledger.restarts,
            "samples_repeated": self._ledger.repeated,
            "intervals_open": self._ledger.intervals.open_count,
        }
        if waiting > LATE_PERIODS * self._period:
            found.add(
                ERROR, f"a checkpoint in {books.folder} has been under way for {waiting:.1f} s"
            )
        elif books.trouble:
            found.add(ERROR, books.trouble.rstrip("."))
        if self._warning:
            found.add(WARN, self._warning.rstrip("."))
        return found

    def _begin(self) -> None:
        """Begin the checkpoint of this period."""
        if not self.running:
            return
        if not self.books.keeps:
            self._publish(self._encode(False))
            return
        if self.books.busy:
            # Still at the last one. What is shown now must not be followed by less.
            self._row = None
            self._publish(self._encode(False))
            return
        row = self._encode(True)
        self._begun = time.monotonic()
        self._row = row if self.books.begin() else None

    def _tell(self) -> None:
        """Log what is new."""
        for notice in self.books.notices:
            self._warning = notice
            self._log.warning(notice)
        self.books.notices.clear()
        if self.books.trouble != self._trouble:
            if self.books.trouble:
                self._log.error(self.books.trouble)
            else:
                self._log.info("the registers are kept on disk again")
            self._trouble = self.books.trouble


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
