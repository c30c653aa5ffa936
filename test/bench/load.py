"""Publishes joint states at a rate and measures how late power states come back.

Prints ``running`` once a subscriber is there and warm, ``measured`` after the time asked
for, then the latencies as JSON. Usage: ``load.py RATE SECONDS yes|no|all``: whether to wait for
power; all adds effort, temperatures at 1 Hz, of one motor none, and a meter at 10 Hz.
"""

import contextlib
import json
import sys
import time

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from recording import JOINTS, motion
from ros2_energy_msgs.msg import MotorTemperatures, PowerReading, PowerState
from sensor_msgs.msg import JointState

from robot_energy.bag.cdr.decode import Encoder, stamp_columns

WARM_UP = 2.0  # s
PERIOD = 2 * np.pi / 0.7  # of `motion`: the positions go on where they begin again [s]


def main() -> None:
    rate, seconds, kind = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
    wants_power, sends_all = kind != "no", kind == "all"
    rclpy.init()
    node = rclpy.create_node("load")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    quality = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = node.create_publisher(JointState, "joint_states", quality)
    latencies: list[float] = []

    def on_power(message: PowerState) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        latencies.append((time.time() - stamp) * 1e3)

    if wants_power:
        node.create_subscription(PowerState, "energy/power", on_power, qos_profile_sensor_data)
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": JOINTS},
        {"position": 6, "velocity": 6, "effort": 6 * sends_all},
    )
    temperatures = Encoder(
        "ros2_energy_msgs/msg/MotorTemperatures", {"joint_names": JOINTS}, {"temperature_degc": 6}
    )
    reading = Encoder(
        "ros2_energy_msgs/msg/PowerReading",
        {"meaning": 1, "location": 1, "energy": np.nan, "interval": np.nan},
    )
    warm = node.create_publisher(MotorTemperatures, "motor_temperatures", 10)
    meter = node.create_publisher(PowerReading, "power_meter", 10)
    _, position, velocity = motion(round(rate * PERIOD), float(rate))
    deadline = time.monotonic() + 20
    while publisher.get_subscription_count() < 1:
        executor.spin_once(0.05)
        if time.monotonic() > deadline:
            print("nobody", flush=True)
            return
    begin = time.monotonic()
    phase, sent = "warm", 0
    while True:
        now = time.monotonic()
        if phase == "warm" and now - begin > WARM_UP and (latencies or not wants_power):
            print("running", flush=True)
            phase, measured_from = "measure", now
            latencies.clear()
        elif phase == "warm" and now - begin > 20:
            print("silent", flush=True)
            return
        elif phase == "measure" and now - measured_from > seconds:
            break
        due = begin + sent / rate
        if due > now:
            executor.spin_once(max(0.0, min(due - now - 2e-4, 1e-3)))
            while time.monotonic() < due:
                pass
        row = sent % len(position)
        stamp, speed = stamp_columns(np.array([time.time_ns()])), velocity[row : row + 1]
        columns = {
            **stamp,
            "position": position[row : row + 1],
            "velocity": speed,
            "effort": (speed + 0.5 * np.sign(speed)) if sends_all else np.zeros((1, 0)),
        }
        publisher.publish(encoder.encode(columns, 1)[0].tobytes())
        if sends_all and sent % rate == 0:
            degc = np.append(np.full(5, 20.0 + sent / rate * 0.01), np.nan)[None]
            rows = temperatures.encode({**stamp, "temperature_degc": degc}, 1)
            warm.publish(rows[0].tobytes())
        if sends_all and sent % (rate // 10) == 0:
            meter.publish(reading.encode({**stamp, "power": 900.0 + sent % 7}, 1)[0].tobytes())
        sent += 1
    print("measured", flush=True)
    figures = {}
    if latencies:
        figures = {
            "p50": float(np.percentile(latencies, 50)),
            "p99": float(np.percentile(latencies, 99)),
            "states": len(latencies),
        }
    print(json.dumps(figures), flush=True)


with contextlib.suppress(KeyboardInterrupt):
    main()
