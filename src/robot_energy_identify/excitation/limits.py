"""Limits of an excitation motion, and how much of them a motion uses.

A use of 1 is the limit minus its margin. The optimiser gets one smooth figure per joint and
kind, the logarithm of a sum of exponentials over all samples, which is never below the
largest use, so that it errs to the safe side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion import Trajectory

SHARPNESS = 100.0  # of the smooth maximum: above the true one by at most ln(2 N) / 100
HEIGHT_SCALE = 1.0  # m: a tool 1 cm too low counts as 1 % over
RAMP = 0.5  # s to full speed, where nothing is known of the acceleration
STEP = 1e-6  # of numerical derivatives, share of a limit


class Floor(Described):
    """A link that must stay above a height."""

    link: Annotated[str, "Of the URDF, such as the flange."]
    height: Annotated[float, "In the base frame. [m]"]


class ExcitationLimits:
    """Limits of one robot, joint side, shape (n,) each.

    Args:
        acceleration: Greatest, one or shape (n,); None: full speed in 0.5 s. [rad/s^2] or [m/s^2]
        margin: Share of every limit that may be used, in (0, 1]. [-]

    Attributes:
        middle: Of the position ranges; a joint without end stays within half a turn to
            each side. [rad] or [m]
        reach: Half the position ranges, less the margin. [rad] or [m]
        velocity: Less the margin. [rad/s] or [m/s]
        acceleration: Less the margin, shape (n,). [rad/s^2] or [m/s^2]
        torque: Less the margin, inf where the URDF gives none. [N m] or [N]
    """

    def __init__(
        self,
        model: RobotModel,
        acceleration: Float | float | None = None,
        margin: float = 0.9,
        floor: Floor | None = None,
    ) -> None:
        self.robot = Robot.from_model(model)
        self._drivetrain = Drivetrain.from_model(model)
        self._friction = FrictionModel.from_model(model)
        self._temperature = model.temperature.fallback_degc
        if not 0 < margin <= 1:
            raise MotionError(f"the share of the limits is {margin}", "a share in (0, 1]")
        limits = self.robot.limits
        lower = np.where(limits.wraps, np.maximum(limits.lower, -np.pi), limits.lower)
        upper = np.where(limits.wraps, np.minimum(limits.upper, np.pi), limits.upper)
        for name, known in (
            ("position", np.isfinite(lower) & np.isfinite(upper)),
            ("velocity", np.isfinite(limits.velocity)),
        ):
            if not known.all():
                joint = self.robot.joint_names[int(np.argmin(known))]
                raise MotionError(
                    f"joint '{joint}' has no {name} limit",
                    "finite limits on every joint",
                    "give one in the URDF before moving the robot by it",
                )
        self.margin = margin
        self.middle = 0.5 * (lower + upper)
        self.reach = 0.5 * margin * (upper - lower)
        self.velocity = margin * limits.velocity
        self.acceleration_assumed = acceleration is None
        given = limits.velocity / RAMP if acceleration is None else np.asarray(acceleration)
        if (
            given.shape not in ((), (1,), limits.velocity.shape)
            or not ((given > 0) & np.isfinite(given)).all()
        ):
            raise MotionError(
                f"the acceleration limits are {given.tolist()}",
                f"one value > 0, or one for each of {self.robot.n_joints} joints",
            )
        self.acceleration = margin * np.broadcast_to(given, limits.velocity.shape)
        self.torque = margin * limits.effort
        self.floor = floor
        if floor is not None:
            if not np.isfinite(floor.height):
                raise MotionError(f"the height is {floor.height} m", "a finite height")
            self.robot.link_position(self.middle, floor.link)  # refuses an unknown link

    def joint_torque(self, motion: Trajectory) -> Float:
        """Return torque of drives, friction at the fallback temperature, (N, n). [N m] or [N]"""
        chain, acceleration = self._drivetrain, motion.joint_acceleration
        torque = self.robot.joint_torque(motion.joint_position, motion.joint_velocity, acceleration)
        rigid = chain.motor_torque_from_joint(torque) + chain.rotor_torque(acceleration)
        speed = chain.motor_velocity_from_joint(motion.joint_velocity)
        viscous = self._friction.viscous(np.full_like(speed, self._temperature))
        coulomb = np.broadcast_to(self._friction.coulomb, speed.shape)
        standing = np.zeros(speed.shape, dtype=np.bool_)
        friction = self._friction.torque(
            speed, coulomb, viscous, motor_torque_rigid=rigid, standing=standing
        )
        return chain.joint_torque_from_motor(rigid + friction)

    def height(self, joint_position: Float) -> Float:
        """Return the height of the watched link, shape (N,); inf where none is watched. [m]

        Args:
            joint_position: Shape (N, n). [rad] or [m]
        """
        if self.floor is None:
            return np.full(len(joint_position), np.inf)
        link = self.floor.link
        return np.array([self.robot.link_position(row, link)[2] for row in joint_position])

    def use(self, motion: Trajectory) -> dict[str, Float]:
        """Return how much of each limit every sample uses; signed, the limit is at +-1.

        By kind, shape (N, n); of the floor (N, 1), where only +1 is a limit.
        """
        below = np.zeros((len(motion.joint_position), 1))
        if self.floor is not None:
            height = self.height(motion.joint_position)[:, None]
            below = 1.0 + (self.floor.height - height) / HEIGHT_SCALE
        return {
            "position": (motion.joint_position - self.middle) / self.reach,
            "velocity": motion.joint_velocity / self.velocity,
            "acceleration": motion.joint_acceleration / self.acceleration,
            "torque": self.joint_torque(motion) / self.torque,
            "floor": below,
        }

    def largest(self, motion: Trajectory) -> dict[str, Float]:
        """Return the largest use of each limit, shape (n,) by kind; above 1 it is broken."""
        return {
            kind: (values if kind == "floor" else np.abs(values)).max(axis=0)
            for kind, values in self.use(motion).items()
        }

    def smooth(self, motion: Trajectory) -> tuple[Float, list[tuple[str, int, Float]]]:
        """Return smooth largest uses and how they follow the motion.

        Shape (K,), and for each its kind, joint, and weight of every sample's signed use, shape
        (N,).
        """
        values: list[float] = []
        parts: list[tuple[str, int, Float]] = []
        for kind, use in self.use(motion).items():
            if kind == "floor" and self.floor is None:
                continue
            for joint in range(use.shape[1]):
                if kind == "torque" and not np.isfinite(self.torque[joint]):
                    continue
                value, weight = _smooth_maximum(use[:, joint], both=kind != "floor")
                values.append(value)
                parts.append((kind, joint, weight))
        return np.asarray(values), parts

    def torque_slopes(self, motion: Trajectory) -> Float:
        """Return use of torque per position, velocity, acceleration, shape (3, n, N, n)."""
        return slopes(motion, self, lambda m: self.joint_torque(m) / self.torque)

    def floor_slopes(self, motion: Trajectory) -> Float:
        """Return use of the floor per position of each joint, shape (n, N)."""
        here = self.height(motion.joint_position)
        result = np.zeros((self.robot.n_joints, len(here)))
        for joint in range(self.robot.n_joints):
            moved = motion.joint_position.copy()
            step = STEP * float(self.reach[joint])
            moved[:, joint] += step
            result[joint] = (here - self.height(moved)) / (step * HEIGHT_SCALE)
        return result


def slopes(
    motion: Trajectory, limits: ExcitationLimits, function: Callable[[Trajectory], Float]
) -> Float:
    """Return forward differences of a function of a motion, shape (3, n, N, ...).

    Args:
        function: Of the motion, shape (N, ...).
    """
    here = function(motion)
    channels = (motion.joint_position, motion.joint_velocity, motion.joint_acceleration)
    sizes = STEP * np.stack([limits.reach, limits.velocity, limits.acceleration])
    result = np.empty((*sizes.shape, *here.shape))
    for order, joint in np.ndindex(sizes.shape):
        moved = [channel.copy() for channel in channels]
        moved[order][:, joint] += sizes[order, joint]
        result[order, joint] = (function(Trajectory(*moved)) - here) / sizes[order, joint]
    return result


def _smooth_maximum(use: Float, both: bool) -> tuple[float, Float]:
    """Smooth maximum of ``use``, or of its magnitude, and its slope by sample."""
    signs = (1.0, -1.0) if both else (1.0,)
    top = max(float((sign * use).max()) for sign in signs)
    terms = [sign * np.exp(SHARPNESS * (sign * use - top)) for sign in signs]
    total = float(sum(np.abs(term).sum() for term in terms))
    slope = np.asarray(sum(terms)) / total
    return top + np.log(total) / SHARPNESS, slope
