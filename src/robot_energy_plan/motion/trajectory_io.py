"""Trajectories as files: CSV tables, and bags with one JointTrajectory message.

A table has the columns ``time`` and, for every joint J, ``position_J``, ``velocity_J`` and
``acceleration_J``; velocities and accelerations may be missing for all joints.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy.foundation.errors import MissingTopicError, MotionError
from robot_energy.foundation.files.output_files import FileKind, write_file
from robot_energy.foundation.files.regular_file import read_regular_text, why_unreadable
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.fourier import FourierMotion
from robot_energy_plan.motion.joint_trajectory import MAX_POINTS, JointTrajectory, read_points
from robot_energy_plan.motion.ptp import Trajectory

MESSAGE = "trajectory_msgs/msg/JointTrajectory"
TOPIC = "/joint_trajectory"
ORIGIN = "computed motion; nothing in it was measured on a robot"
COLUMNS = ("position", "velocity", "acceleration")
MAX_BYTES = 256 * 1024 * 1024
MAX_RATE = 10_000.0  # Hz
MAX_LOOPS = 100
CDR = {b"\x00\x00", b"\x00\x01"}  # first bytes of a message: big and little endian


def check_sampling(rate: float, loops: int) -> None:
    """Refuse a rate or a number of loops that makes no sense.

    Args:
        rate: Points per second. [Hz]
    """
    if not 1.0 <= rate <= MAX_RATE:
        raise MotionError(f"the rate is {rate} Hz", f"1 to {MAX_RATE:g} Hz")
    if not 1 <= loops <= MAX_LOOPS:
        raise MotionError(f"{loops} loops were asked for", f"1 to {MAX_LOOPS}")


def points(motion: FourierMotion, rate: float, loops: int = 1) -> tuple[Float, Trajectory]:
    """Return times from 0, shape (N,) [s], and a motion at them, from rest to rest.

    Args:
        rate: Points per second. [Hz]
    """
    check_sampling(rate, loops)
    count = max(2, round(loops * motion.period * rate))
    time = np.linspace(0.0, loops * motion.period, count + 1)
    return time, motion.sample(time)


def _header(joint_names: Sequence[str]) -> str:
    return ",".join(["time", *(f"{kind}_{name}" for kind in COLUMNS for name in joint_names)])


def csv_kind(joint_names: Sequence[str]) -> tuple[FileKind, ...]:
    """Return the kind of file of a table: for controllers' sake it has no mark but its header."""
    header = f"{_header(joint_names)}\n".encode()
    return (FileKind("the trajectory of these joints", header, b""),)


def write_csv(path: Path, joint_names: Sequence[str], time: Float, motion: Trajectory) -> None:
    """Write a table with one row per point.

    Args:
        time: Shape (N,). [s]
    """
    rows = np.column_stack(
        [time, motion.joint_position, motion.joint_velocity, motion.joint_acceleration]
    )
    text, header = StringIO(), _header(joint_names)
    np.savetxt(text, rows, fmt="%.9g", delimiter=",", header=header, comments="")
    write_file(path, text.getvalue().encode(), csv_kind(joint_names), "the trajectory")


def read_csv_trajectory(path: str | Path) -> JointTrajectory:
    """Return the motion of a table."""
    try:
        lines = read_regular_text(path, MAX_BYTES).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionError(
            f"{path} cannot be read ({why_unreadable(error)})", "a CSV file"
        ) from error
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    joints = [name.removeprefix("position_") for name in names if name.startswith("position_")]
    known = set(names) <= set(_header(joints).split(",")) and len(set(names)) == len(names)
    if not joints or "time" not in names or not known:
        raise MotionError(
            f"{path} has the columns {', '.join(names)[:200]}",
            "time and, for every joint J, position_J; velocity_J and acceleration_J if known",
        )
    if len(lines) > MAX_POINTS + 1:
        raise MotionError(f"{path} has {len(lines) - 1} points", f"at most {MAX_POINTS}")
    rows = [
        _numbers(line, len(names), f"{path}, line {number}")
        for number, line in enumerate(lines[1:], 2)
        if line.strip()
    ]
    column = dict(zip(names, np.array(rows).reshape(-1, len(names)).T, strict=True))
    position, velocity, acceleration = (
        [column[name] for joint in joints if (name := f"{kind}_{joint}") in column]
        for kind in COLUMNS
    )
    return JointTrajectory(
        joints,
        column["time"],
        np.column_stack(position),
        np.column_stack(velocity) if len(velocity) == len(joints) else None,
        np.column_stack(acceleration) if len(acceleration) == len(joints) else None,
        str(path),
    )


def _numbers(line: str, count: int, where: str) -> list[float]:
    try:
        values = [float(cell) for cell in line.split(",")]
    except ValueError as error:
        raise MotionError(
            f"{where} holds a cell that is not a number", f"{count} numbers"
        ) from error
    if len(values) != count:
        raise MotionError(f"{where} has {len(values)} values", f"{count}")
    return values


def write_trajectory(
    path: Path,
    joint_names: Sequence[str],
    time: Float,
    motion: Trajectory,
    overwrite: bool = False,
) -> None:
    """Write one JointTrajectory message into a new bag.

    Args:
        time: Since the start, shape (N,). [s]
    """
    store = typestore()
    kinds = store.types
    instant = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    duration = kinds["builtin_interfaces/msg/Duration"]
    stamps: list[int] = np.rint(time * SECOND_NS).astype(np.int64).tolist()
    rows = zip(
        stamps, motion.joint_position, motion.joint_velocity, motion.joint_acceleration, strict=True
    )
    message = kinds[MESSAGE](
        header=kinds["std_msgs/msg/Header"](stamp=instant, frame_id=""),
        joint_names=list(joint_names),
        points=[
            kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
                positions=position,
                velocities=velocity,
                accelerations=acceleration,
                effort=np.empty(0),
                time_from_start=duration(sec=stamp // SECOND_NS, nanosec=stamp % SECOND_NS),
            )
            for stamp, position, velocity, acceleration in rows
        ],
    )
    with BagWriter(path, overwrite=overwrite, origin=ORIGIN) as bag:
        bag.add_topic(TOPIC, MESSAGE)
        bag.write(TOPIC, [0], [bytes(store.serialize_cdr(message, MESSAGE))])


def read_bag_trajectory(path: str | Path, topic: str | None = None) -> JointTrajectory:
    """Return the motion of the JointTrajectory of a bag."""
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
        messages += [part[topic].row(index) for index in range(min(len(part[topic]), 2))]
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
    """Return a serialized ``trajectory_msgs/msg/JointTrajectory``, for `read_points`.

    Bytes behind the message are ignored: `rclpy.serialization` returns whole buffers.
    """
    if len(data) > MAX_BYTES:
        raise MotionError(f"{name} has over {MAX_BYTES} bytes", "a shorter motion")
    try:
        if len(data) < 4 or data[:2] not in CDR:
            raise ValueError(data[:4])
        kind = store.get_msgdef(MESSAGE)
        decode = kind.deserialize_cdr_le if data[1] else kind.deserialize_cdr_be
        return decode(memoryview(data)[4:], 0, kind.cls, store)[0]
    except (SerdeError, ValueError, LookupError, AssertionError, struct.error) as error:
        raise MotionError(f"{name} cannot be decoded", f"a {MESSAGE}") from error
