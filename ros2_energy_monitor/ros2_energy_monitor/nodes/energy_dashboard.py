# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: the energy page of all robots, and their figures for Prometheus, over HTTP."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, PowerState
from ros2_energy_msgs.srv import CloseInterval, ListIntervals, OpenInterval, ResetRegisters

from robot_energy.foundation.units import SECOND_NS
from robot_energy_report.page.access import page_access
from robot_energy_report.page.alarms import PageFinding
from robot_energy_report.page.hub import MAX_WHOLE, PageHub
from robot_energy_report.page.robot_state import RobotState
from robot_energy_report.page.settings import load_settings
from robot_energy_report.page.web_server import PageServer
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.node_parameters import DashboardParameters
from ros2_energy_monitor.base.parameters import declare, folder_of
from ros2_energy_monitor.base.publishers import (
    FRICTION_TOPIC,
    ONE_NAME,
    POWER_TOPIC,
    REGISTERS_TOPIC,
    best_effort,
    latched,
)
from ros2_energy_monitor.base.reader_memory import make_room_as_needed
from ros2_energy_monitor.base.run_node import run

SERVICES: dict[str, Any] = {
    "list_intervals": ListIntervals,
    "open_interval": OpenInterval,
    "close_interval": CloseInterval,
    "reset_registers": ResetRegisters,
}
SILENCE = 10.0  # of a topic with publishers, or of a service, after which it is asked again [s]
INTERVAL_FIELDS = (
    "id", "name", "is_open", "predicted_import_energy", "measured_energy",
    "predicted_energy_at_meter", "observed_time", "gap_time", "coverage", "predicted_peak_power",
)  # fmt: skip


class RobotFeed:
    """Feeds one robot's state, by the namespace of its monitors."""

    def __init__(self, node: Node, namespace: str, state: RobotState) -> None:
        self._node, self.state = node, state
        self.namespace = namespace.strip("/")
        self._prefix = f"/{self.namespace}/" if self.namespace else "/"
        self._power = self._inbox(PowerState, POWER_TOPIC, best_effort(200))
        self._registers = self._inbox(EnergyRegisters, REGISTERS_TOPIC, best_effort(10))
        self._friction = Inbox(node, JointFriction, f"{self._prefix}{FRICTION_TOPIC}", latched(10))
        self._clients: dict[str, Client] = {}
        self._listing: Any = None  # the answer that is awaited
        self._asked = 0.0  # when, steady time [s]

    def drain(self, now: float) -> None:
        """Take what has arrived.

        Args:
            now: On a steady clock. [s]
        """
        friction, power = self._friction.drain(), self._power.drain()
        registers = self._registers.drain()
        if friction is not None:
            self.state.take_friction(friction)
        if power is not None:
            self.state.take_power(power, now)
        if registers is not None:
            self.state.take_registers(registers)

    @property
    def is_asked(self) -> bool:
        """Whether job intervals can be asked for without looking for who lists them."""
        return "list_intervals" in self._clients

    def look_after(self, services: Sequence[str]) -> None:
        """Ask for the job intervals, and subscribe again what is silent; about once a second."""
        for inbox in (self._power, self._registers):
            inbox.resubscribe_if_silent()
        if self._listing is not None and not self._listing.done():
            if time.monotonic() - self._asked < SILENCE:
                return
            self._listing.cancel()
        client = self._client("list_intervals", services)
        if client is not None:
            self._asked = time.monotonic()
            self._listing = client.call_async(ListIntervals.Request())
            self._listing.add_done_callback(self._take_list)

    def act(
        self, action: str, text: str, answer: Future[tuple[bool, str]], services: Sequence[str]
    ) -> None:
        client = self._client(action, services)
        if client is None:
            answer.set_result((False, f"no monitor of this robot offers {action}"))
            return
        request = SERVICES[action].Request()
        setattr(request, "reason" if action == "reset_registers" else "name", text)

        def done(future: Any) -> None:
            response = future.result()
            if response is not None and not answer.done():
                answer.set_result((bool(response.success), str(response.message)))

        client.call_async(request).add_done_callback(done)

    def take_statuses(self, statuses: Sequence[DiagnosticStatus]) -> None:
        """Take the diagnostic statuses of this robot's nodes; those of others must be left out."""
        self.state.take_findings(
            [
                PageFinding.of_status(
                    int.from_bytes(status.level, "little"),
                    status.name,
                    status.message,
                    {pair.key: pair.value for pair in status.values},
                )
                for status in statuses
                if "_monitor: " in status.name
            ]
        )

    def _inbox(self, kind: type[Any], topic: str, qos: Any) -> Inbox:
        return Inbox(self._node, kind, f"{self._prefix}{topic}", qos, renew_after=SILENCE)

    def _client(self, action: str, services: Sequence[str]) -> Client | None:
        """The client of a service, made when a monitor of this robot offers it."""
        client = self._clients.get(action)
        if client is None:
            for name in services:
                rest = name.removeprefix(self._prefix).split("/")
                if name.startswith(self._prefix) and len(rest) == 2 and rest[1] == action:
                    client = self._clients[action] = self._node.create_client(
                        SERVICES[action], name
                    )
        return client if client is not None and client.service_is_ready() else None

    def _take_list(self, future: Any) -> None:
        response = None if future.cancelled() else future.result()
        if response is not None:
            self.state.take_intervals(  # with fields as `interval_fields` names them
                [
                    {name: getattr(one, name) for name in INTERVAL_FIELDS}
                    | {"start_ns": one.start.sec * SECOND_NS + one.start.nanosec}
                    for one in response.intervals
                ]
            )


