"""The inputs that several nodes share: motor temperatures and the power meter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from ros2_energy_msgs.msg import MotorTemperatures, PowerReading
from sensor_msgs.msg import Temperature

from robot_energy.ingest.temperatures import MOTOR_TEMPERATURES, TEMPERATURE
from robot_energy.wire.batch import RawBatch
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.node_parameters import EnergyParameters, FrictionParameters
from ros2_energy_monitor.publishers import best_effort

TEMPERATURE_CLASSES: dict[str, type[Any]] = {
    MOTOR_TEMPERATURES: MotorTemperatures,
    TEMPERATURE: Temperature,
}
SLOW_DEPTH = 500  # messages of temperatures and meters, which come at 0.1 to 1000 Hz


def temperature_inboxes(
    node: Node, parameters: FrictionParameters | EnergyParameters
) -> list[Inbox]:
    """Subscribe every topic of motor temperatures.

    Args:
        node: The node that subscribes.
        parameters: Names and type of the topics.
    """
    message_type = TEMPERATURE_CLASSES[parameters.temperature_type]
    return [
        Inbox(node, message_type, topic, best_effort(SLOW_DEPTH))
        for topic in parameters.temperature_topics
    ]


def meter_inbox(node: Node) -> Inbox:
    """Subscribe the power meter."""
    return Inbox(node, PowerReading, "power_meter", best_effort(SLOW_DEPTH))


def drain_all(inboxes: Sequence[Inbox]) -> list[RawBatch]:
    """Take what waits in each inbox; those with nothing are left out."""
    return [batch for inbox in inboxes if (batch := inbox.drain()) is not None]
