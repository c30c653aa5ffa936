# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Stamps at the limits of their types, live: refused and counted; no node ends or differs."""

from __future__ import annotations

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from ros2_energy_msgs.msg import (
    JointFriction,
    JointTorque,
    MotorTemperatures,
    Payload,
    PowerReading,
)
from ros2_energy_msgs.srv import SetPayload
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from robot_energy.timeline.stamps import MAX_STAMP_NS
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

BAD = [(2**31 - 1, 2**32 - 1), (-1, 0), (-(2**31), 5), (2**31 - 1, 0), (1700000000, 10**9)]
INPUTS = {
    "/joint_states": JointState,
    "/motor_temperatures": MotorTemperatures,
    "/power_meter": PowerReading,
}
COUNT = 250  # messages of each topic at most


def spoiled(row: bytes, stamp: tuple[int, int]) -> bytes:
    seconds, nanoseconds = stamp
    head = seconds.to_bytes(4, "little", signed=True) + nanoseconds.to_bytes(4, "little")
    return row[:4] + head + row[12:]


def with_bad(rows: list[bytes]) -> list[bytes]:
    """Bad ones before the first, in the middle and after the last."""
    bad = [spoiled(rows[0], stamp) for stamp in BAD]
    half = len(rows) // 2
    return [*bad, *rows[:half], *bad, *rows[half:], *bad]


def publish(bench, node, rows_of) -> None:
    for topic, rows in rows_of.items():
        inbox = next(inbox for inbox, _ in node.inputs if inbox.topic == topic)
        publisher = bench.publisher(INPUTS[topic], topic)
        for row in rows:
            publisher.publish(row)
        wanted = len(rows)
        bench.spin_until(lambda inbox=inbox, n=wanted: inbox.received == n, topic)
        bench.tester.destroy_publisher(publisher)


def test_the_energy_monitor_gives_the_figures_of_the_clean_run(bench, messages):
    slow_first = ("/motor_temperatures", "/power_meter", "/joint_states")
    clean = {topic: messages[topic][:COUNT] for topic in slow_first}
    figures = []
    for change in (list, with_bad):
        node = bench.add(EnergyMonitor, model="kr16", state_folder="")
        publish(bench, node, {topic: change(rows) for topic, rows in clean.items()})
        node.close()
        for inbox, log in node.inputs:
            assert log.balanced
            expected = 0 if change is list else 3 * len(BAD)
            assert log.rejected["bad_stamp"] == expected, inbox.topic
        registers, samples = node.account.registers, node.account.counts.samples
        figures.append((registers.microjoule.tolist(), repr(registers.time), samples))
        bench.remove(node)
    assert figures[0] == figures[1]
    assert figures[0][2] == COUNT


def test_the_torque_monitor_gives_the_torques_of_the_clean_run(bench, messages):
    found = []
    for change in (list, with_bad):
        node = bench.add(TorqueMonitor, model="kr16")
        torques = bench.inbox(JointTorque, "energy/joint_torque")
        bench.spin_until(lambda torques=torques: torques.publishers, "the monitor")
        publish(bench, node, {"/joint_states": change(messages["/joint_states"][:COUNT])})
        node.close()
        rows: list[bytes] = []

        def all_taken(torques=torques, rows=rows) -> bool:
            batch = torques.drain()
            rows += [] if batch is None else [batch.row(i) for i in range(len(batch))]
            return len(rows) >= COUNT

        bench.spin_until(all_taken, "torques")
        found.append(rows)
        bench.remove(node)
    assert found[0] == found[1]


def test_the_friction_monitor_gives_the_friction_of_the_clean_run(bench, messages):
    rows = messages["/motor_temperatures"]
    last = deserialize_message(rows[-1], MotorTemperatures)
    found = []
    for change in (list, with_bad):
        node = bench.add(FrictionMonitor, model="kr16")
        latest = bench.latest(JointFriction, "energy/joint_friction")
        publish(bench, node, {"/motor_temperatures": change(rows)})
        bench.spin_until(
            lambda latest=latest: latest() and latest().header.stamp == last.header.stamp,
            "the last friction",
        )
        found.append((latest().header, list(latest().viscous), node.ingest.rejections.accepted))
        bench.remove(node)
    assert found[0] == found[1]