def namespace_of(status: str) -> str:
    """Return the namespace of the node that a diagnostic status names, without slashes."""
    return status.partition(": ")[0].strip("/").rpartition("/")[0]


LOOK_PERIOD = 1.0  # between two looks for robots, services and job intervals [s]
POWER_TYPE = "ros2_energy_msgs/msg/PowerState"


class EnergyDashboard(Node):
    """Serves the page."""

    NAME = "energy_dashboard"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        self.parameters = wanted = declare(self, DashboardParameters)
        self.guard = Guard(self.NAME, self.context)
        access = page_access(
            wanted.address,
            wanted.port,
            wanted.token_file,
            wanted.allow_control,
            wanted.allowed_hosts,
        )
        self.hub = PageHub(
            "",
            load_settings(wanted.page_settings),
            control=self._ask if wanted.allow_control else None,
            history_folder=folder_of(wanted.history_folder),
        )
        self._feeds: dict[str, RobotFeed] = {}
        self._ticks = self._looks = 0
        self._wishes: SimpleQueue[tuple[str, str, str, Future[tuple[bool, str]]]] = SimpleQueue()
        for namespace in wanted.robots:
            self._add(namespace)
        self.create_subscription(
            DiagnosticArray, "/diagnostics", self._take_diagnostics, best_effort(50)
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for name, work, period in (
            ("tick", self._tick, 1.0 / wanted.update_rate),
            ("look", self._look, LOOK_PERIOD),
        ):
            self.create_timer(period, self.guard.callback(name, work), clock=steady)
        self.server = PageServer(self.hub, access)
        for sentence in access.sentences(self.server.url):
            self.get_logger().info(sentence)

    def destroy_node(self) -> None:
        if hasattr(self, "server"):
            self.server.close()
        super().destroy_node()

    def _tick(self) -> None:
        """Take what has arrived and send it to the pages."""
        now = time.monotonic()
        self._ticks += 1
        with self.hub.lock:
            for feed in self._in_turn(self._ticks, round(self.parameters.update_rate)):
                feed.drain(now)
        self.hub.tick(now)
        while not self._wishes.empty():
            robot, action, text, answer = self._wishes.get()
            self._feeds[robot].act(action, text, answer, self._service_names())

    def _look(self) -> None:
        """Look for robots that are new, and for job intervals."""
        if not self.parameters.robots:
            for topic, types in self.get_topic_names_and_types():
                if topic.endswith(f"/{POWER_TOPIC}") and POWER_TYPE in types:
                    self._add(topic.removesuffix(POWER_TOPIC))
        self._looks += 1
        turn = self._in_turn(self._looks, len(self._feeds) // MAX_WHOLE)
        services = [] if all(feed.is_asked for feed in turn) else self._service_names()
        for feed in turn:
            feed.look_after(services)

    def _service_names(self) -> list[str]:
        return [name for name, _ in self.get_service_names_and_types()]

    def _in_turn(self, number: int, turns: int) -> list[RobotFeed]:
        """Feeds of the robots that a page shows, and of many others one of so many in turn."""
        feeds = list(self._feeds.values())
        if not self.hub.many or turns < 2:
            return feeds
        shown = {id(one) for name in ("", *self.hub.watched) for one in self.hub.whole(name)}
        return [
            feed
            for place, feed in enumerate(feeds)
            if place % turns == number % turns or id(feed.state) in shown
        ]

    def _add(self, namespace: str) -> None:
        """Feed a robot, unless it is there already or the page is full."""
        name = namespace.strip("/") or "robot"
        if name in self._feeds and self._feeds[name].namespace != namespace.strip("/"):
            self.get_logger().warning(ONE_NAME.format("shown"), once=True)
        with self.hub.lock:
            state = self.hub.robot(name) if name not in self._feeds else None
        if state is not None:
            self._feeds[name] = RobotFeed(self, namespace, state)

    def _ask(self, robot: str, action: str, text: str) -> Future[tuple[bool, str]]:
        """Take what a button asks for, from the thread of the server; the tick does it."""
        answer: Future[tuple[bool, str]] = Future()
        self._wishes.put((robot, action, text, answer))
        return answer

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        by_namespace: dict[str, list[Any]] = {}
        for status in message.status:
            by_namespace.setdefault(namespace_of(status.name), []).append(status)
        with self.hub.lock:
            for namespace, statuses in by_namespace.items():
                feed = self._feeds.get(namespace or "robot")
                if feed is not None and feed.namespace == namespace:
                    feed.take_statuses(statuses)


def main(args: Sequence[str] | None = None) -> int:
    """Return the exit code of `run`, once the node is interrupted."""
    make_room_as_needed()
    return run(EnergyDashboard, args)
