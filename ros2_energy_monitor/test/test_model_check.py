# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The monitor checks its model once after the start, with the findings of `robot-energy check`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message
from ros2_energy_msgs.msg import MotorTemperatures, PowerReading
from sensor_msgs.msg import JointState

from robot_energy.accounting.meter_checks import MeterDiagnostics
from robot_energy.bag import BagReader
from robot_energy.physics.effort import EffortCheck
from ros2_energy_monitor.diagnostics import model_check
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

NAME = "energy_monitor: model check"
BAG = Path(__file__).resolve().parents[2] / "bags/kr16_cold"
TYPES = {
    "/motor_temperatures": MotorTemperatures,
    "/power_meter": PowerReading,
    "/joint_states": JointState,
}
SECONDS = 15.0
BURST = 300
MOTOR_TORQUE = {"joint_states.effort_meaning": "motor_torque"}


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """A busy machine must not starve the process."""
    monkeypatch.setattr(model_check, "NICENESS", 0)


def unchanged(message: JointState) -> None:
    """Leave a joint state as it is."""


def turned(message: JointState) -> None:
    """Turn the sign of one torque."""
    message.effort[2] *= -1.0


def noisy(message: JointState) -> None:
    """Add noise of 0.2 rad/s to the velocities, whose slope no drive follows."""
    noise = np.random.default_rng(message.header.stamp.nanosec).normal(scale=0.2, size=6)
    message.velocity = (np.asarray(message.velocity) + noise).tolist()


def play(bench: Any, node: EnergyMonitor, change: Callable[[JointState], None] = unchanged) -> None:
    """Publish the beginning of a recording, changed."""
    publishers = {topic: bench.publisher(kind, topic[1:]) for topic, kind in TYPES.items()}
    bag, sent = BagReader(BAG), 0
    until = (bag.start_ns or 0) + round(SECONDS * 1e9)
    for part in bag.parts(TYPES):
        for topic in TYPES:  # those without a place of their own wait in the queue of the node
            batch = part.get(topic)
            for row in range(int(np.searchsorted(batch.log_time_ns, until)) if batch else 0):
                message = deserialize_message(batch.row(row), TYPES[topic])
                if topic == "/joint_states":
                    sent += 1
                    change(message)
                publishers[topic].publish(message)
                if sent % BURST == 1:
                    least = sent - BURST
                    bench.spin_until(
                        lambda least=least: node.ingest.rejections.received >= least, "joint states"
                    )


def test_a_sound_robot_is_said_to_fit(bench):
    node = bench.add(EnergyMonitor, model="kr16", model_check=8.0, **MOTOR_TORQUE)
    diagnosed = bench.diagnosed()
    diagnosed.wait(NAME, "waits for 8 s of motion")
    play(bench, node)
    status = diagnosed.wait(NAME, "no mistake found")
    assert status.level == DiagnosticStatus.OK
    assert "torque" in status.message
    assert "power meter" in status.message
    assert diagnosed.values(status)["moving_time"] == pytest.approx(8.0, abs=2.0)


def test_a_torque_of_the_wrong_sign_is_named_with_its_remedy_first(bench):
    node = bench.add(EnergyMonitor, model="kr16", model_check=8.0, **MOTOR_TORQUE)
    diagnosed = bench.diagnosed()
    play(bench, node, turned)
    status = diagnosed.wait(NAME, "opposite sign")
    assert status.level == DiagnosticStatus.ERROR
    assert "joint_states: {effort: {sign: [1, 1, -1, 1, 1, 1]}}" in status.message[:128]
    assert diagnosed.values(status)["torque_sign.joint_a3"] == -1.0


def test_torques_that_no_drive_has_are_named(bench):
    node = bench.add(EnergyMonitor, model="kr16", model_check=8.0)
    diagnosed = bench.diagnosed()
    play(bench, node, noisy)
    status = diagnosed.wait(NAME, "needs more than its torque limit")
    assert status.level == DiagnosticStatus.WARN


def test_what_counts_on_is_read_between_two_ticks(bench, monkeypatch):
    """Another thread would find sums that a tick is just changing."""
    threads = set()
    for kind, name in ((MeterDiagnostics, "findings"), (EffortCheck, "factors")):
        asked = getattr(kind, name)

        def noted(self, *arguments, asked=asked):
            threads.add(current_thread())
            return asked(self, *arguments)

        monkeypatch.setattr(kind, name, noted)
    node = bench.add(EnergyMonitor, model="kr16", model_check=3.0, **MOTOR_TORQUE)
    play(bench, node)
    bench.diagnosed().wait(NAME, "no mistake found")
    assert threads == {main_thread()}


def test_it_can_be_switched_off(bench):
    bench.add(EnergyMonitor, model="kr16", model_check=0.0, **MOTOR_TORQUE)
    assert bench.diagnosed().wait(NAME, "off").level == DiagnosticStatus.OK


def test_a_node_that_stops_gives_the_check_up(bench):
    node = bench.add(EnergyMonitor, model="kr16", model_check=3.0, **MOTOR_TORQUE)
    diagnosed = bench.diagnosed()
    play(bench, node)
    diagnosed.wait(NAME, "")
    process = bench.spin_until(lambda: node._model_check._process, "the process")
    bench.remove(node)
    assert process.wait(timeout=120.0) is not None
