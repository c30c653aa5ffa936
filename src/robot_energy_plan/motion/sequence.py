"""Motions one after another, as a test bench runs them: measure, warm up, measure."""

from __future__ import annotations

from collections.abc import Sequence as Row

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.ptp import JointMotion, Trajectory

JOIN_TOLERANCE = 1e-6  # rad or m between the end of a part and the start of the next


class Sequence:
    """Parts that follow one another, each from its own start; the last one goes on.

    Args:
        parts: Motion and how long it is played, > 0. [s]

    Attributes:
        begin: When each part begins, shape (K,). [s]
        duration: When the last part ends. [s]
    """

    def __init__(self, parts: Row[tuple[JointMotion, float]]) -> None:
        if not parts:
            raise MotionError("a sequence has no part", "at least one motion")
        times = np.array([time for _, time in parts], dtype=np.float64)
        if not ((times > 0) & np.isfinite(times)).all():
            raise MotionError(f"the parts last {times.tolist()} s", "finite times > 0 s")
        self._motions: list[JointMotion] = [motion for motion, _ in parts]
        self.begin: Float = np.concatenate([[0.0], np.cumsum(times)[:-1]])
        self.duration = float(times.sum())
        self.n_joints = self._motions[0].n_joints
        for index in range(1, len(parts)):
            here = self._motions[index - 1].sample(times[index - 1 : index])
            there = self._motions[index].sample(np.zeros(1))
            apart = np.abs(there.joint_position - here.joint_position).max()
            speed = max(np.abs(here.joint_velocity).max(), np.abs(there.joint_velocity).max())
            if apart > JOIN_TOLERANCE or speed > JOIN_TOLERANCE:
                raise MotionError(
                    f"part {index + 1} begins {apart:.3g} rad from the end of part {index}, at "
                    f"{speed:.3g} rad/s",
                    "parts that end at rest where the next one begins",
                )

    def sample(self, time: Float) -> Trajectory:
        """Return the motion, joint side.

        Args:
            time: Since the start of the first part, shape (N,). [s]
        """
        time = np.atleast_1d(np.asarray(time, dtype=np.float64))
        part = np.maximum(np.searchsorted(self.begin, time, side="right") - 1, 0)
        found = np.empty((3, len(time), self.n_joints))
        for index, motion in enumerate(self._motions):
            rows = part == index
            if rows.any():
                path = motion.sample(time[rows] - self.begin[index])
                found[:, rows] = path.joint_position, path.joint_velocity, path.joint_acceleration
        return Trajectory(*found)
