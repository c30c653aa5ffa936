"""The inputs that several nodes share: joint states, motor temperatures, the power meter."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from robot_energy.ingest import Accounting, MeterIngest, TemperatureIngest
from robot_energy.ingest.meter_source import MeterInputs
from robot_energy.ingest.sources import INTERFACE_NAMES, TemperatureInputs
from robot_energy.model_file import RobotModel
from robot_energy.wire.batch import RawBatch
from robot_energy.wire.types import extended, typestore
from ros2_energy_monitor.definitions import definitions_of
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.node_parameters import EnergyParameters, TorqueParameters
from ros2_energy_monitor.publishers import best_effort, latched

SLOW_DEPTH = 500  # messages of temperatures and meters, which come at 0.1 to 1000 Hz

KEYS_DEPTH = 10  # messages with names of values, of which the last one counts


def message_class(node: Node, msgtype: str, use: str) -> type[Any] | None:
    """Return the class of a message type, or None after an error in the log.

    Packages of messages are optional: one that is not installed costs the inputs that need
    it, and nothing else.

    Args:
        node: The node that asks.
        msgtype: Type of a message, such as ``control_msgs/msg/DynamicJointState``.
        use: What it is for, for the log.
    """
    package, _, name = msgtype.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        node.get_logger().error(
            f"{use} is not read: it needs {msgtype}, which is not installed; install "
            f"ros-jazzy-{package.replace('_', '-')} or take it out of the parameters"
        )
        return None


def temperature_ingest(
    node: Node, parameters: TemperatureInputs, model: RobotModel
) -> TemperatureIngest:
    """Return what reads the sources of motor temperatures.

    Sources whose messages are not installed are left out, after an error in the log.

    Args:
        node: The node that subscribes.
        parameters: The sources.
        model: The robot's model.

    Raises:
        ParameterError: If a source names a joint that the model lacks.
    """
    sources = {
        name: source.resolved(node.resolve_topic_name)
        for name, source in parameters.temperature_sources.items()
        if all(
            [message_class(node, kind, f"the source '{name}'") for kind in source.topics.values()]
        )
    }
    return TemperatureIngest(model.joint_names, sources)


def joint_state_inboxes(node: Node, parameters: TorqueParameters | EnergyParameters) -> list[Inbox]:
    """Subscribe every topic of joint states; at least one.

    Args:
        node: The node that subscribes.
        parameters: The topics, and how many of their messages can wait.
    """
    return [
        Inbox(
            node,
            JointState,
            topic,
            best_effort(parameters.joint_state_depth),
            renew_after=parameters.resubscribe_after,
        )
        for topic in parameters.joint_states.joint_state_topics
    ]


def temperature_inboxes(node: Node, ingest: TemperatureIngest, renew_after: float) -> list[Inbox]:
    """Subscribe every topic of motor temperatures, and the keys of those that have some.

    Args:
        node: The node that subscribes.
        ingest: What reads the topics.
        renew_after: Silence after which a topic is subscribed anew. [s]
    """
    return [
        Inbox(
            node,
            kind_class,
            topic,
            latched(KEYS_DEPTH) if kind == INTERFACE_NAMES else best_effort(SLOW_DEPTH),
            renew_after=None if kind == INTERFACE_NAMES else renew_after,
        )
        for topic, kind in ingest.topics.items()
        if (kind_class := message_class(node, kind, topic)) is not None
    ]


def temperature_inputs(
    ingest: TemperatureIngest, inboxes: Sequence[Inbox]
) -> list[tuple[Inbox, Accounting]]:
    """Return every inbox of values with its account.

    Not those of the keys: keys come once, and what came while the node was inactive is of
    use later.
    """
    return [
        (inbox, ingest.account_of(inbox.topic))
        for inbox in inboxes
        if inbox.msgtype != INTERFACE_NAMES
    ]


def meter_input(
    node: Node, parameters: MeterInputs, renew_after: float
) -> tuple[MeterIngest, list[Inbox]]:
    """Subscribe the power meter and return what reads it.

    Where its messages are not installed, nothing is subscribed, after an error in the log.

    Args:
        node: The node that subscribes.
        parameters: What the meter is.
        renew_after: Silence after which a topic is subscribed anew. [s]

    Raises:
        ParameterError: If the messages lack what the parameters name.
    """
    source = parameters.meter.resolved(node.resolve_topic_name)
    kind = message_class(node, source.type, "the meter")
    if kind is None:
        return MeterIngest(), []
    known = extended(typestore(), definitions_of(kind))
    inboxes = [
        Inbox(node, kind, topic, best_effort(SLOW_DEPTH), renew_after=renew_after)
        for topic in source.topics
    ]
    return MeterIngest(source, known), inboxes


def drain_all(inboxes: Sequence[Inbox]) -> list[RawBatch]:
    """Take what waits in each inbox; those with nothing are left out."""
    return [batch for inbox in inboxes if (batch := inbox.drain()) is not None]
