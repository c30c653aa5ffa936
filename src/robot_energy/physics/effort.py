"""What a driver calls effort -> measured motor torque, by a meaning that is always a setting.

``sensor_msgs/JointState.effort`` says neither side nor kind: some drivers send motor
current, some joint torque, some the torque they command. The meaning is therefore a
setting; nothing here looks at the numbers to guess it.
"""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.errors import ModelFileError
from robot_energy.model.schema import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.blocks import EffortMeaning, Float


class Effort:
    """Turns the effort of each joint into motor torque.

    - ``motor_current`` [A]: times ``torque_constant`` of the joint [N m/A], motor side.
    - ``motor_torque`` [N m]: as it is.
    - ``joint_torque`` [N m] or [N]: ``C^-T joint_torque`` (design: power is the same on
      both sides). A sensor behind the gear sees neither rotor inertia nor the friction
      before it, and neither does the result.

    Args:
        torque_constant: Shape (n,); needed for ``motor_current`` only. [N m/A]
    """

    def __init__(
        self, meaning: EffortMeaning, drivetrain: Drivetrain, torque_constant: Float | None = None
    ) -> None:
        self.meaning = meaning
        self._drivetrain = drivetrain
        self._torque_constant = torque_constant

    @classmethod
    def from_model(
        cls, model: RobotModel, meaning: EffortMeaning, drivetrain: Drivetrain
    ) -> Effort:
        """Return the conversion from effort to motor torque, with what it needs of a model file."""
        if meaning is not EffortMeaning.MOTOR_CURRENT:
            return cls(meaning, drivetrain)
        without = [joint.name for joint in model.joints if joint.torque_constant is None]
        if without:
            raise ModelFileError(
                f"the effort is a motor current but {model.source} has no torque_constant "
                f"for {', '.join(without)}",
                "torque_constant: {value: ..., tag: ...} [N m/A, motor side] in every joint",
                "add it to the model file, or set effort to none",
            )
        constants = [joint.torque_constant.value for joint in model.joints if joint.torque_constant]
        return cls(meaning, drivetrain, np.asarray(constants))

    def motor_torque(self, joint_effort: Float) -> Float:
        """Return the measured motor torque.

        Args:
            joint_effort: As the driver sent it, shape (N, n). [A], [N m] or [N]

        Returns:
            Motor side, shape (N, n); NaN where the effort is unknown, not finite or not
            used. A coupled motor needs the effort of every joint that loads it. [N m]
        """
        if self.meaning is EffortMeaning.NONE:
            return np.full_like(joint_effort, np.nan)
        known = joint_effort
        if not bool(np.isfinite(known.sum())):
            known = np.where(np.isfinite(known), known, np.nan)
        if self._torque_constant is not None:
            return known * self._torque_constant
        if self.meaning is EffortMeaning.JOINT_TORQUE:
            return self._drivetrain.motor_torque_from_joint(known)
        return known
