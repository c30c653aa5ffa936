"""A program that can be changed and written back in its own form: what every kind of it has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.motion.trajectory_io import write_csv, write_trajectory
from robot_energy_plan.optimization.candidates import Candidates
from robot_energy_plan.optimization.plan import CyclePlan
from robot_energy_plan.optimization.task import ProgramMoves, Task


@dataclass(kw_only=True)
class ProgramForm(ProgramMoves, ABC):
    """A program of one robot.

    Attributes:
        acceleration: Limits of acceleration, shape (n,). [rad/s^2] or [m/s^2]
        jerk: Limits of jerk, shape (n,). [rad/s^3] or [m/s^3]
        recorded: Whether it is a recording of what the robot has done.
    """

    robot: Robot
    labels: tuple[str, ...]
    acceleration: Float
    jerk: Float
    notes: tuple[str, ...]
    recorded: bool = False

    def motion(self, task: Task, plan: CyclePlan) -> SampledMotion:
        """Return a plan as a motion for a prediction."""
        return self._motion(task.table.candidates[plan.row], plan.rest)

    def write(self, path: Path, task: Task, plan: CyclePlan) -> None:
        """Write a plan as a program of the same kind.

        Args:
            path: The file; of a trajectory a name with .csv makes a table, any other a bag.
        """
        self._write(path, task.table.candidates[plan.row], plan.rest)

    @abstractmethod
    def _motion(self, chosen: Candidates, rest: Float) -> SampledMotion:
        """The motion with a candidate of each move, and a rest before it."""

    @abstractmethod
    def _write(self, path: Path, chosen: Candidates, rest: Float) -> None: ...


class WrittenTrajectory(ProgramForm):
    """A program whose changed form is points of a trajectory."""

    @abstractmethod
    def _points(self, chosen: Candidates, rest: Float) -> tuple[Float, Trajectory]:
        """Times from 0 on, shape (K,) [s], and the points."""

    def _motion(self, chosen: Candidates, rest: Float) -> SampledMotion:
        time, path = self._points(chosen, rest)
        return JointTrajectory(
            self.robot.joint_names, time, path.joint_position, path.joint_velocity,
            path.joint_acceleration,
        ).planned()  # fmt: skip

    def _write(self, path: Path, chosen: Candidates, rest: Float) -> None:
        time, motion = self._points(chosen, rest)
        if path.suffix.lower() == ".csv":
            write_csv(path, self.robot.joint_names, time, motion)
        else:
            write_trajectory(path, self.robot.joint_names, time, motion, overwrite=True)
