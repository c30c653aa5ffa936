# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: records what all robots use, for years."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from robot_energy.foundation.errors import HistoryError, ParameterError
from robot_energy.inputs.parameters import parameter
from robot_energy_history.store import MAX_ROBOTS, HistoryStore
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.lifecycle import ManagedNode
from ros2_energy_monitor.base.parameters import declare, folder_of
from ros2_energy_monitor.base.publishers import ONE_NAME, REGISTERS_TOPIC, best_effort
from ros2_energy_monitor.base.reader_memory import make_room_as_needed
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.diagnostics.reporter import (
    ERROR,
    REPORT_PERIOD,
    WARN,
    Reporter,
    StatusBuilder,
)
from ros2_energy_monitor.recorder.recorded_robot import (
    SILENCE,
    RecordedRobot,
    StatusHead,
    first_name,
    status_heads,
)


@dataclass(frozen=True, kw_only=True)
class RecorderParameters:
    """Parameters of the energy recorder."""

    folder: str = parameter(
        "Folder of the history; variables such as $HOME are read, and $ROS_HOME is ~/.ros where it "
        "is not set.",
        "$ROS_HOME/robot_energy/history",
    )
    robots: tuple[str, ...] = parameter(
        "Namespaces of the robots to record; empty records all whose energy/registers is found.",
        (),
    )
    autostart: bool = parameter(
        "Whether the node configures and activates itself; if not, a life cycle manager does.",
        True,
    )
    keep_minutes: float = parameter("How long minutes are kept [days].", 35.0, (1.0, 4000.0))
    keep_quarters: float = parameter(
        "How long quarter hours are kept; 0 for ever, as hours and days are [days].",
        0.0,
        (0.0, 4000.0),
    )
    min_free: int = parameter(
        "Free space to leave on the disk; nothing is written while there is less [MB].",
        200,
        (0, 1_000_000),
    )
    take_period: float = parameter(
        "Time from one processing of waiting messages to the next [s].", 20.0, (0.1, 30.0)
    )
    write_period: float = parameter(
        "Time from one write to the history to the next [s].", 60.0, (1.0, 900.0)
    )
    look_period: float = parameter(
        "Time from one search for robots and job intervals to the next [s].", 20.0, (1.0, 900.0)
    )


REGISTERS_TYPE = "ros2_energy_msgs/msg/EnergyRegisters"
MEGABYTE = 2**20
LATE = 30.0  # a write that takes longer is said [s]
STATUSES = 4000  # diagnostic messages that wait
STATUS_PERIOD = 5.0  # between two looks at them, of each node at the newest [s]
CLOSING = 5.0  # how long deactivate and cleanup wait for the disk [s]


