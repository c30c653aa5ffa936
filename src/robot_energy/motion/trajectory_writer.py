"""A motion as files that a controller can play: CSV, and a JointTrajectory in a bag."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.bag import BagWriter
from robot_energy.blocks import Float
from robot_energy.errors import MotionError
from robot_energy.files.output_files import FileKind, write_file
from robot_energy.motion import FourierMotion, Trajectory

CHANNELS = ("position", "velocity", "acceleration")
TOPIC = "/joint_trajectory"
MESSAGE = "trajectory_msgs/msg/JointTrajectory"
ORIGIN = "computed motion; nothing in it was measured on a robot"
MOST_RATE = 10_000.0  # Hz
SECOND = 1_000_000_000  # ns
MOST_LOOPS = 100


def check_sampling(rate: float, loops: int) -> None:
    """Refuse a rate or a number of loops that makes no sense.

    Args:
        rate: Points per second. [Hz]
        loops: Periods one after the other.

    Raises:
        MotionError: If one does not.
    """
    if not 1.0 <= rate <= MOST_RATE:
        raise MotionError(f"the rate is {rate} Hz", f"1 to {MOST_RATE:g} Hz")
    if not 1 <= loops <= MOST_LOOPS:
        raise MotionError(f"{loops} loops were asked for", f"1 to {MOST_LOOPS}")


def points(motion: FourierMotion, rate: float, loops: int = 1) -> tuple[Float, Trajectory]:
    """Sample a motion from rest to rest, the end included.

    Args:
        motion: What to sample.
        rate: Points per second. [Hz]
        loops: Periods one after the other.

    Returns:
        Times from 0, shape (N,) [s], and the motion at them.

    Raises:
        MotionError: If rate or loops make no sense.
    """
    check_sampling(rate, loops)
    count = max(2, round(loops * motion.period * rate))
    time = np.linspace(0.0, loops * motion.period, count + 1)
    return time, motion.sample(time)


def csv_kind(joint_names: Sequence[str]) -> tuple[FileKind, ...]:
    """What a CSV file of these joints begins with: a table for controllers bears no mark."""
    return (FileKind("the trajectory of these joints", f"{_header(joint_names)}\n".encode(), b""),)


def _header(joint_names: Sequence[str]) -> str:
    return ",".join(["time", *(f"{kind}_{name}" for kind in CHANNELS for name in joint_names)])


def write_csv(path: Path, joint_names: Sequence[str], time: Float, path_points: Trajectory) -> None:
    """Write times, positions, velocities and accelerations, one row per point.

    Args:
        path: The file.
        joint_names: In the order of the arrays.
        time: Shape (N,). [s]
        path_points: The motion at these times, joint side.
    """
    channels = (
        path_points.joint_position,
        path_points.joint_velocity,
        path_points.joint_acceleration,
    )
    header = _header(joint_names)
    rows = np.column_stack([time, *channels])
    text = StringIO()
    np.savetxt(text, rows, fmt="%.9g", delimiter=",", header=header, comments="")
    write_file(path, text.getvalue().encode(), csv_kind(joint_names), "the trajectory")


def write_trajectory(
    path: Path,
    joint_names: Sequence[str],
    time: Float,
    path_points: Trajectory,
    overwrite: bool = False,
) -> None:
    """Write one JointTrajectory message into a new bag.

    Args:
        path: Folder of the bag.
        joint_names: In the order of the arrays.
        time: Since the start, shape (N,). [s]
        path_points: The motion at these times, joint side.
        overwrite: Replace a bag that is there.

    Raises:
        BagError: If the bag cannot be written.
    """
    from robot_energy.cdr.types import typestore

    store = typestore()
    kinds = store.types
    instant = kinds["builtin_interfaces/msg/Time"]
    wait = kinds["builtin_interfaces/msg/Duration"]
    header = kinds["std_msgs/msg/Header"](stamp=instant(sec=0, nanosec=0), frame_id="")
    nothing = np.empty(0)
    stamps: list[int] = np.rint(time * SECOND).astype(np.int64).tolist()
    rows: list[Any] = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=position,
            velocities=velocity,
            accelerations=acceleration,
            effort=nothing,
            time_from_start=wait(sec=stamp // SECOND, nanosec=stamp % SECOND),
        )
        for stamp, position, velocity, acceleration in zip(
            stamps,
            path_points.joint_position,
            path_points.joint_velocity,
            path_points.joint_acceleration,
            strict=True,
        )
    ]
    message = kinds[MESSAGE](header=header, joint_names=list(joint_names), points=rows)
    with BagWriter(path, overwrite=overwrite, origin=ORIGIN) as bag:
        bag.add_topic(TOPIC, MESSAGE)
        bag.write(TOPIC, [0], [bytes(store.serialize_cdr(message, MESSAGE))])
