"""Motor side <-> joint side: gear ratios, wrist coupling, rotor inertia.

``motor_velocity = C joint_velocity`` (paper A, eq. 4) with ``C`` the transmission
matrix: gear ratios on the diagonal, wrist coupling off it. Power is the same on both
sides, ``motor_torque . motor_velocity = joint_torque . joint_velocity``, so
``motor_torque = C^-T joint_torque``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robot_energy.foundation.errors import ModelFileError, ShapeError
from robot_energy.physics.equations import mapped
from robot_energy.timeline.blocks import Float

if TYPE_CHECKING:
    from robot_energy.model.schema import RobotModel

MAX_CONDITION = 1e9  # of a transmission matrix
ABOVE_STANDSTILL = 5.0  # slower motion than so many standstill velocities says little [-]


def motor_velocity(joint_velocity: ArrayLike, transmission: ArrayLike) -> Float:
    """Return motor velocities, ``motor_velocity = C joint_velocity`` (paper A, eq. 4).

    Args:
        joint_velocity: Shape (..., n). [rad/s] or [m/s]
        transmission: C, gear ratios on the diagonal, wrist coupling off it, shape (n, n).
            [motor turns per joint turn]

    Returns:
        Shape (..., n). [rad/s]

    Raises:
        ShapeError: If C is not a square matrix of as many joints.
    """
    return mapped(*_matching(transmission, joint_velocity))


def motor_torque(joint_torque: ArrayLike, transmission: ArrayLike) -> Float:
    """Return the motor torques that balance joint torques, ``C^-T joint_torque``.

    The power is the same on both sides. Rotor inertia is not in it: see `rotor_torque`.

    Args:
        joint_torque: Shape (..., n). [N m] or [N]
        transmission: C, shape (n, n). [motor turns per joint turn]

    Returns:
        Shape (..., n). [N m]

    Raises:
        ShapeError: If C is not a square matrix of as many joints, or cannot be inverted.
    """
    matrix, torque = _matching(transmission, joint_torque)
    return mapped(torque_map(matrix), torque)


def rotor_torque(
    joint_acceleration: ArrayLike, transmission: ArrayLike, rotor_inertia: ArrayLike
) -> Float:
    """Return the torque that accelerates the rotors, ``J (C joint_acceleration)``.

    Paper A has no such term.

    Args:
        joint_acceleration: Shape (..., n). [rad/s^2] or [m/s^2]
        transmission: C, shape (n, n). [motor turns per joint turn]
        rotor_inertia: J, motor side, shape (n,). [kg m^2]

    Returns:
        Motor side, shape (..., n). [N m]

    Raises:
        ShapeError: If C is not a square matrix of as many joints.
    """
    return motor_velocity(joint_acceleration, transmission) * np.asarray(rotor_inertia)


def torque_map(transmission: Float) -> Float:
    """Return ``C^-T``, which maps joint to motor torques, shape (n, n), in the inverse unit.

    Args:
        transmission: C, motor velocity per joint velocity, shape (n, n). [-], or [rad/m] where
            the joint is prismatic
    """
    if not np.linalg.cond(transmission) < MAX_CONDITION:
        raise ShapeError(
            "gear ratios and coupling make a matrix that cannot be inverted",
            "motors that move the joints independently",
            "check the coupling ratios",
        )
    return np.linalg.inv(transmission).T


def _matching(transmission: ArrayLike, values: ArrayLike) -> tuple[Float, Float]:
    """The transmission and the values as arrays of matching shapes."""
    matrix, array = np.asarray(transmission, np.float64), np.asarray(values, np.float64)
    if matrix.shape != 2 * array.shape[-1:]:
        raise ShapeError(
            f"the transmission has the shape {matrix.shape}, the values {array.shape}",
            "(n, n) and (..., n)",
        )
    return matrix, array


class Drivetrain:
    """Maps between joints and motors of one robot.

    Args:
        transmission: C, shape (n, n). [motor turns per joint turn]
        rotor_inertia: Motor side, shape (n,). [kg m^2]

    Attributes:
        torque_map: C^-T, shape (n, n). [joint turns per motor turn]
    """

    def __init__(self, transmission: Float, rotor_inertia: Float) -> None:
        self.transmission = transmission
        self.rotor_inertia = rotor_inertia
        try:
            self.torque_map = torque_map(transmission)
        except ShapeError as error:
            raise ModelFileError(error.found, error.expected, error.remedy) from error

    @classmethod
    def from_model(cls, model: RobotModel) -> Drivetrain:
        """Return transmission and rotor inertias of a model file, joints in model order."""
        names = model.joint_names
        transmission = np.diag([joint.gear_ratio.value for joint in model.joints])
        for entry in model.coupling:
            transmission[names.index(entry.motor), names.index(entry.joint)] += entry.ratio.value
        inertia = np.asarray([joint.rotor_inertia.value for joint in model.joints])
        return cls(transmission, inertia)

    def motor_velocity_from_joint(self, joint_velocity: Float) -> Float:
        """Return motor velocities, or accelerations likewise, shape (N, n). [rad/s]

        Args:
            joint_velocity: Shape (N, n). [rad/s] or [m/s]
        """
        return mapped(self.transmission, joint_velocity)

    def joint_velocity_from_motor(self, motor_velocity: Float) -> Float:
        """Return joint velocities, shape (N, n). [rad/s] or [m/s]

        Args:
            motor_velocity: Shape (N, n). [rad/s]
        """
        return mapped(self.torque_map.T, motor_velocity)

    def motor_torque_from_joint(self, joint_torque: Float) -> Float:
        """Return motor torque that balances a joint torque, rotors apart, shape (N, n). [N m]

        Args:
            joint_torque: Shape (N, n). [N m] or [N]
        """
        return mapped(self.torque_map, joint_torque)

    def joint_torque_from_motor(self, motor_torque: Float) -> Float:
        """Return joint torque that balances a motor torque, rotors apart, (N, n). [N m] or [N]

        Args:
            motor_torque: Shape (N, n). [N m]
        """
        return mapped(self.transmission.T, motor_torque)

    def rotor_torque(self, joint_acceleration: Float) -> Float:
        """Return what accelerates the rotors, motor side (ours, not paper A's), shape (N, n). [N m]

        Args:
            joint_acceleration: Shape (N, n). [rad/s^2] or [m/s^2]
        """
        return mapped(self.transmission, joint_acceleration) * self.rotor_inertia


def motor_rest(model: RobotModel) -> Float:
    """Return the speeds below which motion says nothing of friction, shape (n,). [rad/s]

    Noise of a reported velocity stays below.
    """
    return ABOVE_STANDSTILL * motor_standstill(model)


def motor_standstill(model: RobotModel) -> Float:
    """Return the speeds below which motors stand, shape (n,). [rad/s]"""
    still = np.asarray([joint.standstill_velocity for joint in model.joints])
    return np.abs(Drivetrain.from_model(model).transmission) @ still
