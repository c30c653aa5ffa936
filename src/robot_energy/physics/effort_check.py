"""Does the effort fit its meaning? Measured against predicted torque, in sentences.

The torque that moves the bodies is known from the URDF alone. An effort that is taken for
something else than it is differs from it by a large factor: a current by the torque constant,
a joint torque by the gear ratio. Nothing is corrected; the sentence says what to set.
"""

from __future__ import annotations

import math

import numpy as np

from robot_energy.blocks import EffortMeaning, Float
from robot_energy.model.schema import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort

MIN_SAMPLES = 100  # with an effort, before anything is said
MAX_FACTOR = 3.0  # either way; friction, payload and a wrong torque constant stay below it
MIN_CORRELATION = 0.6  # of effort and body torque, below which a factor means nothing
MIN_LOAD = 1.0  # RMS of the body torque, in Coulomb torques, below which friction decides


class EffortCheck:
    """Compares the effort, read with each meaning, with the torque of the bodies.

    With the motor torque ``m`` of one meaning and the rigid-body motor torque ``r``, all
    joints together: ``factor = sum(m r) / sum(r r)``. The right meaning has a factor near 1.

    Args:
        meaning: The configured meaning.
        model: The robot's model.
        drivetrain: Motor side <-> joint side.
    """

    def __init__(self, meaning: EffortMeaning, model: RobotModel, drivetrain: Drivetrain) -> None:
        self._meaning = meaning
        has_constants = all(joint.torque_constant is not None for joint in model.joints)
        self._readings = [
            Effort.from_model(model, each, drivetrain)
            for each in EffortMeaning
            if each is not EffortMeaning.NONE
            and (each is not EffortMeaning.MOTOR_CURRENT or has_constants)
        ]
        coulomb = [joint.friction.coulomb.value for joint in model.joints]
        self._coulomb = float(np.square(np.asarray(coulomb)).sum())
        self._samples = 0
        self._rigid = 0.0  # sum of r r
        self._products = np.zeros((len(self._readings), 2))  # sums of m r and m m

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are left out
    def step(self, joint_effort: Float, motor_torque_rigid: Float) -> None:
        """Take samples.

        Args:
            joint_effort: As the driver sent it, shape (N, n). [A], [N m] or [N]
            motor_torque_rigid: Of the same samples, shape (N, n). [N m]
        """
        if self._meaning is EffortMeaning.NONE:
            return
        good = np.isfinite(joint_effort).all(axis=1) & np.isfinite(motor_torque_rigid).all(axis=1)
        rigid = motor_torque_rigid[good]
        self._samples += len(rigid)
        self._rigid += float(np.square(rigid).sum())
        for row, reading in zip(self._products, self._readings, strict=True):
            measured = reading.motor_torque(joint_effort[good])
            row += (float((measured * rigid).sum()), float(np.square(measured).sum()))

    def doubts(self) -> list[str]:
        """Return what contradicts the configured meaning; one sentence, or none."""
        if self._samples < MIN_SAMPLES or not self._products[:, 1].all():
            return []
        if self._rigid / self._samples <= MIN_LOAD**2 * self._coulomb:
            return []
        factors: dict[EffortMeaning, float] = {}
        correlation = 0.0
        for reading, (product, square) in zip(self._readings, self._products, strict=True):
            factors[reading.meaning] = float(product) / self._rigid
            if reading.meaning is self._meaning:
                correlation = float(product) / math.sqrt(float(square) * self._rigid)
        factor = factors[self._meaning]
        if correlation >= MIN_CORRELATION:
            return [] if _near(factor) else [self._scale(factor, factors)]
        if correlation <= -MIN_CORRELATION:
            return [
                "the effort has the opposite sign of the torque that the bodies need (factor "
                f"{factor:.2g}): check the sign of the effort and the axes of the URDF"
            ]
        if abs(factor) < 1.0 / MAX_FACTOR:
            return [
                f"the effort holds {factor:.0%} of the torque that the bodies need: if the "
                "driver takes gravity out of it, set joint_states.effort_meaning to none"
            ]
        return []

    def _scale(self, factor: float, factors: dict[EffortMeaning, float]) -> str:
        said = f"taken for {self._meaning}, the effort is {factor:.2g} times the torque that "
        fitting = [each for each, other in factors.items() if _near(other)]
        if fitting:
            best = min(fitting, key=lambda each: abs(math.log(factors[each])))
            return (
                f"{said}the bodies need, taken for {best} {factors[best]:.2g} times: "
                f"joint_states.effort_meaning is probably {best}"
            )
        return (
            f"{said}the bodies need: check joint_states.effort_meaning, the torque constants and "
            "gear ratios of the model file, and the masses of the URDF"
        )


def _near(factor: float) -> bool:
    return 1.0 / MAX_FACTOR <= factor <= MAX_FACTOR
