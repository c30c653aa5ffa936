# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What the page takes from one robot's monitors: topics, and the services of the registers."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.client import Client
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, PowerState
from ros2_energy_msgs.srv import CloseInterval, ListIntervals, OpenInterval, ResetRegisters

from robot_energy.foundation.units import SECOND_NS
from robot_energy_report.page.alarms import PageFinding
from robot_energy_report.page.robot_state import RobotState
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.publishers import (
    FRICTION_TOPIC,
    POWER_TOPIC,
    REGISTERS_TOPIC,
    best_effort,
    latched,
)

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
