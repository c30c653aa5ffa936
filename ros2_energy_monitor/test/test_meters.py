# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters of several types, live: subscribed, read and compared as their parameters say."""

import time

import diagnostic_msgs.msg
import geometry_msgs.msg
import numpy as np
import pytest
import ros2_energy_msgs.msg
import sensor_msgs.msg
import std_msgs.msg
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.foundation.errors import ParameterError
from ros2_energy_monitor.base.message_definitions import definitions_of
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor


@pytest.mark.parametrize(
    "message",
    [
        sensor_msgs.msg.BatteryState,
        sensor_msgs.msg.JointState,
        sensor_msgs.msg.Imu,
        diagnostic_msgs.msg.DiagnosticArray,
        geometry_msgs.msg.PoseWithCovarianceStamped,
        std_msgs.msg.Float64MultiArray,
        std_msgs.msg.Byte,
        std_msgs.msg.Bool,
        ros2_energy_msgs.msg.PowerState,
        ros2_energy_msgs.msg.EnergyRegisters,
    ],
)
def test_definitions_of_installed_messages_are_those_known(message):
    found = definitions_of(message)
    assert f"{message.__module__.split('.')[0]}/msg/{message.__name__}" in found
    assert len(typestore().fielddefs) > 100  # all of Jazzy has been read
    assert extended(typestore(), found) is typestore()  # nothing differs, nothing is new


def test_a_pair_of_topics_gives_power(bench):
    parameters = {
        "meter.type": "std_msgs/msg/Float64",
        "meter.voltage_topic": "volt",
        "meter.current_topic": "/ampere",
        "meter.location": "dc_bus",
    }
    node = bench.add(EnergyMonitor, model="kr16", meter_max_gap=60.0, **parameters)
    volt, ampere = bench.publisher(Float64, "volt"), bench.publisher(Float64, "ampere")
    account = node.inputs[-1][1]
    start = time.time_ns()
    for index in range(20):
        volt.publish(Float64(data=48.0))
        ampere.publish(Float64(data=float(index)))
    bench.spin_until(lambda: account.received == 40, "voltages and currents")
    bench.spin_until(lambda: node.account.comparison.curve.rejections.received >= 19, "readings")
    curve = node.account.comparison.curve
    assert (
        curve.rejections.accepted == curve.rejections.received
    )  # each has its own time of receipt
    assert start <= curve.newest_ns <= time.time_ns()
    diagnosed = bench.diagnosed()
    status = diagnosed.wait("energy_monitor: energy", "all is well")
    values = diagnosed.values(status)
    assert values["meter_current_received"] == values["meter_voltage_accepted"] == 40


def test_a_battery_is_read_live(bench):
    node = bench.add(PowerMonitor, model="kr16", **{"meter.type": "sensor_msgs/msg/BatteryState"})
    publisher = bench.publisher(BatteryState, "power_meter")
    for stamp in range(1, 6):
        message = BatteryState(voltage=50.0, current=-2.0)
        message.header.stamp.sec = stamp
        publisher.publish(message)
    curve = node.account.comparison.curve
    bench.spin_until(lambda: curve.rejections.received == 5, "batteries")
    assert curve.newest_ns == 5 * 10**9
    assert np.isclose(curve._last[1], 100.0)


def test_any_installed_message_can_be_a_meter(bench):
    parameters = {
        "meter.type": "sensor_msgs/msg/Temperature",  # as good as any stamped number
        "meter.value_path": "temperature",
        "meter.unit": "Wh",
        "meter.location": "grid",
    }
    node = bench.add(PowerMonitor, model="kr16", **parameters)
    publisher = bench.publisher(sensor_msgs.msg.Temperature, "power_meter")
    for stamp in range(1, 6):
        message = sensor_msgs.msg.Temperature(temperature=1000.0 + stamp)
        message.header.stamp.sec = stamp
        publisher.publish(message)
    counter = node.account.comparison.curve
    bench.spin_until(lambda: counter.rejections.accepted == 5, "counts")


def test_a_type_that_is_not_installed_costs_the_meter_alone(bench):
    parameters = {
        "meter.type": "acme_msgs/msg/Power",
        "meter.value_path": "power",
        "meter.unit": "W",
        "meter.meaning": "instantaneous",
        "meter.location": "grid",
    }
    node = bench.add(PowerMonitor, model="kr16", **parameters)
    assert node.readings == []
    diagnosed = bench.diagnosed()
    diagnosed.wait("power_monitor: energy", "no joint torque has arrived")


def test_settings_that_contradict_each_other_stop_the_node(bench):
    with pytest.raises(ParameterError, match=r"'meter' of power_monitor: unit given for Pow"):
        bench.add(PowerMonitor, model="kr16", **{"meter.unit": "W"})