class EnergyRecorder(ManagedNode):
    """Writes the registers and job intervals of all robots to a history.

    While another recorder writes there, or the disk is in trouble, readings wait, and it goes on
    once it can. A thread of its own works on the disk: messages are taken all the time.

    Args:
        options: Options of `rclpy.node.Node`.
    """

    NAME = "energy_recorder"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        self.store: HistoryStore | None = None
        self._robots: dict[str, RecordedRobot] = {}
        self._timers_of_work: list[Any] = []
        self._left_out = ""
        self._malformed = 0  # diagnostics
        self._said = ""
        self._since = 0.0  # when it became active, steady time [s]
        self._begun = 0.0  # when the disk was given work last, steady time [s]
        self._writing: Future[Any] | None = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        try:
            self.parameters = declare(self, RecorderParameters)
            self._reporter = Reporter(self)
            self.create_timer(REPORT_PERIOD, self.report, clock=self._steady)
            self.autostart(enabled=self.parameters.autostart)
        except Exception:
            self.destroy_node()
            raise

    def configure(self) -> None:
        """Open the history, if it can be opened now."""
        wanted = self.parameters
        folder = folder_of(wanted.folder)
        if folder is None:
            raise ParameterError(f"folder is '{wanted.folder}'", "the folder of a history")
        self.store = HistoryStore(
            folder, wanted.keep_minutes, wanted.min_free * MEGABYTE, wanted.keep_quarters
        )
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="history")
        self._diagnostics = Inbox(self, DiagnosticArray, "/diagnostics", best_effort(STATUSES))
        self.write()

    def activate(self) -> None:
        """Look for robots and record them from now on."""
        wanted = self.parameters
        for period, callback in (
            (wanted.take_period, self.take),
            (STATUS_PERIOD, self.take_statuses),
            (wanted.look_period, self.look),
            (wanted.write_period, self.write),
        ):
            self._timers_of_work.append(self.create_timer(period, callback, clock=self._steady))
        for namespace in wanted.robots:
            self._add(namespace)
        self._since = time.monotonic()
        self.look()

    def deactivate(self) -> None:
        """Write all that has come."""
        self.take()
        self._finish(lambda: self._written(newest=True))
        for timer in self._timers_of_work:
            self.destroy_timer(timer)
        self._timers_of_work.clear()

    def cleanup(self) -> None:
        """Let another recorder write."""
        if self.store is not None:
            self._finish(self.store.close)
            self._thread.shutdown(wait=False)
        self.store = None
        self._robots.clear()

    def take(self) -> None:
        for robot in self._robots.values():
            try:
                robot.take()
            except HistoryError:  # others were recorded before
                self._left_out = robot.name

    def take_statuses(self) -> None:
        """Take the diagnostic statuses that have arrived, each for its robot."""
        batch = self._diagnostics.drain()
        if batch is None:
            return
        newest: dict[bytes, bytes] = {}  # of each node
        for place in range(len(batch)):
            data = batch.row(place)
            try:
                newest[first_name(data)] = data
            except (ValueError, IndexError, struct.error):
                self._malformed += 1
        for data in newest.values():
            try:
                stamp_ns, statuses = status_heads(data)
            except (ValueError, IndexError, struct.error):
                self._malformed += 1
                continue
            own: dict[str, list[StatusHead]] = {}
            for status in statuses:
                namespace = status.name.partition(": ")[0].strip("/").rpartition("/")[0]
                own.setdefault(namespace or "robot", []).append(status)
            for name in own.keys() & self._robots.keys():
                self._robots[name].take_statuses(own[name], stamp_ns)

    def look(self) -> None:
        """Look for robots that are new, and for job intervals."""
        if not self.parameters.robots:
            for topic, types in self.get_topic_names_and_types():
                if topic.endswith(f"/{REGISTERS_TOPIC}") and REGISTERS_TYPE in types:
                    self._add(topic.removesuffix(REGISTERS_TOPIC))
        services = [name for name, _ in self.get_service_names_and_types()]
        for robot in self._robots.values():
            robot.look_after(services)

    def _add(self, namespace: str) -> None:
        name = namespace.strip("/") or "robot"
        if name in self._robots and self._robots[name].namespace != namespace.strip("/"):
            self.get_logger().warning(ONE_NAME.format("recorded"), once=True)
        if self.store is None or name in self._robots:
            return
        if len(self._robots) >= MAX_ROBOTS:
            self._left_out = name
            return
        self._robots[name] = RecordedRobot(self, namespace, self.store)

    def write(self) -> None:
        """Begin to write what waits, unless the disk is still at work."""
        if self._writing is None or self._writing.done():
            self._begin(self._written)

    def _begin(self, work: Callable[[], None]) -> Future[Any]:
        """Hand work on the disk to the thread that does it, after what it has begun."""
        self._begun = time.monotonic()
        self._writing = self._thread.submit(self.guard.run, "history", work)
        return self._writing

    def _finish(self, work: Callable[[], None]) -> None:
        """Do work on the disk and wait for it, but not for ever."""
        try:
            self._begin(work).result(CLOSING)
        except TimeoutError:
            self.get_logger().error(
                f"writing the history has taken over {CLOSING:.0f} s; what is not written now is "
                "in the next reading"
            )

    def _written(self, newest: bool = False) -> None:
        """Write what waits; say what is new of it."""
        store = self.store
        if store is None:
            return
        store.write(time.time_ns(), newest)
        if store.trouble != self._said:
            if store.trouble:
                self.get_logger().error(store.trouble)
            else:
                self.get_logger().info(f"the history is written to {store.folder} again")
            self._said = store.trouble

    def report(self) -> None:
        node = StatusBuilder("node")
        self.guard.check(node)
        self._reporter.publish([node, self._findings()], "")

    def _findings(self) -> StatusBuilder:
        found, store = StatusBuilder("history"), self.store
        if store is None:
            found.notes.append(f"nothing is recorded: the node is {self.state}")
            return found
        robots, now = self._robots.values(), time.monotonic()
        found.values |= {
            "folder": str(store.folder),
            "robots": len(robots),
            "size_mb": store.size / MEGABYTE,
            "transactions": store.commits,
            "readings_waiting": store.waiting,
            "readings_ignored": store.ignored,
            "readings_dropped": store.dropped,
            "refused": store.refused,
            "messages_of_recordings": sum(robot.played for robot in robots),
            "messages_malformed": self._malformed + sum(robot.malformed for robot in robots),
            "messages_lost": sum(robot.lost for robot in robots),
        }
        busy = self._writing is not None and not self._writing.done()
        if busy and time.monotonic() - self._begun > LATE:
            found.add(
                ERROR,
                f"a write has been under way for {time.monotonic() - self._begun:.0f} s",
                "check the disk",
            )
        if store.trouble:
            found.add(ERROR, store.trouble.rstrip("."))
        if self._left_out:
            found.add(
                WARN,
                f"more than {MAX_ROBOTS} robots: {self._left_out} is not recorded",
                "name the robots to record (parameter robots)",
            )
        silent = [robot.name for robot in robots if not now - robot.heard < SILENCE]
        if now - self._since < self.parameters.look_period + self.parameters.take_period:
            found.notes.append("looks for robots")
        elif self.active and not robots:
            found.add(WARN, "no energy/registers is published", "start a monitor")
        elif silent and len(silent) == len(robots):
            found.add(WARN, f"no energy/registers arrive from {', '.join(silent[:3])}")
        return found


def main(args: Sequence[str] | None = None) -> int:
    """Return the exit code of `run`, once the node is interrupted."""
    make_room_as_needed()
    return run(EnergyRecorder, args)
