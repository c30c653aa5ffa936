"""First stage: joint states -> rigid-body torque."""

from __future__ import annotations

from robot_energy.blocks import JointBlock, TorqueBlock
from robot_energy.derivative import Derivative
from robot_energy.drivetrain import Drivetrain
from robot_energy.model_file import RobotModel
from robot_energy.pipeline.settings import Settings
from robot_energy.robot import Robot
from robot_energy.torque import rigid_torque


class TorqueStage:
    """Differentiates joint states and computes the torque that moves the bodies.

    Args:
        model: The robot's model.
        settings: Window and lag of the derivative.

    Raises:
        RobotDescriptionError: If the URDF cannot be used.
        UnknownJointError: If the URDF lacks a joint of the model.
    """

    def __init__(self, model: RobotModel, settings: Settings | None = None) -> None:
        settings = settings or Settings()
        self.robot = Robot.from_model(model)
        self._drivetrain = Drivetrain.from_model(model)
        self._derivative = Derivative(
            settings.derivative_window, settings.derivative_lag, settings.derivative_neighbours
        )

    def step(self, block: JointBlock) -> TorqueBlock | None:
        """Take joint states and return the torques whose window is complete.

        Args:
            block: Joint states in time order.

        Returns:
            Torques, or None while every sample still waits.
        """
        return self._torque(self._derivative.step(block))

    def flush(self) -> TorqueBlock | None:
        """Return what still waits, as at the end of a bag."""
        return self._torque(self._derivative.flush())

    def _torque(self, parts: list[JointBlock]) -> TorqueBlock | None:
        if not parts:
            return None
        return rigid_torque(JointBlock.concatenate(parts), self.robot, self._drivetrain)
