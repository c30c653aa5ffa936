"""A synthetic recording: smooth motion of six joints, temperatures at 1 Hz, meter at 10 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.bag import BagWriter
from robot_energy.bag.cdr.decode import Encoder, stamp_columns
from robot_energy.timeline.blocks import Float, Int

JOINTS = tuple(f"joint_a{number}" for number in range(1, 7))
START_NS = 1_700_000_000_000_000_000


def motion(samples: int, rate: float, seed: int = 0) -> tuple[Int, Float, Float]:
    """Stamps with 10 % jitter, positions and velocities. [ns, rad, rad/s]"""
    rng = np.random.default_rng(seed)
    stamp = np.cumsum(rng.uniform(0.9, 1.1, samples) / rate)
    speed = np.arange(1, 7) * 0.7
    angle = stamp[:, None] * speed
    position = 0.5 * np.sin(angle) + rng.normal(size=(samples, 6)) * 1e-6
    velocity = 0.5 * speed * np.cos(angle) + rng.normal(size=(samples, 6)) * 1e-4
    return START_NS + np.rint(stamp * 1e9).astype(np.int64), position, velocity


def record(path: Path, seconds: float, compression: str, rate: float = 500.0) -> Path:
    """Write the recording once; later calls find it."""
    if (path / "metadata.yaml").exists():
        return path
    stamp, position, velocity = motion(int(seconds * rate), rate)
    lengths = {"position": 6, "velocity": 6, "effort": 6}
    joint_state = Encoder("sensor_msgs/msg/JointState", {"name": JOINTS}, lengths)
    temperature = Encoder(
        "ros2_energy_msgs/msg/MotorTemperatures", {"joint_names": JOINTS}, {"temperature_degc": 6}
    )
    reading = Encoder(
        "ros2_energy_msgs/msg/PowerReading",
        {"meaning": 1, "location": 1, "energy": np.nan, "interval": np.nan},
    )
    rng = np.random.default_rng(1)
    with BagWriter(path, compression=compression, overwrite=True) as bag:
        bag.add_topic("/joint_states", joint_state.msgtype)
        bag.add_topic("/motor_temperatures", temperature.msgtype)
        bag.add_topic("/power_meter", reading.msgtype)
        second = int(rate)
        for begin in range(0, len(stamp), second):
            rows = slice(begin, begin + second)
            at = stamp[rows]
            columns = {"position": position[rows], "velocity": velocity[rows], "effort": np.nan}
            bag.write(
                "/joint_states", at, joint_state.encode({**stamp_columns(at), **columns}, len(at))
            )
            warm = np.full((1, 6), 20 + 40 * begin / len(stamp))
            bag.write(
                "/motor_temperatures",
                at[:1],
                temperature.encode({**stamp_columns(at[:1]), "temperature_degc": warm}, 1),
            )
            at = at[:: second // 10]
            power = 1000 + rng.normal(size=len(at))
            bag.write(
                "/power_meter", at, reading.encode({**stamp_columns(at), "power": power}, len(at))
            )
    return path
