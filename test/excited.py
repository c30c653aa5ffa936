"""Recordings of small robots in motion, with everything known, for tests of identification."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_identify.data.observations import Channels
from robot_energy_plan.motion import Trajectory


def fourier_motion(n_joints: int, time: Float, seed: int = 0) -> Trajectory:
    """A sum of harmonics of 0.1 Hz up to 0.8 Hz per joint, derivatives in closed form."""
    random = np.random.default_rng(seed)
    position = np.zeros((len(time), n_joints))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    for joint in range(n_joints):
        for harmonic in (1, 2, 3, 5, 8):
            omega = 2 * np.pi * 0.1 * harmonic
            phase = random.uniform(0, 2 * np.pi)
            size = random.uniform(0.5, 1.0) / harmonic**0.7
            position[:, joint] += size * np.sin(omega * time + phase)
            velocity[:, joint] += size * omega * np.cos(omega * time + phase)
            acceleration[:, joint] -= size * omega**2 * np.sin(omega * time + phase)
    return Trajectory(position, velocity, acceleration)


def monitor_torque(model: RobotModel, motion: Trajectory, temperature_degc: float = 25.0) -> Float:
    """Motor torque as the online stages of the monitor compute it, friction included."""
    robot, drivetrain = Robot.from_model(model), Drivetrain.from_model(model)
    friction = FrictionModel.from_model(model)
    rigid = drivetrain.motor_torque_from_joint(
        robot.joint_torque(motion.joint_position, motion.joint_velocity, motion.joint_acceleration)
    ) + drivetrain.rotor_torque(motion.joint_acceleration)
    speed = drivetrain.motor_velocity_from_joint(motion.joint_velocity)
    temperature = np.full_like(speed, temperature_degc)
    coulomb = np.broadcast_to(friction.coulomb, speed.shape)
    standing = np.zeros(speed.shape, dtype=np.bool_)
    return rigid + friction.torque(
        speed, coulomb, friction.viscous(temperature), motor_torque_rigid=rigid, standing=standing
    )


def recorded(
    model: RobotModel,
    duration: float = 20.0,
    rate: float = 500.0,
    noise: float = 0.0,
    memory: float = 0.0,
    seed: int = 0,
    delay: float = 0.0,
) -> Channels:
    """What a recorder would hold of a robot that is exactly its model.

    Args:
        model: The robot.
        duration: [s]
        rate: [Hz]
        noise: Of the torque, as a share of each motor's torque (standard deviation).
        memory: Of the noise from one sample to the next, 0 (white) to below 1.
        seed: Of the noise; the motion is always the same.
        delay: By which the torque channel lags. [s]
    """
    n_joints = len(model.joints)
    time = np.arange(round(duration * rate)) / rate
    motion = fourier_motion(n_joints, time)
    torque = monitor_torque(model, fourier_motion(n_joints, time - delay))
    random = np.random.default_rng(seed)
    white = random.normal(size=torque.shape) * np.sqrt(1.0 - memory**2)
    torque = torque + noise * torque.std(axis=0) * lfilter([1.0], [1.0, -memory], white, axis=0)
    return Channels(rate, motion.joint_position, torque)


def coming_to_rest(model: RobotModel, moving: float, resting: float, rate: float) -> Channels:
    """A robot that moves, slows down within a second and rests under its brakes' torque.

    At rest it keeps its weight and four fifths of its Coulomb friction, as one that stopped
    against gravity may.
    """
    time = np.arange(round((moving + resting) * rate)) / rate
    pace = np.clip(moving - time, 0.0, 1.0)
    phase = np.cumsum(pace) / rate
    path = fourier_motion(len(model.joints), phase)
    slowing = np.where((pace > 0.0) & (pace < 1.0), -1.0, 0.0)
    motion = Trajectory(
        path.joint_position,
        path.joint_velocity * pace[:, None],
        path.joint_acceleration * pace[:, None] ** 2 + path.joint_velocity * slowing[:, None],
    )
    held = 0.8 * FrictionModel.from_model(model).coulomb * (pace == 0.0)[:, None]
    return Channels(rate, motion.joint_position, monitor_torque(model, motion) + held)
