"""Joint torque of one robot as a sum of parameters: ten of each link, then those of columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_energy.blocks import Float
from robot_energy.identify.dynamics.base_parameters import BaseParameters, base_parameters
from robot_energy.identify.dynamics.columns import ParameterColumn
from robot_energy.model import RobotModel
from robot_energy.motion import Trajectory
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot

LINK_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
SAMPLES = 200  # random motions that show the structure of the robot


@dataclass(frozen=True)
class TorqueModel:
    """``joint_torque = regressor(motion) . parameters`` (paper B, eq. 18).

    Attributes:
        robot: Rigid bodies with their payload.
        transmission: Motor turns per joint turn, shape (n, n). [-]
        columns: What is fitted beside the links.
    """

    robot: Robot
    transmission: Float
    columns: tuple[ParameterColumn, ...]

    @classmethod
    def from_model(cls, model: RobotModel, columns: Sequence[ParameterColumn]) -> TorqueModel:
        """Return the torque model of a robot.

        Args:
            model: The robot.
            columns: What is fitted beside the links.
        """
        transmission = Drivetrain.from_model(model).transmission
        return cls(Robot.from_model(model), transmission, tuple(columns))

    @property
    def n_links(self) -> int:
        """Number of the parameters of the links."""
        return 10 * self.robot.n_joints

    @cached_property
    def extra(self) -> list[tuple[ParameterColumn, int, str]]:
        """Column, motor or joint, and name of every parameter behind those of the links."""
        names = self.robot.joint_names
        return [
            (column, owner, name)
            for column in self.columns
            for owner, name in zip(
                column.joints(self.transmission),
                column.names(names, self.transmission),
                strict=True,
            )
        ]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        joints = self.robot.joint_names  # the links in the order of `Robot.link_parameters`
        links = [f"{parameter} {joint}" for joint in joints for parameter in LINK_PARAMETERS]
        return (*links, *(name for _, _, name in self.extra))

    def regressor(self, motion: Trajectory) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, P).

        Args:
            motion: N samples of it.
        """
        links = self.robot.torque_regressor(
            motion.joint_position, motion.joint_velocity, motion.joint_acceleration
        )
        columns = [column.torque(motion, self.transmission) for column in self.columns]
        return np.concatenate([links, *columns], axis=2)

    def payload_torque(self, motion: Trajectory, regressor: Float) -> Float:
        """Return the joint torque of the payload, which is known, shape (N, n). [N m] or [N]

        Args:
            motion: N samples of it.
            regressor: Of the same samples, shape (N, n, P): joint torque over each parameter.
                [N m] or [N], over the unit of the parameter
        """
        whole = self.robot.joint_torque(
            motion.joint_position, motion.joint_velocity, motion.joint_acceleration
        )
        return whole - regressor[:, :, : self.n_links] @ self.robot.link_parameters

    def structure(self) -> BaseParameters:
        """Return the groups of parameters that any motion can tell."""
        random = np.random.default_rng(0)
        lower = np.maximum(self.robot.limits.lower, -np.pi)
        upper = np.minimum(self.robot.limits.upper, np.pi)
        shape = (SAMPLES, self.robot.n_joints)
        motion = Trajectory(random.uniform(lower, upper, shape), *random.normal(size=(2, *shape)))
        return base_parameters(self.regressor(motion).reshape(-1, len(self.names)), self.names)

    def without_offsets(self, values: Float) -> Float:
        """Return parameters as a model file holds them: offsets of the sensors are 0.

        Args:
            values: Shape (P,), in the unit of each. [-]
        """
        offsets = [column.owner == "sensor" for column, _, _ in self.extra]
        return np.where([*[False] * self.n_links, *offsets], 0.0, values)
