"""Read a JointTrajectory from a bag, or from a CSV file of `identify excitation`."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from robot_energy.bag import BagReader
from robot_energy.blocks import Float
from robot_energy.errors import MissingTopicError, MotionError
from robot_energy.files.regular_file import read_regular_text, why_unreadable
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
    name = f"{path}, {topic}"
    return read_points(decode_trajectory(bag.typestore, messages[0], name), name)


def decode_trajectory(store: Typestore, data: bytes, name: str) -> Any:
    """Decode a serialized ``trajectory_msgs/msg/JointTrajectory``.

    Args:
        store: Message definitions.
        data: The message.
        name: Where it comes from, for messages.

    Returns:
        The message, for `read_points`.

    Raises:
        MotionError: If it is too long or no such message.
    """
    if len(data) > MAX_BYTES:
        raise MotionError(f"{name} has over {MAX_BYTES} bytes", "a shorter motion")
    try:
        return store.deserialize_cdr(data, MESSAGE)
    except (SerdeError, ValueError, LookupError, AssertionError, struct.error) as error:
        raise MotionError(f"{name} cannot be decoded", f"a {MESSAGE}") from error


def read_csv_trajectory(path: str | Path) -> JointTrajectory:
    """Read a CSV file with the columns time, position_J, velocity_J, acceleration_J.

    Args:
        path: The file; velocities and accelerations may be missing for all joints.

    Returns:
        The motion.

    Raises:
        MotionError: If it cannot be read or columns are missing.
    """
    try:
        lines = read_regular_text(path, MAX_BYTES).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionError(
            f"{path} cannot be read ({why_unreadable(error)})", "a CSV file"
        ) from error
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    joints = [name.removeprefix("position_") for name in header if name.startswith("position_")]
    expected = {"time", *(f"{kind}_{joint}" for kind in KINDS for joint in joints)}
    known = set(header) <= expected and len(set(header)) == len(header)
    if not joints or "time" not in header or not known:
        raise MotionError(
            f"{path} has the columns {', '.join(header)[:200]}",
            "time and, for every joint J, position_J; velocity_J and acceleration_J if known",
        )
    if len(lines) > MOST_POINTS + 1:
        raise MotionError(f"{path} has {len(lines) - 1} points", f"at most {MOST_POINTS}")
    table = np.array(
        [_numbers(line, len(header), f"{path}, line {row}") for row, line in enumerate(lines, 1)
         if row > 1 and line.strip()]
    ).reshape(-1, len(header))  # fmt: skip
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


def _numbers(line: str, count: int, where: str) -> list[float]:
    """Numbers of one row."""
    try:
        values = [float(cell) for cell in line.split(",")]
    except ValueError as error:
        raise MotionError(f"{where} holds what is no number", f"{count} numbers") from error
    if len(values) != count:
        raise MotionError(f"{where} has {len(values)} values", f"{count}")
    return values


def _stacked(columns: Sequence[Float | None]) -> Float | None:
    """Columns of all joints; None where one is missing."""
    known = [values for values in columns if values is not None]
    return np.column_stack(known) if len(known) == len(columns) else None
