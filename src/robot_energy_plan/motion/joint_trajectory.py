"""A JointTrajectory: points in time, and the motion between them as controllers make it.

Between two points the position is a polynomial that meets what the points give: of the fifth
degree with velocities and accelerations, of the third with velocities alone. Points with
positions only are joined by a spline of the third degree that rests at both ends; controllers
differ there, so it is noted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float, Int
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
