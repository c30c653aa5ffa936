# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Messages that no robot sends, live: refused and counted, and nothing of them is kept."""

from __future__ import annotations

import gc
from pathlib import Path

from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

JOINTS = 100_000
MESSAGES = 5
COUNT = 100  # clean messages
MAX_GROWTH = 64 * 2**20  # bytes; five messages of 4 MB kept in parts took some hundreds


def huge(number: int) -> bytes:
    """A joint state of 4 MB with names of its own."""
    message = JointState()
    message.header.stamp.sec = 1_700_000_000
    message.name = [f"j{number}_{index}" for index in range(JOINTS)]
    message.position = [0.0] * JOINTS
    message.velocity = [0.0] * JOINTS
    return serialize_message(message)


def resident() -> int:
    """Resident memory of this process. [bytes]"""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096


def test_joint_states_of_four_megabytes_leave_no_trace(bench, messages):
    rows = [huge(number) for number in range(MESSAGES)]
    clean = messages["/joint_states"][:COUNT]
    node = bench.add(EnergyMonitor, model="kr16", state_folder="")
    publisher = bench.publisher(JointState, "/joint_states")
    publisher.publish(rows[0])  # the middleware's own buffers grow once
    bench.spin_until(lambda: node.joint_states.received == 1, "the first")
    before = resident()
    for number, row in enumerate(rows[1:], start=2):
        publisher.publish(row)
        bench.spin_until(lambda n=number: node.joint_states.received == n, "a huge message")
    grown = resident() - before
    for row in clean:
        publisher.publish(row)
    wanted = MESSAGES + COUNT
    bench.spin_until(lambda: node.joint_states.received == wanted, "the clean messages")
    node.close()
    account = node.ingest.rejections
    assert account.rejected["malformed"] == MESSAGES
    assert account.accepted == COUNT
    assert account.balanced
    assert node.account.counts.samples == COUNT
    assert not node.ingest.ignored_joints
    assert grown < MAX_GROWTH
