# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What a node says about itself: its accounts, its name, its clock, its pace."""

from __future__ import annotations

import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, JointTorque
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from ros2_energy_monitor.base.tick_statistics import TickStatistics
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

NAME = "torque_monitor: node"


def test_state_pace_and_memory_are_numbers(bench):
    bench.add(TorqueMonitor, model="kr16", tick_rate=50.0)
    diagnosed = bench.diagnosed()
    diagnosed.wait(NAME, "all is well")

    def paced() -> dict:
        """A report; a stall of the machine spoils one or two."""
        values = diagnosed.values(diagnosed[NAME])
        sound = 0 < values["busy_share"] < 1 and values["longest_tick_s"] < 1
        return values if sound and 0 < values["tick_rate"] < 75 else {}

    values = bench.spin_until(paced, "a report with ticks")
    assert values["lifecycle_state"] == "active"
    assert 20 < values["memory_mb"] < 4000
    assert values["findings"] == 0


def test_pace_is_measured_between_reports(monkeypatch):
    now = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    tick_statistics = TickStatistics(0.01)
    for pause in (0.0, 0.05):
        now += pause  # the second tick is late
        with tick_statistics.tick():
            now += 0.001
    found = tick_statistics.take()
    assert found["latest_tick_s"] == pytest.approx(0.041)
    assert found["busy_share"] == pytest.approx(0.002 / 0.052)
    assert found["tick_rate"] == pytest.approx(2 / 0.052)
    with tick_statistics.tick():
        now += 0.02
    now += 0.02
    found = tick_statistics.take()
    assert found["longest_tick_s"] == pytest.approx(0.02)
    assert found["busy_share"] == pytest.approx(0.5)
    now += 1.0
    assert tick_statistics.take()["tick_rate"] == 0.0


