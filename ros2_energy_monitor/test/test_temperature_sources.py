# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Motor temperatures live, from messages of several types at once."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ros2_energy_msgs.msg import JointFriction, MotorTemperatures
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64MultiArray

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.temperatures.stuck import StuckTemperatureDetector
from robot_energy.model import load
from ros2_energy_monitor.diagnostics.energy import stuck_temperatures
from ros2_energy_monitor.diagnostics.node import unbalanced
from ros2_energy_monitor.diagnostics.reporter import WARN, StatusBuilder
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor

SOURCES = {
    "temperature_sources": ["row", "text", "more", "wrist"],
    "more.topic": "/diagnostics",
    "more.type": "diagnostic_msgs/msg/DiagnosticArray",
    "more.joints": ["joint_a5"],
    "more.names": ["drive 5"],
    "row.topic": "arm/temperatures",
    "row.type": "std_msgs/msg/Float64MultiArray",
    "row.joints": ["joint_a1", "-", "joint_a2"],
    "row.unit": "kelvin",
    "text.topic": "/diagnostics",
    "text.type": "diagnostic_msgs/msg/DiagnosticArray",
    "text.joints": ["joint_a3"],
    "text.names": ["drive 3*"],
    "text.keys": ["motor temperature"],
    "wrist.topic": "wrist",
    "wrist.type": "sensor_msgs/msg/Temperature",
    "wrist.joints": ["joint_a4"],
}


def stamped(bench, message):
    message.header.stamp = bench.tester.get_clock().now().to_msg()
    return message


def test_sources_of_several_types_give_one_friction(bench):
    node = bench.add(FrictionMonitor, model="kr16", **SOURCES)
    latest = bench.latest(JointFriction, "energy/joint_friction")
    status = DiagnosticStatus(
        name="drive 3 (x)", values=[KeyValue(key="motor temperature", value="33.5 C")]
    )
    other = DiagnosticStatus(name="drive 5", values=[KeyValue(key="temperature", value="308.65 K")])
    for kind, topic, message in (
        (Float64MultiArray, "arm/temperatures", Float64MultiArray(data=[304.15, 0.0, 305.15])),
        (
            DiagnosticArray,
            "/diagnostics",
            stamped(bench, DiagnosticArray(status=[status, other])),
        ),
        (Temperature, "wrist", stamped(bench, Temperature(temperature=34.0))),
    ):
        bench.publisher(kind, topic).publish(message)
    expected = [31.0, 32.0, 33.5, 34.0, 35.5, np.nan]
    bench.spin_until(
        lambda: latest() and np.isfinite(latest().motor_temperature_degc).sum() == 5,
        "the friction of five motors",
    )
    np.testing.assert_allclose(latest().motor_temperature_degc, expected)
    assert unbalanced(node.inputs) == []
    by_name = {reader.name: reader.rejections for reader in node.ingest.readers}
    assert {name: account.accepted for name, account in by_name.items()} == {
        "row": 1, "text": 1, "more": 1, "wrist": 1,
    }  # fmt: skip


def test_a_source_whose_messages_are_not_installed_costs_only_itself(bench, capfd):
    node = bench.add(
        FrictionMonitor,
        model="kr16",
        temperature_sources=["states", "motors"],
        **{"states.topic": "states", "states.type": "control_msgs/msg/DynamicJointState"},
    )
    output = capfd.readouterr().err
    if "control_msgs" not in output:
        pytest.skip("control_msgs is installed here")
    assert (
        output.count("the source 'states' is not read: the message type control_msgs/msg/Dyn") == 1
    )
    assert "Install ros-jazzy-control-msgs" in output
    assert [reader.name for reader in node.ingest.readers] == ["motors"]
    latest = bench.latest(JointFriction, "energy/joint_friction")
    bench.publisher(MotorTemperatures, "motor_temperatures").publish(
        stamped(bench, MotorTemperatures(joint_names=["joint_a2"], temperature_degc=[40.0]))
    )
    bench.spin_until(
        lambda: latest() and latest().motor_temperature_degc[1] == 40.0, "the other source"
    )


def test_a_joint_that_the_model_lacks_stops_the_start(bench):
    with pytest.raises(ParameterError, match="'motors' names joint_1; expected joints of the"):
        bench.add(FrictionMonitor, model="kr16", **{"motors.joints": ["joint_1"]})


def test_diagnostics_say_which_unit_the_readings_look_like(bench):
    bench.add(FrictionMonitor, model="kr16")
    latest = bench.latest(DiagnosticArray, "/diagnostics")
    publisher = bench.publisher(MotorTemperatures, "motor_temperatures")
    message = MotorTemperatures(joint_names=["joint_a2"], temperature_degc=[318.0])

    def said():
        publisher.publish(stamped(bench, message))
        statuses = latest().status if latest() else []
        return any(
            "/motor_temperatures reads 318 for joint_a2: set unit: kelvin" in status.message
            for status in statuses
        )

    bench.spin_until(said, "the unit in the diagnostics")


def test_diagnostics_name_the_thermometers_that_hang():
    model = load("kr16")
    watch = StuckTemperatureDetector(model)
    check = stuck_temperatures(watch, model)
    found = StatusBuilder("energy")
    check(found)
    assert found.values == {"temperatures_stuck": 0}
    assert found.message == "all is well"
    watch.stuck[[1, 4]], watch.rise[1] = True, 3.4
    check(found)
    assert found.values == {"temperatures_stuck": 2}
    assert found.level == WARN
    assert "joint_a2, joint_a5 has not changed although" in found.message
    assert "by 3 K" in found.message
