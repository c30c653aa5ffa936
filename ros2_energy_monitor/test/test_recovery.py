# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Whatever happened, two seconds after data return the monitor counts and says so.

The middleware takes a second or two until publisher and subscription know each other, three
where its first announcements are lost. That is printed apart; what is asserted counts from
the first message that arrives, in ticks of the monitor's executor: a machine that does much else
may hold up monitor and robot, and then nothing is there to recover from.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState

from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

NAME = "energy_monitor: joint states"
LIMIT = 2.0  # s, from the first message that arrives to counting and OK
TICK = 0.02  # s, of the clock that measures it
TIMEOUT = 0.3  # s, input_timeout
ROBOT = """
import math, time
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("robot")
publisher = node.create_publisher(JointState, "joint_states", qos_profile_sensor_data)
message = JointState(name=[f"joint_a{axis}" for axis in range(1, 7)])
first = time.monotonic()
print(first, time.time_ns(), flush=True)
for number in range(100_000):
    now = time.time_ns()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
    message.position = [0.1 * math.sin(now % 10**15 * 1e-9)] * 6
    message.velocity = [0.1 * math.cos(now % 10**15 * 1e-9)] * 6
    publisher.publish(message)
    time.sleep(max(0.0, first + number * 0.01 - time.monotonic()))
"""


@pytest.fixture
def robot(child_environment) -> Iterator:
    """Starts the publisher; returns it, and its first message by steady clock and by stamp."""
    running: list[subprocess.Popen[str]] = []

    def start() -> tuple[subprocess.Popen[str], float, int]:
        process = subprocess.Popen(
            [sys.executable, "-c", ROBOT],
            env=child_environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        assert process.stdout is not None
        first, stamp_ns = process.stdout.readline().split()
        return process, float(first), int(stamp_ns)

    yield start
    for process in running:
        process.kill()
        process.communicate()


class Stopwatch:
    """Time since data return, counted from zero after each silence of the robot."""

    def __init__(self, bench, node) -> None:
        self.time, self._inbox = 0.0, node.joint_states
        bench.tester.create_timer(TICK, self._tick)

    def _tick(self) -> None:
        self.time = self.time + TICK if self._inbox.age < TIMEOUT else 0.0


def recovered(bench, node, diagnosed, watch: Stopwatch, since_ns: int) -> tuple[float, float]:
    """Wait for new messages, until they are counted and the node is well.

    Returns:
        When the first message arrived, and how long the rest took. [s]
    """
    received = node.joint_states.received
    bench.spin_until(lambda: node.joint_states.received > received, "a message")
    arrived, watch.time = time.monotonic(), 0.0
    account = node.account.registers.time
    bench.spin_until(lambda: (account.end_ns or 0) > since_ns + 50_000_000, "counting")
    diagnosed.wait(NAME, "all is well")
    return arrived, watch.time


def test_a_monitor_recovers_within_two_seconds(loopback_bench, robot):
    bench = loopback_bench
    node = bench.add(EnergyMonitor, model="kr16", input_timeout=TIMEOUT)
    diagnosed, watch = bench.diagnosed(), Stopwatch(bench, node)
    diagnosed.wait(NAME, "no joint state has arrived")
    times, discoveries = [], []
    for number in range(4):
        process, first, stamp_ns = robot()
        arrived, took = recovered(bench, node, diagnosed, watch, stamp_ns)
        discoveries.append(arrived - first)
        times.append(took)
        if number == 1:  # stands still, and goes on
            process.send_signal(signal.SIGSTOP)
            assert diagnosed.wait(NAME, "no joint state for").level == DiagnosticStatus.STALE
            process.send_signal(signal.SIGCONT)
            times.append(recovered(bench, node, diagnosed, watch, time.time_ns())[1])
        process.kill()
        process.wait()
        assert diagnosed.wait(NAME, "no joint state for").level == DiagnosticStatus.STALE
    for what, values in (("recovered", times), ("first message arrived", discoveries)):
        print(what, "after", ", ".join(f"{one:.2f} s" for one in values))
    assert max(times) < LIMIT
    assert node.ingest.rejections.balanced
    account = node.account.registers.time
    assert account.gap_count >= 4  # more where this machine stalls
    assert account.end_ns - account.start_ns == account.observed_ns + account.gap_ns


def test_a_subscription_that_lost_its_publisher_is_made_again(bench):
    """What a failure of the middleware looks like: a publisher is there, and nothing arrives."""
    node = bench.add(EnergyMonitor, model="kr16", resubscribe_after=0.5)
    diagnosed = bench.diagnosed()
    inbox = node.joint_states
    publisher = bench.publisher(JointState, "joint_states")
    bench.spin_until(lambda: inbox.renewals, "a new subscription")
    bench.spin_until(lambda: inbox.publishers, "the publisher")
    # Once more if the subscription is made again just then.
    bench.spin_until(lambda: publisher.publish(JointState()) or inbox.received, "a message")
    values = diagnosed.values(diagnosed.wait(NAME, "no joint state for"))
    assert values["subscription_renewals"] >= 1
