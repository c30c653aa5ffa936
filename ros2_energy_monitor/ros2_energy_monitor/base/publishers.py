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
from ros2_energy_monitor.checkpoints import CLOSING, Checkpoints, folder_of
from ros2_energy_monitor.node_parameters import BooksParameters
from ros2_energy_monitor.register_services import RegisterServices


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
    """Publishes powers and registers, and keeps the registers on disk.

    Args:
        node: The node that publishes ``energy/power`` and ``energy/registers``.
        model: The robot's model.
        ledger: The books.
        parameters: Where and how often they are kept.

    Attributes:
        checkpoints: What keeps them.
    """

    def __init__(
        self, node: Node, model: RobotModel, ledger: Ledger, parameters: BooksParameters
    ) -> None:
        self._ledger = ledger
        self._power_writer = PowerStateWriter(model.joint_names, model.model_id)
        writer = RegistersWriter(model.joint_names, model.model_id)
        self._power = RowPublisher(node, PowerState, "energy/power", reliable(100))
        registers = RowPublisher(node, EnergyRegisters, "energy/registers", reliable(10))
        self.checkpoints = Checkpoints(
            node,
            model,
            ledger,
            folder_of(parameters.state_folder),
            parameters.checkpoint_period,
            lambda persisted: writer.encode(ledger, persisted),
            registers.publish,
        )
        RegisterServices(node, ledger, self.checkpoints, model.joint_names)

    def power(self, means: MeanBlock | None) -> None:
        """Publish the periods that ended."""
        if means is not None:
            self._power.publish(self._power_writer.encode(means, self._ledger.comparison.location))

    def begin(self) -> None:
        """Keep and publish the registers from now on."""
        self.checkpoints.running = True

    def finish(self) -> None:
        """Keep and publish the registers once more, and then no longer."""
        self.checkpoints.now(CLOSING)
        self.checkpoints.running = False
