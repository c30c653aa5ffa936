"""Motion of a tool -> motion of the joints.

The joint positions come from the inverse kinematics at equal steps of time; a spline of the
fifth degree goes through them, and its derivatives are the joint velocities and accelerations.
So all three belong to one motion whatever the robot, redundant ones included, and no kinematics
but the inverse is needed.

The spline is made in blocks that overlap by `MARGIN` knots, within which the influence of its
ends has died away (a factor of 0.43 per knot), so memory does not grow with the length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.inverse_kinematics import InverseKinematics
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.motion.tool_timing import TimedPath

DEGREE = 5
STEP = 0.01  # s; see decision 0038 for what a shorter one changes
MARGIN = 40  # knots: 0.43^40 = 2e-15
BLOCK = 4096  # knots
MAX_KNOTS = 20_000_000
MAX_OFFSET = 1000.0  # m, of the base from the origin of the program
MAX_JUMP = 0.5  # rad or m between two knots


class ToolPlacement(Described):
    """Where the robot's base stands in the frame of the program."""

    x: Annotated[float, "[m]"] = 0.0
    y: Annotated[float, "[m]"] = 0.0
    z: Annotated[float, "[m]"] = 0.0
    yaw: Annotated[float, "Turn of the base about the vertical axis, anticlockwise. [rad]"] = 0.0

    def __post_init__(self) -> None:
        if not all(abs(value) <= MAX_OFFSET for value in (self.x, self.y, self.z, self.yaw)):
            raise MotionError(
                f"the base stands at {self}", f"finite numbers within {MAX_OFFSET:g} m and rad"
            )

    def in_base(self, position: Float) -> Float:
        """Return positions of the program's frame in the base frame.

        Args:
            position: Shape (N, 3). [m]
        """
        moved = position - np.array([self.x, self.y, self.z])
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return moved @ turn.T


class ToolMotion:
    """Motion of the joints that moves a tool along a timed path.

    Args:
        start: Joint positions near the first one; decides which solution is taken,
            shape (n,). [rad] or [m]
        placement: Place of the robot's base in the frame of the program.
        step: Time between knots, > 0. [s]
        anchored: Whether every solution depends on ``start``, as where a redundant arm stays
            as near to it as it can; otherwise each is solved from the one before.

    Attributes:
        duration: [s]
    """

    def __init__(
        self,
        path: TimedPath,
        kinematics: InverseKinematics,
        start: Float,
        limits: JointLimits,
        placement: ToolPlacement | None = None,
        step: float = STEP,
        anchored: bool = False,
    ) -> None:
        if not 0 < step < math.inf:
            raise MotionError(f"the step is {step} s", "a time > 0 s")
        if not path.duration / step <= MAX_KNOTS:
            raise MotionError(
                f"{path.path.name} lasts {path.duration:.4g} s, which makes more than "
                f"{MAX_KNOTS} steps of {step:g} s",
                "fewer",
                "check the feeds, or take longer steps",
            )
        self._path = path
        self._kinematics = kinematics
        self._start = np.asarray(start, dtype=np.float64)
        self._anchored = anchored
        self._limits = limits
        self._placement = placement or ToolPlacement()
        self._count = max(2 * DEGREE, math.ceil(path.duration / step - 1e-9)) + 1
        self._step = path.duration / (self._count - 1)
        self.duration, self.joint_names = path.duration, limits.joint_names
        self.sample_count = self._count

    def blocks(self) -> Iterator[tuple[Float, Trajectory]]:
        """Yield times since the start, shape (N,) [s], and the motion at them, joint side."""
        joints = np.empty((0, len(self._start)))
        first, solved, last = 0, 0, self._start  # first: index of the first row of joints
        done = 0
        while done < self._count:
            until = min(done + BLOCK, self._count)
            need = min(until + MARGIN, self._count)
            if need > solved:
                fresh = self._solve(solved, need, last)
                joints = np.concatenate([joints, fresh])
                solved, last = need, joints[-1]
            yield self._derive(joints, first, done, until)
            keep = max(until - MARGIN, 0)
            joints, first, done = joints[keep - first :], keep, until

    def _solve(self, begin: int, end: int, start: Float) -> Float:
        time = np.arange(begin, end) * self._step
        tool = self._placement.in_base(self._path.sample(time).position)
        begin_from = self._start if self._anchored else start
        try:
            joints = self._kinematics.solve(tool, begin_from)
        except MotionError as error:
            row, first = self._first_refused(tool, begin_from, error)
            line = int(self._path.source_line(time[row : row + 1])[0])
            raise MotionError(
                f"{self._path.path.name}, line {line}, at {time[row]:.3f} s: {first.found}",
                first.expected,
                first.remedy,
            ) from error
        jump = np.diff(joints, axis=0, prepend=start[None, :] if begin else joints[:1])
        self._refuse_more(
            np.abs(jump), np.full(len(self._start), MAX_JUMP), time, "jumps by", "",
            "the path passes a singular configuration; move the base or start elsewhere",
        )  # fmt: skip
        return joints

    def _derive(self, joints: Float, first: int, begin: int, end: int) -> tuple[Float, Trajectory]:
        """Derivatives of the spline through all knots at hand."""
        from scipy.interpolate import make_interp_spline

        before = MARGIN if first == 0 else 0  # the robot rests before the start
        after = MARGIN if first + len(joints) == self._count else 0  # and after the end
        known = np.concatenate(
            [np.repeat(joints[:1], before, axis=0), joints, np.repeat(joints[-1:], after, axis=0)]
        )
        knots = np.arange(first - before, first + len(joints) + after) * self._step
        spline = make_interp_spline(knots, known, k=DEGREE)
        rows = slice(begin - first, end - first)
        time = np.arange(begin, end) * self._step
        velocity = np.asarray(spline.derivative(1)(time))
        self._refuse_more(
            velocity, self._limits.velocity, time, "moves at", "/s",
            "reduce the feed, move the base or start elsewhere",
        )  # fmt: skip
        acceleration = np.asarray(spline.derivative(2)(time))
        return time, Trajectory(joints[rows], velocity, acceleration)

    def _refuse_more(
        self, values: Float, most: Float, time: Float, verb: str, per: str, remedy: str
    ) -> None:
        bad = np.abs(values) > most * (1 + 1e-9)
        if not bad.any():
            return
        row = int(np.argmax(bad.any(axis=1)))
        joint = int(np.argmax(bad[row]))
        unit = self._limits.unit(joint) + per
        line = int(self._path.source_line(time[row : row + 1])[0])
        raise MotionError(
            f"{self._path.path.name}, line {line}: joint '{self._limits.joint_names[joint]}' "
            f"{verb} {values[row, joint]:.4g} {unit} at {time[row]:.3f} s",
            f"at most {most[joint]:.4g} {unit}",
            remedy,
        )

    def _first_refused(
        self, tool: Float, start: Float, error: MotionError
    ) -> tuple[int, MotionError]:
        """Find the first place that cannot be solved, and why: ever shorter beginnings."""
        good, bad = 0, len(tool)  # the first `good` places can, the first `bad` cannot
        while bad - good > 1:
            middle = (good + bad) // 2
            try:
                self._kinematics.solve(tool[:middle], start)
                good = middle
            except MotionError as sooner:
                bad, error = middle, sooner
        return bad - 1, error
