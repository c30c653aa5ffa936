# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""A bag of all topics: the virtual robot and the energy monitor, recorded live for a while.

It is made to open layouts of viewers on. Everything in it is simulated:
``python ros2_energy_monitor/test/all_topics.py --out bags/kr16_all_topics --overwrite``.
"""

from __future__ import annotations

import argparse
from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import InertiaStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from ros2_energy_msgs.srv import SetPayload

from robot_energy.bag import BagWriter
from robot_energy.foundation.errors import BagError
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.messages.fields import JOINT_STATES_TOPIC
from robot_energy_report.layouts import DIAGNOSTICS, TOPICS
from robot_energy_rig.record import ORIGIN
from ros2_energy_monitor.base.message_classes import message_class
from ros2_energy_monitor.base.publishers import best_effort
from ros2_energy_monitor.base.run_node import ros
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.virtual_robot import VirtualRobot

TYPES = {
    JOINT_STATES_TOPIC: JOINT_STATE,
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    **{topic: f"ros2_energy_msgs/msg/{kind}" for topic, kind, _, _ in TOPICS},
}
RATE, POWER_RATE = 50.0, 12.5  # of joint states and of energy/power [1/s]
LINK, MASS = "flange", 5.0  # of the payload that is set [kg]
PATIENCE = 60.0  # for the first message of every topic [s]


class TopicRecorder(Node):
    """Keeps every message of `TYPES` as bytes, with its time of receipt.

    Attributes:
        taken: Topic, time of receipt [ns] and content of every message, in order.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("topic_recorder", **options)
        self.taken: list[tuple[str, int, bytes]] = []
        self.counts: Counter[str] = Counter()
        for topic, msgtype in TYPES.items():
            self.create_subscription(
                message_class(msgtype),
                topic,
                partial(self._take, topic),
                best_effort(2000),
                raw=True,
            )

    def _take(self, topic: str, message: bytes) -> None:
        self.taken.append((topic, self.get_clock().now().nanoseconds, bytes(message)))
        self.counts[topic] += 1


def record(context: Context, seconds: float) -> TopicRecorder:
    """Return the recorder, destroyed, after running robot, monitor and recorder in one executor.

    Args:
        seconds: Time that is recorded, once every topic has come. [s]
    """

    def given(**values: Any) -> list[Parameter]:
        return [Parameter(name, value=value) for name, value in values.items()]

    recorder = TopicRecorder(context=context)
    robot = VirtualRobot(
        context=context, parameter_overrides=given(rate=RATE, thermal_speedup=100.0)
    )
    monitor = EnergyMonitor(
        context=context,
        parameter_overrides=given(
            model="kr16", state_folder="", publish_torque=True, power_rate=POWER_RATE
        ),
    )
    nodes = (recorder, robot, monitor)
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    payload = InertiaStamped()
    payload.header.frame_id, payload.inertia.m = LINK, MASS
    client = recorder.create_client(SetPayload, f"/{monitor.get_name()}/set_payload")
    clock, begin, complete, asked = recorder.get_clock(), None, None, False
    try:
        while complete is None or (clock.now() - complete).nanoseconds < seconds * 1e9:
            executor.spin_once(timeout_sec=0.1)
            begin = begin or clock.now()
            lacking = [topic for topic in TYPES if not recorder.counts[topic]]
            if complete is None and not lacking:
                complete = clock.now()
            if lacking and (clock.now() - begin).nanoseconds > PATIENCE * 1e9:
                raise BagError(f"nothing came on {', '.join(lacking)}", "messages of all topics")
            if not asked and recorder.counts[JOINT_STATES_TOPIC] and client.service_is_ready():
                asked = True
                client.call_async(SetPayload.Request(payload=payload))
    finally:
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
    return recorder


def write(recorder: TopicRecorder, path: str, overwrite: bool) -> None:
    """Write what was recorded; a bag that is there is replaced if asked for."""
    with BagWriter(path, overwrite=overwrite, origin=ORIGIN) as bag:
        for topic, msgtype in TYPES.items():
            bag.add_topic(topic, msgtype)
        for topic, time_ns, content in recorder.taken:
            bag.write(topic, np.array([time_ns]), [content])


def main() -> None:
    """Record a bag."""
    parser = argparse.ArgumentParser(
        description="Record the virtual robot and the energy monitor to a bag."
    )
    parser.add_argument("--out", required=True, metavar="BAG", help="folder of the new bag")
    parser.add_argument("--seconds", type=float, default=8.0, help="time to record (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace the bag of --out")
    options = parser.parse_args()
    with ros([]) as context:
        recorder = record(context, options.seconds)
    write(recorder, options.out, options.overwrite)
    for topic in TYPES:
        print(f"{recorder.counts[topic]:8d} {topic}")


if __name__ == "__main__":
    main()
