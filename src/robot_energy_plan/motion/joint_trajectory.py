"""A JointTrajectory: points in time, the motion between them, and both as files.

Between two points the position is a polynomial that meets what the points give: of the fifth
degree with velocities and accelerations, of the third with velocities alone. Points with
positions only are joined by a spline of the third degree that rests at both ends; controllers
differ there, so it is noted.

A CSV table has the columns ``time`` and, for every joint J, ``position_J``, ``velocity_J`` and
``acceleration_J``; velocities and accelerations may be missing for all joints.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MissingTopicError, MotionError
from robot_energy.foundation.files.output_files import FileKind, write_file
from robot_energy.foundation.files.regular_file import read_regular_text, why_unreadable
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.fourier import FourierMotion
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp import Trajectory

KINDS = ("positions", "velocities", "accelerations")
Rows = tuple[Int, Float]
MAX_POINTS = 1_000_000
MAX_VALUE = 1e6  # of any number
SAME_TIME, SAME_PLACE = 1e-6, 1e-5  # s, rad or m: a robot is in one place within a microsecond


class PointColumns(Described):
    """Points of a ``trajectory_msgs/msg/JointTrajectory``, not checked yet.

    Each column is the lengths of its rows, shape (K,), and their figures one after the other.
    """

    joint_names: tuple[str, ...]
    time: Annotated[Float, "Of the points, shape (K,). [s]"]
    positions: Annotated[Rows, "[rad] or [m]"]
    velocities: Annotated[Rows, "[rad/s] or [m/s]"]
    accelerations: Annotated[Rows, "[rad/s^2] or [m/s^2]"]

    @classmethod
    def of(cls, message: Any) -> PointColumns:
        """Return the points of a decoded message."""
        time = [p.time_from_start.sec + p.time_from_start.nanosec / SECOND_NS
                for p in message.points]  # fmt: skip
        columns: list[Rows] = []
        for kind in KINDS:
            rows = [getattr(point, kind) for point in message.points]
            flat = np.concatenate([np.empty(0), *rows])
            columns.append((np.array(list(map(len, rows)), dtype=np.int64), flat))
        names = tuple(str(joint) for joint in message.joint_names)
        return cls(names, np.array(time, dtype=np.float64), *columns)

    def column(self, kind: str, name: str) -> Float | None:
        """Return one kind of figure of all points, shape (K, n); None where not all have it."""
        lengths, values = getattr(self, kind)
        width = len(self.joint_names)
        if not np.isin(lengths, (0, width)).all():
            raise MotionError(f"{name} has {kind} of another length", f"{width}, or none")
        return values.reshape(-1, width) if width and (lengths == width).all() else None


class JointTrajectory:
    """Motion through given points.

    Args:
        time: Times of the points since the start, rising, shape (K,), K >= 2. A point that
            repeats the one before within a microsecond is left out. [s]
        joint_position: Positions of the points, shape (K, n). [rad] or [m]
        joint_velocity: Same shape, or None. [rad/s] or [m/s]
        joint_acceleration: Same shape, or None. [rad/s^2] or [m/s^2]
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        time: Float,
        joint_position: Float,
        joint_velocity: Float | None = None,
        joint_acceleration: Float | None = None,
        name: str = "the trajectory",
    ) -> None:
        self.joint_names = tuple(joint_names)
        if len(set(self.joint_names)) != len(self.joint_names) or not self.joint_names:
            raise MotionError(f"{name} names the joints {list(joint_names)}", "each joint once")
        if not 2 <= len(time) <= MAX_POINTS:
            raise MotionError(f"{name} has {len(time)} points", f"2 to {MAX_POINTS}")
        for what, values in (
            ("time", time),
            ("position", joint_position),
            ("velocity", joint_velocity),
            ("acceleration", joint_acceleration),
        ):
            if values is not None and not (np.abs(values) <= MAX_VALUE).all():  # NaN is not, either
                raise MotionError(
                    f"{name}: a {what} is not finite or beyond {MAX_VALUE:g}", "finite figures"
                )
        from scipy.interpolate import BPoly, CubicHermiteSpline, CubicSpline

        self.notes: tuple[str, ...] = ()
        kept = _different_points(time, joint_position)
        if not kept.all():
            time, joint_position = time[kept], joint_position[kept]
            joint_velocity = None if joint_velocity is None else joint_velocity[kept]
            joint_acceleration = None if joint_acceleration is None else joint_acceleration[kept]
            self.notes += (
                f"{int((~kept).sum())} points of {name} repeat the one before, within "
                f"{SAME_TIME:g} s, and are left out",
            )
        if len(time) < 2:
            raise MotionError(f"all points of {name} are the same", "2 different ones")
        if not (np.diff(time) > 0).all():
            row = int(np.argmin(np.diff(time) > 0))
            raise MotionError(
                f"{name}: point {int(np.flatnonzero(kept)[row + 1]) + 1} comes at "
                f"{time[row + 1]:.9g} s, after one at {time[row]:.9g} s",
                "times that rise from point to point",
            )
        self.instants: Float = time - time[0]  # times of the points since the first, shape (K,) [s]
        self.duration = float(self.instants[-1])  # time from the first to the last point [s]
        if joint_velocity is None:
            self._motion = CubicSpline(self.instants, joint_position, bc_type="clamped")
            self.notes += (
                f"{name} gives positions only: a smooth motion from rest to rest through its "
                "points is assumed",
            )
        elif joint_acceleration is None:
            self._motion = CubicHermiteSpline(self.instants, joint_position, joint_velocity)
        else:
            derivatives = np.stack([joint_position, joint_velocity, joint_acceleration], axis=1)
            self._motion = BPoly.from_derivatives(self.instants, derivatives)

    def planned(self) -> SampledMotion:
        """Return the motion for a prediction, sampled at equal steps and at every point."""
        return SampledMotion(self, self.joint_names, self.duration, instants=self.instants.tolist())

    def sample(self, time: Float) -> Trajectory:
        """Return the motion, joint side; it stays at its ends outside.

        Args:
            time: Since the first point, shape (N,). [s]
        """
        inside = np.clip(time, 0.0, self.duration)
        return Trajectory(*(np.asarray(self._motion(inside, order)) for order in range(3)))


