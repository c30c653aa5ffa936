# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Both ways to take queued messages give the same."""

from __future__ import annotations

import time

import numpy as np
import pytest
from rclpy.executors import Executor
from sensor_msgs.msg import JointState

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from ros2_energy_monitor.base.inbox import Inbox, NeverReady
from ros2_energy_monitor.base.publishers import best_effort, reliable


def state(number: int) -> JointState:
    message = JointState(name=["a", "b"], position=[0.1 * number, 1.0], velocity=[0.0, 0.0])
    message.header.stamp.sec = 1 + number
    return message


def collect(bench, inbox: Inbox, wanted: int) -> list[bytes]:
    rows: list[bytes] = []

    def enough() -> bool:
        batch = inbox.drain()
        if batch is not None:
            rows.extend(batch.row(i) for i in range(len(batch)))
        return len(rows) >= wanted

    bench.spin_until(enough, f"{wanted} messages")
    return rows


@pytest.mark.parametrize("direct", [True, False])
def test_every_message_arrives_once_in_order(bench, direct):
    inbox = Inbox(bench.tester, JointState, "states", reliable(500), direct=direct)
    assert inbox.direct is direct
    publisher = bench.publisher(JointState, "states")
    for number in range(200):
        publisher.publish(state(number))
    rows = collect(bench, inbox, 200)
    assert len(rows) == inbox.received == 200
    assert inbox.drain() is None
    ingest = JointStateIngest(("a", "b"))
    block = ingest.step(RawBatch.from_messages("/states", inbox.msgtype, [0] * 200, rows))
    assert block is not None
    assert np.array_equal(block.joint_position[:, 0], 0.1 * np.arange(200))


def test_a_drained_subscription_never_wakes_the_executor(bench):
    inbox = bench.inbox(JointState, "states")
    publisher = bench.publisher(JointState, "states")

    def idle() -> bool:
        started = time.monotonic()
        bench.executor.spin_once(timeout_sec=0.1)
        return time.monotonic() - started >= 0.09

    bench.spin_until(idle, "an executor with nothing to do")
    publisher.publish(state(1))
    assert idle()
    assert idle()
    assert len(collect(bench, inbox, 1)) == 1


def test_batch_says_topic_type_and_time_of_the_node(bench):
    inbox = bench.inbox(JointState, "states")
    publisher = bench.publisher(JointState, "states")
    before, begin = bench.tester.get_clock().now().nanoseconds, time.monotonic()
    publisher.publish(state(1))
    batch = bench.spin_until(inbox.drain, "a message")
    assert (batch.topic, batch.msgtype) == ("/states", "sensor_msgs/msg/JointState")
    assert before <= batch.log_time_ns[0] <= bench.tester.get_clock().now().nanoseconds
    assert 0 <= inbox.age < time.monotonic() - begin
    assert inbox.publishers == 1


@pytest.mark.parametrize("direct", [True, False])
def test_a_full_queue_is_noticed(bench, direct):
    inbox = Inbox(bench.tester, JointState, "states", reliable(10), direct=direct)
    publisher = bench.publisher(JointState, "states")
    for number in range(50):
        publisher.publish(state(number))
        bench.executor.spin_once(timeout_sec=0.001)
    rows = collect(bench, inbox, 10)
    assert len(rows) == 10
    assert inbox.overflows == 1


def test_age_is_unknown_before_the_first_message(bench):
    assert np.isnan(Inbox(bench.tester, JointState, "states", best_effort(5)).age)


def changed_executor(self, entity):
    return True


def executor_without_the_question(self, *, entity, group):
    return False


@pytest.mark.parametrize("replacement", [changed_executor, executor_without_the_question])
def test_without_the_internals_of_rclpy_callbacks_take_over(bench, monkeypatch, replacement):
    monkeypatch.setattr(Executor, "can_execute", replacement)
    inbox = bench.inbox(JointState, "states")
    assert not inbox.direct
    monkeypatch.undo()
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    publisher = bench.publisher(JointState, "states")
    for number in range(20):
        publisher.publish(state(number))
    assert len(collect(bench, inbox, 20)) == 20


def test_the_group_refuses_everything():
    group = NeverReady()
    assert not group.can_execute(None)
    assert not group.beginning_execution(None)
    group.ending_execution(None)
