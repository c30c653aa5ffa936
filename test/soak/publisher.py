"""Publishes joint states at an exact rate for a while; prints how many.

Usage: ``publisher.py RATE SECONDS NAMES.json``. Stamps lie exactly on the rate; what is due
is sent in bursts of a few milliseconds, as a driver with a busy core does. Prints ``matched``
when a subscriber is there and ``published N`` at the end, then waits until its input closes.
"""

import contextlib
import json
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from robot_energy.bag.cdr.decode import Encoder, stamp_columns

SECOND_NS = 1_000_000_000
MATCHING = 2.0  # s from match to first message
BURST = 0.002  # s
SLOW, SLOW_PERIOD = 20, 0.05  # messages at both ends, s between them


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
    begin_ns, sent = time.time_ns(), 0

    def publish(first: int, until: int) -> int:
        number = np.arange(first, until)
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
        return until

    def publish_slowly(until: int) -> int:
        """The first and the last must arrive: what is lost shows between two that did."""
        for number in range(sent, until):
            rclpy.spin_once(node, timeout_sec=SLOW_PERIOD)
            publish(number, number + 1)
        return until

    total = SLOW + round(rate * seconds)
    sent = publish_slowly(SLOW)
    begin = time.monotonic()
    while sent < total:
        due = min(SLOW + int((time.monotonic() - begin) * rate), total)
        sent = publish(sent, due)
        rclpy.spin_once(node, timeout_sec=BURST)
    sent = publish_slowly(total + SLOW)
    print(f"published {sent}", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        sys.stdin.read()


main()