def test_the_power_monitor_refuses_bad_torques_frictions_and_readings(bench, messages):
    node = bench.add(PowerMonitor, model="kr16", state_folder="")
    good = bench.add(TorqueMonitor, model="kr16")
    friction = bench.add(FrictionMonitor, model="kr16")
    bench.spin_until(lambda: node.torques.publishers and node.frictions.publishers, "both")
    publish(bench, good, {"/joint_states": messages["/joint_states"][:COUNT]})
    good.close()
    bench.spin_until(lambda: node.torques.received == COUNT, "torques")
    bench.spin_until(lambda: node.frictions.received, "friction")
    bench.remove(friction)
    torque = bench.publisher(JointTorque, "energy/joint_torque")
    row = good._writer._encoders[0]._template.tobytes()  # any of this model
    readings = bench.publisher(PowerReading, "power_meter")
    for stamp in BAD:
        torque.publish(spoiled(row, stamp))
        readings.publish(spoiled(messages["/power_meter"][0], stamp))
    bench.spin_until(lambda: node.torques.received == COUNT + len(BAD), "bad torques")
    bench.spin_until(lambda: node.readings[0].received == len(BAD), "bad readings")
    node.close()
    assert node._torque.rejections.rejected == {"bad_stamp": len(BAD)}
    assert node._meter.rejections.rejected == {"bad_stamp": len(BAD)}
    assert node.account.counts.samples == COUNT
    assert node.account.registers.time.gap_ns == 0


def test_a_payload_from_beyond_time_is_refused(bench):
    node = bench.add(EnergyMonitor, model="kr16", state_folder="")
    sent = bench.latest(Payload, "energy/payload")
    client = bench.tester.create_client(SetPayload, "energy_monitor/set_payload")
    bench.spin_until(client.service_is_ready, "the service")
    for stamp in ((2**31 - 1, 2**32 - 1), (2**31 - 1, 0), (5, 10**9)):
        request = bench.payload("link_6", stamp=Time(sec=stamp[0], nanosec=stamp[1]))
        future = client.call_async(request)
        bench.spin_until(future.done, "an answer")
        assert not future.result().success
        assert "header.stamp" in future.result().message
    assert sent() is None
    assert node.active


@pytest.mark.parametrize("stamp", [*BAD, (0, 0), divmod(MAX_STAMP_NS, 10**9)])
def test_any_time_on_clock_leaves_the_node_alive(bench, messages, stamp):
    node = bench.add(TorqueMonitor, model="kr16", use_sim_time=True)
    diagnosed = bench.diagnosed()
    clock = bench.publisher(Clock, "/clock")
    message = Clock()
    message.clock.sec, message.clock.nanosec = stamp
    clock.publish(message)
    if stamp in BAD:
        diagnosed.wait("torque_monitor: node", "times on /clock were ignored")
        assert node.bad_clocks == 1
    else:
        now = stamp[0] * 10**9 + stamp[1]
        bench.spin_until(lambda: node.get_clock().now().nanoseconds == now, "the clock")
    publish(bench, node, {"/joint_states": messages["/joint_states"][:50]})
    assert node.ingest.rejections.accepted == 50
    reports = bench.latest(DiagnosticArray, "/diagnostics")
    bench.spin_until(reports, "a report that can be stamped")


def test_a_clock_that_jumps_counts_receipt_within_the_range_only(bench, messages):
    node = bench.add(
        TorqueMonitor, model="kr16", use_sim_time=True, **{"joint_states.stamp_source": "receive"}
    )
    clock = bench.publisher(Clock, "/clock")
    states = bench.publisher(JointState, "joint_states")
    for count, seconds in enumerate((0, 100, 2**31 - 86_400, 2**31 - 1, 101), start=1):
        message = Clock()
        message.clock.sec = seconds
        clock.publish(message)
        valid = seconds * 10**9 <= MAX_STAMP_NS
        if valid:
            bench.spin_until(
                lambda now=seconds: node.get_clock().now().nanoseconds == now * 10**9, "the clock"
            )
        states.publish(messages["/joint_states"][count])
        bench.spin_until(lambda n=count: node.ingest.rejections.received == n, "a joint state")
    log = node.ingest.rejections
    assert log.rejected["zero_stamp"] == 1
    assert log.balanced