def read_points(message: Any, name: str) -> JointTrajectory:
    """Return the motion through the points of a decoded ``trajectory_msgs/msg/JointTrajectory``."""
    return through_points(PointColumns.of(message), name)


def through_points(points: PointColumns, name: str) -> JointTrajectory:
    """Return the motion through points."""
    if not 2 <= len(points.time) <= MAX_POINTS:
        raise MotionError(f"{name} has {len(points.time)} points", f"2 to {MAX_POINTS}")
    position, velocity, acceleration = (points.column(kind, name) for kind in KINDS)
    if position is None:
        raise MotionError(f"{name} has points without positions", "a position of every joint")
    return JointTrajectory(points.joint_names, points.time, position, velocity, acceleration, name)


def _different_points(time: Float, joint_position: Float) -> NDArray[np.bool_]:
    """Which points are not the one before once more, shape (K,).

    Between two points that the same instant was written for, rounding alone would decide on the
    acceleration.
    """
    kept = np.ones(len(time), dtype=np.bool_)
    last = 0
    for row in range(1, len(time)) if (np.diff(time) < SAME_TIME).any() else ():
        near = 0 <= time[row] - time[last] < SAME_TIME
        apart = joint_position[row] - joint_position[last]
        if near and np.abs(apart).max() < SAME_PLACE:
            kept[row] = False
        else:
            last = row
    return kept


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


def holds_trajectory(path: Path, topic: str | None) -> bool:
    """Return whether a bag holds a JointTrajectory, else recorded motion."""
    topics = BagReader(path).topics
    named = topics if topic is None else {topic} & topics.keys()
    return any(topics[name].msgtype == MESSAGE for name in named)


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
