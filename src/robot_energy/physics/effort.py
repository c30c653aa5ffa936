"""What a driver calls effort -> measured motor torque, by a meaning that is always a setting.

``sensor_msgs/JointState.effort`` says neither side nor kind: some drivers send motor
current, some joint torque, some the torque they command. The meaning is therefore a
setting; nothing here looks at the numbers to guess it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

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


MIN_SAMPLES = 100  # with an effort, before anything is said
MAX_FACTOR = 3.0  # either way; friction, payload and a wrong torque constant stay below it
MIN_CORRELATION = 0.6  # of effort and body torque, below which a factor means nothing
MIN_LOAD = 1.0  # RMS of the body torque, in Coulomb torques, below which friction decides


class EffortCheck:
    """Compares the effort, read with each meaning, with the torque of the bodies.

    With the motor torque ``m`` of one meaning and the rigid-body motor torque ``r``, all
    joints together: ``factor = sum(m r) / sum(r r)``. The right meaning has a factor near 1.
    """

    def __init__(self, meaning: EffortMeaning, model: RobotModel, drivetrain: Drivetrain) -> None:
        self._meaning = meaning
        n_joints = len(model.joints)
        has_constants = all(joint.torque_constant is not None for joint in model.joints)
        self._maps = {  # motor torque of an effort of 1 at each joint, shape (n, n)
            each: Effort.from_model(model, each, drivetrain).motor_torque(np.eye(n_joints))
            for each in EffortMeaning
            if each is not EffortMeaning.NONE
            and (each is not EffortMeaning.MOTOR_CURRENT or has_constants)
        }
        coulomb = [joint.friction.coulomb.value for joint in model.joints]
        self._coulomb = float(np.square(np.asarray(coulomb)).sum())
        self._samples = 0
        self._rigid = 0.0  # sum of r r
        self._effort_rigid = np.zeros((n_joints, n_joints))  # sums of effort i times r j
        self._effort_effort = np.zeros((n_joints, n_joints))

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are left out
    def step(self, joint_effort: Float, motor_torque_rigid: Float) -> None:
        """Take samples.

        Args:
            joint_effort: As the driver sent it, shape (N, n). [A], [N m] or [N]
            motor_torque_rigid: Of the same samples, shape (N, n). [N m]
        """
        effort, rigid = joint_effort, motor_torque_rigid
        if not math.isfinite(float(effort.sum()) + float(rigid.sum())):
            good = np.isfinite(effort).all(axis=1) & np.isfinite(rigid).all(axis=1)
            effort, rigid = effort[good], rigid[good]
        self._samples += len(rigid)
        self._rigid += float(np.square(rigid).sum())
        self._effort_rigid += effort.T @ rigid
        self._effort_effort += effort.T @ effort

    def factors(self) -> dict[EffortMeaning, tuple[float, float]]:
        """Return the factor of each meaning, and the correlation of ``m`` and ``r``. [-]

        A model without torque constants has no factor as a current; NaN where nothing was
        sent.
        """
        found: dict[EffortMeaning, tuple[float, float]] = {}
        for meaning, torque in self._maps.items():
            product = float((torque * self._effort_rigid).sum())
            square = float((torque * (self._effort_effort @ torque)).sum())
            both = math.sqrt(max(square * self._rigid, 0.0))
            found[meaning] = (
                product / self._rigid if self._rigid else math.nan,
                product / both if both else math.nan,
            )
        return found

    def doubts(self) -> list[str]:
        """Return what contradicts the configured meaning; one sentence, or none."""
        if self._samples < MIN_SAMPLES:
            return []
        if self._rigid / self._samples <= MIN_LOAD**2 * self._coulomb:
            return []
        factors = self.factors()
        factor, correlation = factors[self._meaning]
        if math.isnan(correlation):
            return []
        if correlation >= MIN_CORRELATION:
            return [] if _near(factor) else [self._scale(factor, factors)]
        if correlation <= -MIN_CORRELATION:
            return [
                "the effort has the opposite sign of the torque that the bodies need (factor "
                f"{factor:.2g}): check the sign of the effort and the axes of the URDF"
            ]
        if abs(factor) < 1.0 / MAX_FACTOR:
            return [
                f"the effort holds {100 * factor:.0f} % of the torque that the bodies need: if the "
                "driver takes gravity out of it, set joint_states.effort_meaning to none"
            ]
        return []

    def _scale(self, factor: float, factors: Mapping[EffortMeaning, tuple[float, float]]) -> str:
        said = f"taken for {self._meaning}, the effort is {factor:.2g} times the torque that "
        fitting = {each: other for each, (other, _) in factors.items() if _near(other)}
        if fitting:
            best = min(fitting, key=lambda each: abs(math.log(fitting[each])))
            return (
                f"{said}the bodies need, taken for {best} {fitting[best]:.2g} times: "
                f"joint_states.effort_meaning is probably {best}"
            )
        return (
            f"{said}the bodies need: check joint_states.effort_meaning, the torque constants and "
            "gear ratios of the model file, and the masses of the URDF"
        )


def _near(factor: float) -> bool:
    return 1.0 / MAX_FACTOR <= factor <= MAX_FACTOR
