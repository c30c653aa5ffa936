"""The way of a message through the all-in-one node, and what an import of an entry point loads.

Run it in the environment of the set-up: ``python .ci/ways.py``. A way is all that runs from a
message in the inbox to the published state: calls, functions and files of ours. Of joint states it
is the time in which a window of them becomes power, as the stages work on blocks.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"
ROOT = Path(__file__).resolve().parent.parent
OURS = (f"{ROOT}/src/", f"{ROOT}/build/", f"{ROOT}/ros2_energy_monitor/ros2_energy_monitor/")
TOPICS = {
    "joint state": "/joint_states",
    "temperature": "/motor_temperatures",
    "meter reading": "/power_meter",
}
# Messages until one has become power: torque waits for temperatures, and comes in blocks.
STEPS = {"joint state": 40, "temperature": 1, "meter reading": 1}
ENTRIES = ("robot_energy", "robot_energy.replay.api", "robot_energy.pipeline.online_monitor",
           "ros2_energy_monitor.nodes.energy_monitor")  # fmt: skip
LOADED = (
    "import sys, time; begin = time.process_time(); import {0};"
    "spent = time.process_time() - begin;"
    "ours = [name for name in sys.modules if name.startswith(('robot_energy', 'ros2_energy'))];"
    "print(len(ours), len(sys.modules), round(spent, 2))"
)


def main() -> None:
    """Print both tables."""
    row = "{:<42} {:>8} {:>10} {:>8}".format
    print(row("way to the published state", "calls", "functions", "files"))
    for name, counts in ways().items():
        print(row(name, *counts))
    print()
    print(row("import", "ours", "modules", "CPU [s]"))
    for entry in ENTRIES:
        command = [sys.executable, "-c", LOADED.format(entry)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        print(row(entry, *done.stdout.split()))


def ways() -> dict[str, tuple[int, int, int]]:
    """Return calls, functions and files by kind of message."""
    import rclpy  # noqa: TID251  the node is what is looked at
    from rclpy.executors import SingleThreadedExecutor  # noqa: TID251
    from rclpy.parameter import Parameter  # noqa: TID251

    from robot_energy.bag import BagReader
    from ros2_energy_monitor.base.message_classes import message_class  # noqa: TID251
    from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor  # noqa: TID251

    os.environ["ROS_HOME"] = tempfile.mkdtemp()
    bag = BagReader(ROOT / "bags/kr16_warm")
    recorded: dict[str, list[bytes]] = {topic: [] for topic in TOPICS.values()}
    for part in bag.parts(list(recorded)):
        for topic, batch in part.items():
            recorded[topic] += [bytes(batch.row(place)) for place in range(len(batch))]
    rclpy.init(args=[])
    node: Any = EnergyMonitor(parameter_overrides=[Parameter("model", value="kr16")])
    source = rclpy.create_node("recording")
    publishers = {
        topic: source.create_publisher(message_class(bag.topics[topic].msgtype), topic, 1000)
        for topic in recorded
    }
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        executor.spin_once(timeout_sec=0.1)
    executor.remove_node(node)

    def step(topic: str, count: int) -> None:
        for message in recorded[topic][:count]:
            publishers[topic].publish(message)
        del recorded[topic][:count]
        node.take()
        node.tick()

    step("/motor_temperatures", 1)
    step("/joint_states", 300)
    step("/power_meter", 5)
    found = {
        name: traced(lambda topic=topic, name=name: [step(topic, 1) for _ in range(STEPS[name])])
        for name, topic in TOPICS.items()
    }
    idle = traced(lambda: [node.take(), node.tick()])
    node.destroy_node()
    rclpy.try_shutdown()
    return {**found, "nothing (a tick without messages)": idle}


def traced(run: Callable[[], object]) -> tuple[int, int, int]:
    """Return how many calls of ours a run makes, of how many functions in how many files."""
    calls: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(OURS):
            calls.append((code.co_filename, code.co_qualname))

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return len(calls), len(set(calls)), len({path for path, _ in calls})


if __name__ == "__main__":
    main()
