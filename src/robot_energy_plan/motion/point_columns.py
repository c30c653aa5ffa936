"""Points of a trajectory message as columns, however they were decoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float, Int

KINDS = ("positions", "velocities", "accelerations")
Rows = tuple[Int, Float]


@dataclass(frozen=True)
class PointColumns:
    """Points of a ``trajectory_msgs/msg/JointTrajectory``, not checked yet.

    Each column is the lengths of its rows, shape (K,), and their figures one after the other.

    Attributes:
        time: Of the points, shape (K,). [s]
        positions: [rad] or [m]
        velocities: [rad/s] or [m/s]
        accelerations: [rad/s^2] or [m/s^2]
    """

    joint_names: tuple[str, ...]
    time: Float
    positions: Rows
    velocities: Rows
    accelerations: Rows

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
