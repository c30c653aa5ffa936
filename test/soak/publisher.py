"""Publishes joint states at an exact rate for a while; prints how many.

Usage: ``publisher.py RATE SECONDS NAMES.json``. Stamps lie exactly on the rate; what is due
is sent in bursts of a few milliseconds, as a driver with a busy core does. Prints ``matched``
when a subscriber is there and ``published N`` at the end, then waits until its input closes.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from robot_energy.wire.layout import Encoder, stamp_columns

SECOND_NS = 1_000_000_000
MATCHING = 2.0  # s from match to first message
BURST = 0.002  # s


def main() -> None:
    """Wait for a subscriber, publish, report."""
    rate, seconds = int(sys.argv[1]), float(sys.argv[2])
    names = tuple(json.loads(Path(sys.argv[3]).read_text()))
    rclpy.init()
    node = rclpy.create_node("soak_driver")
    publisher = node.create_publisher(
        JointState, "joint_states", QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": names},
        {"position": len(names), "velocity": len(names), "effort": 0},
    )
    phase = np.linspace(0.0, np.pi, len(names))
    while publisher.get_subscription_count() < 1:
        rclpy.spin_once(node, timeout_sec=0.05)
    print("matched", flush=True)
    matched = time.monotonic()
    while time.monotonic() < matched + MATCHING:
        rclpy.spin_once(node, timeout_sec=0.05)
    begin, begin_ns, sent = time.monotonic(), time.time_ns(), 0
    total = round(rate * seconds)
    while sent < total:
        due = min(int((time.monotonic() - begin) * rate), total)
        if due > sent:
            number = np.arange(sent, due)
            angle = (number / rate)[:, None] * 2.0 + phase
            rows = encoder.encode(
                {
                    **stamp_columns(begin_ns + number * (SECOND_NS // rate)),
                    "position": 0.3 * np.sin(angle),
                    "velocity": 0.6 * np.cos(angle),
                    "effort": np.zeros((len(number), 0)),
                },
                len(number),
            )
            for row in rows:
                publisher.publish(row.tobytes())
            sent = due
        rclpy.spin_once(node, timeout_sec=BURST)
    print(f"published {sent}", flush=True)
    sys.stdin.read()


main()
