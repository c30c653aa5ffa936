"""What programs share whose changed form is a trajectory: a prediction of it, and its file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

from robot_energy.blocks import Float
from robot_energy.motion.joint_trajectory import JointTrajectory
from robot_energy.motion.planned import SampledMotion
from robot_energy.motion.ptp import Trajectory
from robot_energy.motion.trajectory_io import write_csv, write_trajectory
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.task import Task
from robot_energy.physics.rigid_body import Robot


class WrittenTrajectory(ABC):
    """A program that is written as points of a trajectory.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self._names = robot.joint_names

    @abstractmethod
    def points(self, task: Task, plan: CyclePlan) -> tuple[Float, Trajectory]:
        """Return the points of a plan.

        Args:
            task: The task.
            plan: A plan of it.

        Returns:
            Times from 0 on, shape (K,) [s], and the points.
        """

    def motion(self, task: Task, plan: CyclePlan, robot: Robot) -> SampledMotion:
        """Return a plan as a motion for a prediction.

        Args:
            task: The task.
            plan: A plan of it.
            robot: The robot.

        Returns:
            The motion.
        """
        time, path = self.points(task, plan)
        return JointTrajectory(
            robot.joint_names, time, path.joint_position, path.joint_velocity,
            path.joint_acceleration,
        ).planned()  # fmt: skip

    def write(self, path: Path, task: Task, plan: CyclePlan) -> None:
        """Write a plan as a trajectory.

        Args:
            path: A name with .csv makes a table, any other a bag.
            task: The task.
            plan: A plan of it.

        Raises:
            RobotEnergyError: If it cannot be written.
        """
        time, motion = self.points(task, plan)
        if path.suffix.lower() == ".csv":
            write_csv(path, self._names, time, motion)
        else:
            write_trajectory(path, self._names, time, motion, overwrite=True)
