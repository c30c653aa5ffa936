# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Time of a recording that is played: runs at a rate, stands still when asked, is published."""

from __future__ import annotations

import math
import os
import select
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.clock import Clock as RosClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.stamps import bounded
from ros2_energy_monitor.base.publishers import reliable

CLOCK_TOPIC = "/clock"
CLOCK_RATE = 40.0  # where none is given, as of `ros2 bag play` [1/s]
KEY_PERIOD = 0.1  # between two looks at the keyboard [s]


class PlaybackClock:
    """Time of a recording, with the services ``~/pause``, ``~/resume`` and ``~/toggle_paused``.

    They have the names of those of `ros2 bag play`, and a type that every installation has.

    Args:
        rate: Times the speed of nature, > 0. [-]
        publish_rate: How often ``/clock`` is published; 0 for never. [1/s]
    """

    def __init__(
        self,
        node: Node,
        rate: float,
        publish_rate: float = 0.0,
        *,
        paused: bool = False,
        report: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._node, self._rate, self._report = node, rate, report
        self._reached_ns: int | None = None  # None before the first message
        self._since = None if paused else time.monotonic()
        self._steady = RosClock(clock_type=ClockType.STEADY_TIME)
        for name, wanted in (
            ("pause", lambda: True),
            ("resume", lambda: False),
            ("toggle_paused", lambda: not self.paused),
        ):
            node.create_service(Trigger, f"~/{name}", self._answer(wanted))
        if publish_rate:
            self._publisher = node.create_publisher(Clock, CLOCK_TOPIC, reliable(1))
            node.create_timer(1.0 / publish_rate, self._publish, clock=self._steady)

    @property
    def paused(self) -> bool:
        """Whether it stands still."""
        return self._since is None

    @property
    def now_ns(self) -> int:
        """Time of the recording. [ns]"""
        reached = self._reached_ns or 0
        if self._since is None:
            return reached
        return reached + round((time.monotonic() - self._since) * self._rate * SECOND_NS)

    def begin(self, now_ns: int) -> None:
        """Set it."""
        self._reached_ns = now_ns
        if not self.paused:
            self._since = time.monotonic()

    def left(self, due_ns: int) -> float:
        """Return how long it takes until a time; infinite while it stands still. [s]"""
        return math.inf if self.paused else (due_ns - self.now_ns) / SECOND_NS / self._rate

    def pause(self, paused: bool) -> None:
        """Stop it, or let it go on."""
        if paused == self.paused:
            return
        if self._reached_ns is not None:
            self._reached_ns = self.now_ns
        self._since = None if paused else time.monotonic()
        self._report("paused" if paused else "goes on")

    @contextmanager
    def space_key(self, fd: int) -> Iterator[bool]:
        """Yield whether a terminal in the foreground lets it stop and go on by the space key."""
        if not os.isatty(fd) or not _in_foreground(fd):
            yield False
            return
        before = termios.tcgetattr(fd)
        tty.setcbreak(fd)  # each key at once; Ctrl-C stays what it is
        timer = self._node.create_timer(KEY_PERIOD, lambda: self._look(fd), clock=self._steady)
        try:
            yield True
        finally:
            self._node.destroy_timer(timer)
            termios.tcsetattr(fd, termios.TCSADRAIN, before)

    def _look(self, fd: int) -> None:
        while select.select([fd], [], [], 0.0)[0] and (key := os.read(fd, 1)):
            if key == b" ":
                self.pause(not self.paused)

    def _answer(
        self, wanted: Callable[[], bool]
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.pause(wanted())
            response.success = True
            response.message = "paused" if self.paused else "plays"
            return response

        return answer

    def _publish(self) -> None:
        if self._reached_ns is None:
            return
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(bounded(self.now_ns), SECOND_NS)
        self._publisher.publish(message)


def _in_foreground(fd: int) -> bool:
    try:
        return os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:  # not the terminal that controls this process
        return True
