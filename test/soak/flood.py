"""All monitors under messages of every input with random stamps: none ends, none has a fault."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from figure import Figure
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
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

from robot_energy.bag import BagReader
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.stamps import MAX_STAMP_NS
from ros2_energy_monitor.base.shared_memory import clear_ports

MINUTES = (11.0, 0.8)
SECONDS = (600, 20)  # of the flood, whole and quick
PATIENCE = 60.0  # s until all monitors report
RATE = 1000.0  # messages in a second
BAG = Path(__file__).resolve().parents[2] / "bags" / "kr16_cold"
MONITORS = ("torque_monitor", "friction_monitor", "power_monitor", "energy_monitor")
TYPES: dict[str, Any] = {
    "/joint_states": JointState,
    "/motor_temperatures": MotorTemperatures,
    "/power_meter": PowerReading,
    "/energy/joint_torque": JointTorque,
    "/energy/joint_friction": JointFriction,
    "/energy/payload": Payload,
}
ROWS = 500  # messages of each topic to choose from
LIMITS = [
    *(0, 1, -1, 2**31 - 1, -(2**31), 1000, 1001),
    *(MAX_STAMP_NS // 10**9, MAX_STAMP_NS // 10**9 + 1),
]


@dataclass
class Watch:
    """What the monitors say about themselves."""

    heard: set[str] = field(default_factory=set)  # nodes
    errors: dict[str, int] = field(default_factory=dict)
    refused: dict[str, int] = field(default_factory=dict)
    unbalanced: set[str] = field(default_factory=set)

    def take(self, message: DiagnosticArray) -> None:
        """Keep the counts of one report."""
        for status in message.status:
            self.heard.add(status.name.partition(":")[0])
            if "does not add up" in status.message:
                self.unbalanced.add(f"{status.name}: {status.message}")
            for pair in status.values:
                if pair.key == "internal_errors":
                    self.errors[status.name] = int(pair.value)
                elif pair.key.endswith("rejected.bad_stamp"):
                    self.refused[f"{status.name} {pair.key}"] = int(pair.value)


def run(folder: str, quick: bool) -> list[Figure]:
    """Flood the monitors, stop them, and start them once more on what they kept."""
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", str(1 + os.getpid() % 90)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_HOME": str(Path(folder) / "ros"),
    }
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    clear_ports()
    rows = _rows(Path(folder))
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(environment["ROS_DOMAIN_ID"]))
    node = rclpy.create_node("flood", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    watch, published, ends, codes = Watch(), 0, 0, list[int | None]()
    node.create_subscription(DiagnosticArray, "/diagnostics", watch.take, 100)
    try:
        for seconds in (SECONDS[quick], 5):  # the second time on the state that the first left
            processes = [_start(name, environment, folder) for name in MONITORS]
            watch.heard.clear()
            try:
                _await(executor, watch)
                published += _flood(node, executor, rows, seconds)
                ends += sum(process.poll() is not None for process in processes)
            finally:
                codes += [_stop(process) for process in processes]
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    errors, refused = sum(watch.errors.values()), sum(watch.refused.values())
    return [
        Figure("published", published, "> 0", published > 0),
        Figure("refused as bad_stamp", refused, "> 0", refused > 0),
        Figure("monitors that ended", ends, "0", ends == 0),
        Figure("exit codes", " ".join(map(str, codes)), "all 0", not any(codes)),
        Figure("monitors heard", len(watch.heard), "4", len(watch.heard) == len(MONITORS)),
        Figure("internal errors", errors, "0", errors == 0),
        Figure(
            "accounts",
            "; ".join(sorted(watch.unbalanced)) or "add up",
            "add up",
            not watch.unbalanced,
        ),
    ]


def _await(executor: SingleThreadedExecutor, watch: Watch) -> None:
    """Wait until every monitor has reported."""
    limit = time.monotonic() + PATIENCE
    while len(watch.heard) < len(MONITORS) and time.monotonic() < limit:
        executor.spin_once(timeout_sec=0.5)


def _start(name: str, environment: dict[str, str], folder: str) -> subprocess.Popen[bytes]:
    simulated = name in ("torque_monitor", "friction_monitor")
    options = ["-p", "model:=kr16", "-p", f"use_sim_time:={str(simulated).lower()}"]
    if name == "power_monitor":
        options += ["-p", f"state_folder:={folder}/power"]
    command = [sys.executable, "-m", "ros2_energy_monitor", name, "--ros-args", *options]
    log = (Path(folder) / f"{name}.log").open("ab")
    return subprocess.Popen([*command, "--log-level", "error"], env=environment, stderr=log)


def _stop(process: subprocess.Popen[bytes]) -> int | None:
    process.send_signal(signal.SIGINT)
    try:
        return process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        return None


def _rows(folder: Path) -> dict[str, list[bytes]]:
    """Messages of every input: those of a bundled bag, and what a replay makes of them."""
    replay(BAG, load("kr16"), ReplaySetup(out=folder / "replayed"))
    rows: dict[str, list[bytes]] = {topic: [] for topic in TYPES}
    for path in (BAG, folder / "replayed"):
        reader = BagReader(path)
        for part in reader.parts([topic for topic in TYPES if topic in reader.topics]):
            for topic, batch in part.items():
                left = max(0, ROWS - len(rows[topic]))
                rows[topic] += [batch.row(index) for index in range(min(left, len(batch)))]
    return {topic: found for topic, found in rows.items() if found}


def _stamp(chance: random.Random) -> tuple[int, int]:
    seconds = chance.choice(LIMITS) if chance.random() < 0.5 else chance.randrange(-(2**31), 2**31)
    nanoseconds = chance.choice([0, 1, 10**9 - 1, 10**9, 2**32 - 1, chance.randrange(2**32)])
    return seconds, nanoseconds


def _flood(
    node: Node, executor: SingleThreadedExecutor, rows: dict[str, list[bytes]], seconds: float
) -> int:
    """Publish until the time is over; return how many messages."""
    chance = random.Random(1)
    publishers = {topic: node.create_publisher(TYPES[topic], topic, 100) for topic in rows}
    clock = node.create_publisher(Clock, "/clock", 10)
    client = node.create_client(SetPayload, "energy_monitor/set_payload")
    begin, published = time.monotonic(), 0
    while (elapsed := time.monotonic() - begin) < seconds:
        if published >= elapsed * RATE:
            executor.spin_once(timeout_sec=0.005)
            continue
        published += 1
        topic = chance.choice(list(rows))
        row = chance.choice(rows[topic])
        at = _stamp(chance)
        if chance.random() < 0.8:
            head = at[0].to_bytes(4, "little", signed=True) + at[1].to_bytes(4, "little")
            row = row[:4] + head + row[12:]
        publishers[topic].publish(row)
        if published % 50 == 0:
            message = Clock()
            message.clock.sec, message.clock.nanosec = at
            clock.publish(message)
        if published % 500 == 0 and client.service_is_ready():
            request = SetPayload.Request()
            header, request.payload.inertia.m = request.payload.header, chance.random()
            header.frame_id, header.stamp.sec, header.stamp.nanosec = "link_6", *at
            client.call_async(request)
    node.destroy_client(client)
    for publisher in (*publishers.values(), clock):
        node.destroy_publisher(publisher)
    return published
