"""Motor side <-> joint side: gear ratios, wrist coupling, rotor inertia.

``motor_velocity = C joint_velocity`` (paper A, eq. 4) with ``C`` the transmission
matrix: gear ratios on the diagonal, wrist coupling off it. Power is the same on both
sides, ``motor_torque . motor_velocity = joint_torque . joint_velocity``, so
``motor_torque = C^-T joint_torque``.
"""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.errors import ModelFileError, ShapeError
from robot_energy.model.schema import RobotModel
from robot_energy.physics.transmission import mapped, torque_map
from robot_energy.timeline.blocks import Float

ABOVE_STANDSTILL = 5.0  # slower motion than so many standstill velocities says little [-]


class Drivetrain:
    """Maps between joints and motors of one robot.

    Args:
        transmission: C, shape (n, n). [motor turns per joint turn]
        rotor_inertia: Motor side, shape (n,). [kg m^2]
    """

    def __init__(self, transmission: Float, rotor_inertia: Float) -> None:
        self.transmission = transmission
        self.rotor_inertia = rotor_inertia
        try:
            self._torque_map = torque_map(transmission)
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
        return mapped(self._torque_map.T, motor_velocity)

    def motor_torque_from_joint(self, joint_torque: Float) -> Float:
        """Return motor torque that balances a joint torque, rotors apart, shape (N, n). [N m]

        Args:
            joint_torque: Shape (N, n). [N m] or [N]
        """
        return mapped(self._torque_map, joint_torque)

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
