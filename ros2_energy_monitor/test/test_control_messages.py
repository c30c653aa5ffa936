# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Motor temperatures from the messages of ros2_control, where they are installed."""

from __future__ import annotations

import numpy as np
import pytest
from ros2_energy_msgs.msg import JointFriction

from ros2_energy_monitor.base.publishers import latched
from ros2_energy_monitor.diagnostics.node import unbalanced
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor

messages = pytest.importorskip("control_msgs.msg", reason="control_msgs is not installed")


def stamped(bench, message):
    message.header.stamp = bench.tester.get_clock().now().to_msg()
    return message


def test_joint_states_and_values_whose_keys_came_while_the_node_was_inactive(bench):
    keys = bench.tester.create_publisher(messages.Keys, "b/names", latched(1))
    keys.publish(stamped(bench, messages.Keys(keys=["x/position", "joint_a2/temperature"])))
    node = bench.add(
        FrictionMonitor,
        model="kr16",
        autostart=False,
        temperature_sources=["states", "pair"],
        **{
            "states.topic": "dynamic_joint_states",
            "states.type": "control_msgs/msg/DynamicJointState",
            "states.unit": "kelvin",
            "pair.topic": "b/values",
            "pair.type": "control_msgs/msg/Float64Values",
        },
    )
    node.trigger_configure()
    bench.spin_until(lambda: keys.get_subscription_count() == 1, "the subscriber of the keys")
    publisher = bench.publisher(messages.Float64Values, "b/values")
    publisher.publish(stamped(bench, messages.Float64Values(values=[0.0, 99.0])))
    account = node.ingest.account_of("/b/values")
    bench.spin_until(lambda: account.rejected["inactive"] == 1, "a value that is discarded")
    node.trigger_activate()
    latest = bench.latest(JointFriction, "energy/joint_friction")
    publisher.publish(stamped(bench, messages.Float64Values(values=[0.0, 32.0])))
    entries = [{"position": 0.0, "temperature": 304.15}, {"temperature": 309.15}]
    state = messages.DynamicJointState(
        joint_names=["joint_a1", "joint_a6"],
        interface_values=[
            messages.InterfaceValue(interface_names=list(entry), values=list(entry.values()))
            for entry in entries
        ],
    )
    bench.publisher(messages.DynamicJointState, "dynamic_joint_states").publish(
        stamped(bench, state)
    )
    bench.spin_until(
        lambda: latest() and np.isfinite(latest().motor_temperature_degc).sum() == 3,
        "the friction of three motors",
    )
    np.testing.assert_allclose(
        latest().motor_temperature_degc, [31.0, 32.0, np.nan, np.nan, np.nan, 36.0]
    )
    assert unbalanced(node.inputs) == []
