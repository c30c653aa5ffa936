"""Publishers that send serialised messages, and the quality of service of every topic."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, JointTorque, PowerState

from robot_energy.messages import PowerStateWriter, RegistersWriter
from robot_energy.model_file import RobotModel
from robot_energy.pipeline import Ledger
from robot_energy.pipeline.averaging import MeanBlock


def best_effort(depth: int) -> QoSProfile:
    """Return the quality of service of sensor data, which fits every publisher."""
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


def reliable(depth: int) -> QoSProfile:
    """Return the quality of service of results: nothing is lost, nothing is kept."""
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched(depth: int) -> QoSProfile:
    """Return the quality of service of states: a late subscriber gets the last ones."""
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


class RowPublisher:
    """Publishes rows of bytes, each a complete serialised message.

    Args:
        node: The node that publishes.
        message_type: Message class.
        topic: Name of the topic.
        qos: Quality of service.
    """

    def __init__(self, node: Node, message_type: type[Any], topic: str, qos: QoSProfile) -> None:
        self._publisher = node.create_publisher(message_type, topic, qos)

    def publish(self, rows: NDArray[np.uint8] | None) -> None:
        """Publish messages in order.

        Args:
            rows: One message per row, shape (N, size); None for none.
        """
        for row in () if rows is None else rows:
            self._publisher.publish(row.tobytes())


def torque_publisher(node: Node, depth: int) -> RowPublisher:
    """Publisher of ``energy/joint_torque``, which must not lose a sample in a burst."""
    return RowPublisher(node, JointTorque, "energy/joint_torque", reliable(depth))


def friction_publisher(node: Node) -> RowPublisher:
    """Publisher of ``energy/joint_friction``, kept for those who come late."""
    return RowPublisher(node, JointFriction, "energy/joint_friction", latched(FRICTION_DEPTH))


FRICTION_DEPTH = 100  # messages; what a late subscriber gets at most


class BooksPublisher:
    """Publishes powers and registers: ``energy/power`` and ``energy/registers``.

    Args:
        node: The node that publishes.
        model: The robot's model.
        ledger: The books.
    """

    def __init__(self, node: Node, model: RobotModel, ledger: Ledger) -> None:
        self._ledger = ledger
        self._power_writer = PowerStateWriter(model.joint_names, model.model_id)
        self._registers_writer = RegistersWriter(model.joint_names, model.model_id)
        self._power = RowPublisher(node, PowerState, "energy/power", reliable(100))
        self._registers = RowPublisher(node, EnergyRegisters, "energy/registers", reliable(10))

    def power(self, means: MeanBlock | None) -> None:
        """Publish the periods that ended."""
        if means is not None:
            self._power.publish(self._power_writer.encode(means, self._ledger.comparison.location))

    def registers(self) -> None:
        """Publish the registers as they stand, if there are any yet."""
        self._registers.publish(self._registers_writer.encode(self._ledger))
