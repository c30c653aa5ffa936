"""Rigid-body torque at joints and motors from joint motion (paper A, eq. 2)."""

from __future__ import annotations

import numpy as np

from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import JointBlock, TorqueBlock


@np.errstate(invalid="ignore", over="ignore")  # bad samples become NaN, nothing else
def rigid_torque(
    block: JointBlock, robot: Robot, drivetrain: Drivetrain, effort: Effort
) -> TorqueBlock:
    """Return the torque that moves the bodies and rotors, and the measured one; NaN of NaN.

    ``motor_torque_rigid = C^-T (M qdd + c + g) + rotor_inertia * motor_acceleration``.
    """
    joint_torque = robot.joint_torque(
        block.joint_position, block.joint_velocity, block.joint_acceleration
    )
    return TorqueBlock(
        stamp_ns=block.stamp_ns,
        segment=block.segment,
        quality=block.quality,
        joint_position=block.joint_position,
        joint_velocity=block.joint_velocity,
        joint_acceleration=block.joint_acceleration,
        joint_torque_rigid=joint_torque,
        motor_velocity=drivetrain.motor_velocity_from_joint(block.joint_velocity),
        motor_torque_rigid=drivetrain.motor_torque_from_joint(joint_torque)
        + drivetrain.rotor_torque(block.joint_acceleration),
        motor_torque_measured=effort.motor_torque(block.joint_effort),
        payload_mass=np.full(len(block), robot.payload_mass),
    )
