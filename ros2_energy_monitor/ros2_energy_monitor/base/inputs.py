# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The inputs that several nodes share: joint states, motor temperatures, the power meter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.foundation.errors import MessageTypeError
from robot_energy.foundation.shown_text import shown
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.meter.source import MeterInputs
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.sources import TemperatureInputs
from robot_energy.inputs.temperatures.kinds import INTERFACE_NAMES
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.model import RobotModel
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.message_classes import message_class
from ros2_energy_monitor.base.message_definitions import definitions_of
from ros2_energy_monitor.base.node_parameters import EnergyParameters, TorqueParameters
from ros2_energy_monitor.base.publishers import best_effort, latched

SLOW_DEPTH = 500  # messages of temperatures and meters, which come at 0.1 to 1000 Hz

KEYS_DEPTH = 10  # messages with names of values, of which the last one counts


def wanted_class(node: Node, msgtype: str, use: str) -> type[Any] | None:
    """Return the class of a message type, or None after an error in the log.

    Packages of messages are optional: one that is not installed costs only the inputs
    that need it.

    Args:
        msgtype: Type of a message, such as ``control_msgs/msg/DynamicJointState``.
    """
    try:
        return message_class(msgtype)
    except MessageTypeError as error:
        node.get_logger().error(f"{shown(use)} is not read: {error}")
        return None


def temperature_ingest(
    node: Node, parameters: TemperatureInputs, model: RobotModel
) -> TemperatureIngest:
    """Return what reads the sources of motor temperatures.

    Sources whose messages are not installed are left out, after an error in the log.
    """
    sources = {
        name: source.resolved(node.resolve_topic_name)
        for name, source in parameters.temperature_sources.items()
        if all(
            [wanted_class(node, kind, f"the source '{name}'") for kind in source.topics.values()]
        )
    }
    return TemperatureIngest(model.joint_names, sources, stale_after=model.temperature.stale_after)


def joint_state_inboxes(node: Node, parameters: TorqueParameters | EnergyParameters) -> list[Inbox]:
    """Return an inbox for every topic of joint states; at least one."""
    return [
        Inbox(
            node,
            JointState,
            topic,
            best_effort(parameters.joint_state_depth),
            renew_after=parameters.resubscribe_after,
        )
        for topic in parameters.joint_states.topics
    ]


def temperature_inboxes(node: Node, ingest: TemperatureIngest, renew_after: float) -> list[Inbox]:
    """Return an inbox for every topic of motor temperatures and keys whose type is installed.

    Args:
        renew_after: Silence after which a topic is subscribed again. [s]
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
        if (kind_class := wanted_class(node, kind, topic)) is not None
    ]


def temperature_inputs(
    ingest: TemperatureIngest, inboxes: Sequence[Inbox]
) -> list[tuple[Inbox, RejectionLog]]:
    """Return every inbox of values with its rejection log.

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
        renew_after: Silence after which a topic is subscribed again. [s]

    Returns:
        What reads the meter, and one inbox per topic; without messages, a reader of no meter
        and no inbox.
    """
    source = parameters.meter.resolved(node.resolve_topic_name)
    kind = wanted_class(node, source.type, "the meter")
    if kind is None:
        return MeterIngest(), []
    known = extended(typestore(), definitions_of(kind))
    inboxes = [
        Inbox(node, kind, topic, best_effort(SLOW_DEPTH), renew_after=renew_after)
        for topic in source.topics
    ]
    return MeterIngest(source, known), inboxes
