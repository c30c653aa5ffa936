"""Read a JointTrajectory from a bag, or from a CSV file of `identify excitation`."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rosbags.serde import SerdeError

from robot_energy.bag import BagReader
from robot_energy.blocks import Float
from robot_energy.errors import MissingTopicError, MotionError
from robot_energy.motion.joint_trajectory import MOST_POINTS, JointTrajectory, read_points

MESSAGE = "trajectory_msgs/msg/JointTrajectory"
MAX_BYTES = 256 * 1024 * 1024
KINDS = ("position", "velocity", "acceleration")


def read_bag_trajectory(path: str | Path, topic: str | None = None) -> JointTrajectory:
    """Read the JointTrajectory of a bag.

    Args:
        path: MCAP file or rosbag2 folder.
        topic: Its topic; None where there is one only.

    Returns:
        The motion.

    Raises:
        BagError: If the bag cannot be read.
        MissingTopicError: If there is no such topic, or several.
        MotionError: If it does not hold one message, or that cannot be used.
    """
    bag = BagReader(path)
    if topic is None:
        found = sorted(name for name, info in bag.topics.items() if info.msgtype == MESSAGE)
        if len(found) != 1:
            raise MissingTopicError(
                f"{path} has {len(found)} topics of type {MESSAGE}",
                "one",
                f"name it with --topic: {', '.join(found)}" if found else "",
            )
        topic = found[0]
    bag.require(topic, MESSAGE)
    messages: list[bytes] = []
    for part in bag.parts([topic]):
        for index in range(len(part[topic])):
            messages.append(part[topic].row(index))
            if len(messages) > 1:
                raise MotionError(
                    f"{path} has several messages on {topic}",
                    "one trajectory",
                    "cut the bag so that one is left",
                )
    if not messages:
        raise MotionError(f"{path} has no message on {topic}", "one trajectory")
    if len(messages[0]) > MAX_BYTES:
        raise MotionError(f"the message on {topic} has over {MAX_BYTES} bytes", "a shorter motion")
    try:
        message = bag.typestore.deserialize_cdr(messages[0], MESSAGE)
    except (SerdeError, ValueError, IndexError, AssertionError, struct.error) as error:
        raise MotionError(
            f"the message on {topic} of {path} cannot be decoded", f"a {MESSAGE}"
        ) from error
    return read_points(message, f"{path}, {topic}")


def read_csv_trajectory(path: str | Path) -> JointTrajectory:
    """Read a CSV file with the columns time, position_J, velocity_J, acceleration_J.

    Args:
        path: The file; velocities and accelerations may be missing for all joints.

    Returns:
        The motion.

    Raises:
        MotionError: If it cannot be read or columns are missing.
    """
    file = Path(path)
    try:
        if file.stat().st_size > MAX_BYTES:
            raise MotionError(f"{path} has over {MAX_BYTES} bytes", "a shorter motion")
        with file.open(encoding="utf-8") as text:
            header = [name.strip() for name in text.readline(100_000).split(",")]
            table = np.loadtxt(text, delimiter=",", ndmin=2, max_rows=MOST_POINTS + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise MotionError(f"{path} cannot be read", "a CSV file") from error
    except ValueError as error:
        raise MotionError(f"{path} holds what is no number: {error}", "numbers") from error
    joints = [name.removeprefix("position_") for name in header if name.startswith("position_")]
    expected = {"time", *(f"{kind}_{joint}" for kind in KINDS for joint in joints)}
    if not joints or "time" not in header or not set(header) <= expected:
        raise MotionError(
            f"{path} has the columns {', '.join(header)[:200]}",
            "time and, for every joint J, position_J; velocity_J and acceleration_J if known",
        )
    if table.shape[1] != len(header):
        raise MotionError(f"{path} has rows of {table.shape[1]} values", f"{len(header)}")
    column = {name: table[:, index] for index, name in enumerate(header)}
    position, velocity, acceleration = (
        [column.get(f"{kind}_{joint}") for joint in joints] for kind in KINDS
    )
    return JointTrajectory(
        joints,
        column["time"],
        np.column_stack([values for values in position if values is not None]),
        _stacked(velocity),
        _stacked(acceleration),
        str(path),
    )


def _stacked(columns: Sequence[Float | None]) -> Float | None:
    """Columns of all joints; None where one is missing."""
    known = [values for values in columns if values is not None]
    return np.column_stack(known) if len(known) == len(columns) else None