@pytest.mark.parametrize("defect", ["accepted", "received", "taken"])
def test_an_account_that_does_not_add_up_is_an_error(bench, defect):
    node = bench.add(TorqueMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    publisher.publish(JointState())
    bench.spin_until(lambda: node.ingest.rejections.received == 1, "a message")
    if defect == "taken":
        node.joint_states.received += 1  # taken from the queue, and never handed on
    else:
        setattr(node.ingest.rejections, defect, getattr(node.ingest.rejections, defect) + 1)
    status = diagnosed.wait(NAME, "accounting of /joint_states does not add up")
    assert status.level == DiagnosticStatus.ERROR
    numbers = {
        "accepted": (1, 1, 1, 1),
        "received": (1, 2, 0, 1),
        "taken": (2, 1, 0, 1),
    }[defect]
    words = "{} messages taken, {} received, {} accepted, {} rejected, 0 waiting".format(*numbers)
    assert words in status.message


@pytest.mark.parametrize("monitor", [TorqueMonitor, FrictionMonitor, PowerMonitor, EnergyMonitor])
def test_no_defect_is_found_in_a_healthy_node(bench, monitor, messages):
    node = bench.add(monitor, model="kr16")
    diagnosed = bench.diagnosed()
    for publisher, topic in [(bench.publisher(JointState, "joint_states", 0), "/joint_states")]:
        for message in messages[topic][:500]:
            publisher.publish(message)
    status = diagnosed.wait(f"{node.get_name()}: node", "all is well")
    assert status.level == DiagnosticStatus.OK


@pytest.mark.parametrize("monitor", [TorqueMonitor, EnergyMonitor])
def test_an_effort_that_is_not_what_it_is_taken_for_is_named(bench, monitor, messages):
    taken_for = {"joint_states.effort_meaning": "joint_torque"}  # the virtual robot's is of motors
    node = bench.add(monitor, model="kr16", input_timeout=60.0, **taken_for)
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states", 0)
    for row in messages["/joint_states"][:500]:
        publisher.publish(row)
    status = diagnosed.wait(f"{node.get_name()}: joint states", "is probably motor_torque")
    assert "taken for joint_torque" in status.message
    assert status.level == DiagnosticStatus.WARN


def test_time_that_is_neither_observed_nor_gap_is_an_error(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    name = "energy_monitor: energy"

    def feed(rows: list[bytes]) -> None:
        for row in rows:
            publisher.publish(row)
        before = node.account.registers.time.end_ns
        bench.spin_until(lambda: node.account.registers.time.end_ns != before, "power")

    feed(messages["/joint_states"][:100])
    # a check that has seen the account, which the next one is compared with
    assert diagnosed.wait_anew(name, "prediction only").level == DiagnosticStatus.OK
    node.account.registers.time.gap_ns += 1
    status = diagnosed.wait(name, "accounting of time does not add up: ")
    assert status.level == DiagnosticStatus.ERROR
    assert "0 ns passed, 1 ns were booked" in status.message
    feed(messages["/joint_states"][100:200])
    assert diagnosed.wait(name, "prediction only").level == DiagnosticStatus.OK


def test_a_second_node_of_the_same_name_is_noticed(bench):
    bench.add(TorqueMonitor, model="kr16")
    bench.add(TorqueMonitor, model="kr16")
    status = bench.diagnosed().wait(NAME, "2 nodes are named /torque_monitor")
    assert status.level == DiagnosticStatus.WARN


@pytest.mark.parametrize(
    ("node_type", "kind", "topic"),
    [
        (EnergyMonitor, EnergyRegisters, "energy/registers"),
        (TorqueMonitor, JointTorque, "energy/joint_torque"),
        (FrictionMonitor, JointFriction, "energy/joint_friction"),
    ],
)
def test_a_second_publisher_of_an_output_is_named(bench, node_type, kind, topic):
    """A power monitor counts each torque that is not older than the last one."""
    bench.tester.create_publisher(kind, topic, 10)
    name = bench.add(node_type, model="kr16").get_name()
    both = " and ".join(sorted([f"/{name}", "/tester"]))
    bench.diagnosed().wait(f"{name}: node", f"{topic} is published by {both}")


def test_a_twin_is_to_be_stopped_once(bench):
    for _ in range(2):
        bench.add(EnergyMonitor, model="kr16", state_folder="")
    found = bench.diagnosed().wait("energy_monitor: node", "energy/registers is published by")
    assert "2 nodes are named /energy_monitor; energy/registers is published by" in found.message
    assert found.message.count("stop one of them") == 1


def test_without_clock_the_node_waits_and_still_counts(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16", use_sim_time=True)
    diagnosed = bench.diagnosed()
    name = "energy_monitor: node"
    status = diagnosed.wait(name, "waiting for clock")
    assert status.level == DiagnosticStatus.WARN
    publisher = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:200]:
        publisher.publish(message)
    bench.spin_until(lambda: node.ingest.rejections.accepted == 200, "joint states")
    clock = bench.publisher(Clock, "/clock")
    message = Clock()
    message.clock.sec = 100
    clock.publish(message)
    diagnosed.wait(name, "all is well")
    message.clock.sec = 50  # back
    clock.publish(message)
    bench.spin_until(lambda: node.get_clock().now().nanoseconds == 50 * 10**9, "the jump")
    for message in messages["/joint_states"][200:400]:
        publisher.publish(message)
    bench.spin_until(lambda: node.ingest.rejections.accepted == 400, "joint states")
    node.close()
    time_account = node.account.registers.time
    assert time_account.gap_ns == 0
    assert time_account.jumps == 0


def test_steps_of_the_system_clock_change_nothing(bench, messages, monkeypatch):
    """Totals, ages and the rates of ticks and reports follow stamps and the steady clock."""
    totals = []
    for steps in ((0,), (3600, -3600, 7200, -86_400)):
        node = bench.add(EnergyMonitor, model="kr16", state_folder="")
        publisher = bench.publisher(JointState, "joint_states")
        rows = messages["/joint_states"][:400]
        size = len(rows) // len(steps)
        for number, step in enumerate(steps):
            now = node.get_clock().now
            monkeypatch.setattr(time, "time", lambda step=step, real=time.time: real() + step)
            monkeypatch.setattr(
                type(node.get_clock()),
                "now",
                lambda self, step=step, real=now: stepped(real(), step),
            )
            for message in rows[number * size : (number + 1) * size]:
                publisher.publish(message)
            bench.spin_until(
                lambda account=node.ingest.rejections, wanted=(number + 1) * size: (
                    account.accepted == wanted
                ),
                "states",
            )
            assert 0 <= node.joint_states.age < 1000  # less than any step
            monkeypatch.undo()
            monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
        node.close()
        totals.append((node.account.registers.microjoule.tolist(), node.account.registers.time))
        bench.tester.destroy_publisher(publisher)
        bench.remove(node)
    assert totals[0] == totals[1]


def stepped(now, seconds: int):
    """Time of a clock that was set forward or back."""
    return type(now)(
        nanoseconds=max(0, now.nanoseconds + seconds * 10**9), clock_type=now.clock_type
    )


def test_a_plain_node_is_no_twin(bench):
    bench.add(Node, "torque")
    bench.add(TorqueMonitor, model="kr16")
    bench.diagnosed().wait(NAME, "all is well")
