"""Torque and power along a given path as functions of the speed along it.

The path is a motion ``q(p)`` over its own time ``p``; run at ``y = dp/dt`` its joints have the
velocity ``q' y`` and the acceleration ``q'' y^2 + q' a`` with ``a = d(y^2)/dp / 2``. So the rigid
motor torque is linear in ``b = y^2`` and ``a``, and with friction ``fc sgn(w) + fv w`` the torque
is linear in ``b``, ``a`` and ``y``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.motion.ptp import Trajectory
from robot_energy.optimization.chain import PowerChain

PROBE = 1.0  # rad/s and N m at which the losses of drives are looked up


@dataclass(frozen=True)
class PathPower:
    """Figures of one path at N places, motor side where nothing else is said.

    Attributes:
        velocity: q', joint side, shape (N, n). [rad/s] or [m/s]
        acceleration: q'', joint side, shape (N, n). [rad/s^2] or [m/s^2]
        speed: Motor velocity at y = 1, shape (N, n). [rad/s]
        still: Torque that holds against gravity, and Coulomb friction, shape (N, n). [N m]
        squared: Torque per b, shape (N, n). [N m]
        rising: Torque per a, shape (N, n). [N m s^2]
        viscous: Torque per y, shape (N, n). [N m]
        gravity: Torque that holds against gravity, shape (N, n). [N m]
        friction: Energy per path time of Coulomb friction, and per y of viscous, shape (N,) each.
            [W]
        constant: Loss of all drives that flows all the time. [W]
        loss: Loss of drives per path time, and per y, shape (N,) each. [W]
        copper: Loss per squared torque, shape (n,). [W/(N m)^2]
    """

    velocity: Float
    acceleration: Float
    speed: Float
    still: Float
    squared: Float
    rising: Float
    viscous: Float
    gravity: Float
    friction: tuple[Float, Float]
    constant: float
    loss: tuple[Float, Float]
    copper: Float

    def __getitem__(self, rows: slice) -> PathPower:
        """Return some of the places."""
        return PathPower(
            self.velocity[rows], self.acceleration[rows], self.speed[rows], self.still[rows],
            self.squared[rows], self.rising[rows], self.viscous[rows], self.gravity[rows],
            (self.friction[0][rows], self.friction[1][rows]), self.constant,
            (self.loss[0][rows], self.loss[1][rows]), self.copper,
        )  # fmt: skip


def path_power(chain: PowerChain, path: Trajectory) -> PathPower:
    """Return the figures of a path; of drives without a loss model the losses are 0.

    Args:
        chain: The robot; its mean temperature counts.
        path: The motion over its own time, shape (N, n) each.
    """
    degc = chain.motor_temperature_degc.mean(axis=0)
    q, v, a = path.joint_position, path.joint_velocity, path.joint_acceleration
    none = np.zeros_like(q)
    gravity, whole, rising = (
        chain.drivetrain.motor_torque_from_joint(chain.robot.joint_torque(q, *motion))
        for motion in ((none, none), (v, a), (none, v))
    )
    speed = chain.drivetrain.motor_velocity_from_joint(v)
    coulomb, viscous = chain.friction.coulomb, chain.friction.viscous(degc)
    constant, linear, quadratic, copper = _losses(chain, degc)
    size = np.abs(speed)
    return PathPower(
        velocity=v,
        acceleration=a,
        speed=speed,
        still=gravity + coulomb * np.sign(speed),
        squared=whole - gravity + chain.drivetrain.rotor_torque(a),
        rising=rising - gravity + chain.drivetrain.rotor_torque(v),
        viscous=viscous * speed,
        gravity=gravity,
        friction=((coulomb * size).sum(axis=1), (viscous * size**2).sum(axis=1)),
        constant=float(constant.sum()),
        loss=((linear * size).sum(axis=1), (quadratic * size**2).sum(axis=1)),
        copper=copper,
    )


def _losses(chain: PowerChain, degc: Float) -> tuple[Float, Float, Float, Float]:
    """Constant, linear, quadratic and copper loss of each drive, from its own function."""

    def loss(speed: float, torque: float) -> Float:
        shape = (1, len(degc))
        shaft = np.full(shape, speed * torque)
        power, _ = chain.drive.input_power(
            shaft, np.full(shape, speed), np.full(shape, torque), degc[None].copy()
        )
        return np.asarray((power - shaft)[0])

    constant = loss(0.0, 0.0)
    copper = np.maximum((loss(0.0, PROBE) - constant) / PROBE**2, 0.0)
    once, twice = loss(PROBE, 0.0) - constant, loss(2 * PROBE, 0.0) - constant
    quadratic = np.maximum((twice - 2 * once) / (2 * PROBE**2), 0.0)
    linear = np.maximum(once / PROBE - quadratic * PROBE, 0.0)
    return constant, linear, quadratic, copper
