# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The executor of the nodes: timers in time, services and latched topics soon, no wait sets."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import Trigger

from ros2_energy_monitor.base.run_node import TickExecutor

LIMIT = 120.0  # s; then the test fails


class Counting(TickExecutor):
    """Counts the wait sets."""

    waits = looks = 0

    def _execute_all(self):
        self.looks += 1
        super()._execute_all()

    def _wait_for_ready_callbacks(self, *arguments, **keywords):
        self.waits += 1
        return super()._wait_for_ready_callbacks(*arguments, **keywords)


@pytest.fixture
def executor() -> Iterator[Counting]:
    context = Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    executor = Counting(context)
    executor.add_node(Node("ticking", context=context))
    yield executor
    executor.shutdown()
    for node in executor.get_nodes():
        node.destroy_node()
    context.try_shutdown()


def spin_until(executor: Counting, condition) -> None:
    limit = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < limit
        executor.spin_once(0.1)


def test_timers_run_between_looks_at_services(executor):
    (node,) = executor.get_nodes()
    called: list[int] = []
    node.create_timer(0.01, lambda: called.append(executor.waits))
    node.create_service(Trigger, "done", lambda request, response: response)
    answer = node.create_client(Trigger, "done")
    spin_until(executor, answer.service_is_ready)
    future = answer.call_async(Trigger.Request())
    spin_until(executor, lambda: future.done() and len(called) > 50)
    # Most of them come without a wait set, as soon as the machine has time for it.
    spin_until(executor, lambda: len(set(called)) < len(called) / 2)


def test_requests_that_wait_are_answered_at_one_look(executor):
    (node,) = executor.get_nodes()
    looks: set[int] = set()

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        looks.add(executor.looks)
        return response

    many = QoSProfile(depth=50)
    node.create_service(Trigger, "done", answer, qos_profile=many)
    client = node.create_client(Trigger, "done", qos_profile=many)
    spin_until(executor, client.service_is_ready)
    futures = [client.call_async(Trigger.Request()) for _ in range(50)]
    spin_until(executor, lambda: all(future.done() for future in futures))
    assert len(looks) < 10


def test_a_timer_may_destroy_another_and_a_fault_comes_out(executor):
    (node,) = executor.get_nodes()
    called: list[str] = []
    second = node.create_timer(0.01, lambda: called.append("second"))

    def first() -> None:
        called.append("first")
        node.destroy_timer(second)
        if len(called) > 5:
            raise ZeroDivisionError

    spin_until(executor, lambda: "second" in called)
    node.create_timer(0.01, first)
    with pytest.raises(ZeroDivisionError):
        spin_until(executor, lambda: False)


@pytest.mark.parametrize("latched", [True, False])
def test_topics_with_callbacks_arrive(executor, latched):
    (node,) = executor.get_nodes()
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    qos = QoSProfile(depth=10, durability=durability)
    heard: list[str] = []
    node.create_subscription(String, "words", lambda message: heard.append(message.data), qos)
    publisher = node.create_publisher(String, "words", qos)
    node.create_timer(0.01, lambda: publisher.publish(String(data="word")))
    spin_until(executor, lambda: len(heard) >= 5)
