# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Publishers that send serialised messages, and the quality of service of every topic."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, JointTorque, PowerState

POWER_TOPIC = "energy/power"
REGISTERS_TOPIC = "energy/registers"
TORQUE_TOPIC = "energy/joint_torque"
FRICTION_TOPIC = "energy/joint_friction"
CONDITION_TOPIC = "energy/condition"
ONE_NAME = (
    "a robot without a namespace is called robot, as that of the namespace /robot: one of them is "
    "not {}; give the first a namespace"
)
MAX_FINISH = 1.0  # for subscribers to acknowledge the last messages of a node that ends [s]


def best_effort(depth: int) -> QoSProfile:
    """Return the quality of service of sensor data, which fits every publisher."""
    return _profile(depth, ReliabilityPolicy.BEST_EFFORT)


def reliable(depth: int) -> QoSProfile:
    """Return the quality of service of results: nothing is lost, nothing is kept."""
    return _profile(depth, ReliabilityPolicy.RELIABLE)


def latched(depth: int) -> QoSProfile:
    """Return the quality of service of states: a late subscriber gets the last ones."""
    return _profile(depth, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)


def _profile(
    depth: int,
    reliability: ReliabilityPolicy,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=reliability,
        durability=durability,
    )


class RowPublisher:
    """Publishes rows of bytes, each a complete serialised message."""

    def __init__(self, node: Node, message_type: type[Any], topic: str, qos: QoSProfile) -> None:
        self._publisher = node.create_publisher(message_type, topic, qos)

    def publish(self, rows: NDArray[np.uint8] | None) -> None:
        """Publish messages in order.

        Args:
            rows: One message per row, shape (N, size); None for none.
        """
        for row in () if rows is None else rows:
            self._publisher.publish(row.tobytes())

    def finish(self) -> None:
        """Wait until reliable subscribers have all that was published, at most `MAX_FINISH`.

        What they have not acknowledged when the process ends is lost.
        """
        self._publisher.wait_for_all_acked(Duration(seconds=MAX_FINISH))


class PacedPublisher:
    """Publishes messages evenly, one every so many ticks, in whatever bursts they come.

    A message waits for its turn, so that a period that ends a little late or early does not
    give a pair and a pause. Only what exceeds ``max_waiting`` goes out at once, as when stamps run
    faster than the ticks.
    """

    def __init__(self, publisher: RowPublisher, ticks: int, max_waiting: int) -> None:
        self._publisher, self._ticks, self._max_waiting = publisher, ticks, max_waiting
        self._rows: deque[NDArray[np.uint8]] = deque()
        self._since = ticks  # ticks since the last message

    def add(self, rows: NDArray[np.uint8] | None) -> None:
        """Queue messages in order.

        Args:
            rows: One message per row, shape (N, size); None for none.
        """
        self._rows.extend(() if rows is None else rows)

    def tick(self) -> None:
        """Publish the next message if it is its turn; call every tick."""
        self._since += 1
        due = 1 if self._rows and self._since >= self._ticks else 0
        for _ in range(max(due, len(self._rows) - self._max_waiting)):
            self._publisher.publish(self._rows.popleft()[None, :])
            self._since = 0

    def flush(self) -> None:
        """Publish all that waits."""
        while self._rows:
            self._since = self._ticks
            self.tick()


def torque_publisher(node: Node, depth: int) -> RowPublisher:
    """Return the publisher of ``energy/joint_torque``, which loses no sample in a burst."""
    return RowPublisher(node, JointTorque, TORQUE_TOPIC, reliable(depth))


def friction_publisher(node: Node) -> RowPublisher:
    """Return the publisher of ``energy/joint_friction``; late subscribers get its last messages."""
    return RowPublisher(node, JointFriction, FRICTION_TOPIC, latched(FRICTION_DEPTH))


def power_publisher(node: Node, ticks: int, max_waiting: int) -> PacedPublisher:
    """Return the publisher of ``energy/power``, one message every so many ticks."""
    power = RowPublisher(node, PowerState, POWER_TOPIC, reliable(100))
    return PacedPublisher(power, ticks, max_waiting)


def registers_publisher(node: Node) -> RowPublisher:
    """Return the publisher of ``energy/registers``."""
    return RowPublisher(node, EnergyRegisters, REGISTERS_TOPIC, reliable(10))


FRICTION_DEPTH = 100  # messages; what a late subscriber gets at most
