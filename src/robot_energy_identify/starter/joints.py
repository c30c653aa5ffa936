"""The joints of a first model: their limits, and where the URDF gives none that can be one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.physics.plausibility import gravity_torques
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.limits import first_names
from robot_energy.timeline.blocks import Float
from robot_energy_identify.starter.actuators import Actuator
from robot_energy_identify.starter.priors import RobotClass

MAX_EFFORT_RATIO = 300.0
"""An effort limit that exceeds the needed torque this often is none; knees of legs have 90."""
MAX_EQUAL_RATIO = 30.0
"""The same where all joints have the same limit."""
LEVER = 0.1
"""At least the weight of the robot at this distance counts as needed, since a load is not in the
URDF. [m]"""
STANDARD_GRAVITY = 9.80665  # [m/s^2]
MIN_EFFORT_SHARE = 0.1
"""Least effort of a rotary joint over the largest one: wrists of published robots have more."""
PRISMATIC_VELOCITY = 1.0  # [m/s]
GIVEN = "limit of the URDF"


@dataclass(frozen=True)
class ArmJoint:
    """One joint of the first model, joint side.

    Attributes:
        effort: Largest torque or force. [N m] or [N]
        effort_source: `GIVEN`, or why another value was taken.
        velocity: Largest speed. [rad/s] or [m/s]
    """

    name: str
    prismatic: bool
    effort: float
    effort_source: str
    velocity: float
    velocity_source: str
    actuator: Actuator

    @property
    def units(self) -> tuple[str, str]:
        """Units of effort and velocity."""
        return ("N", "m/s") if self.prismatic else ("N m", "rad/s")


def scaled_joints(
    robot: Robot, robot_class: RobotClass, actuators: dict[str, Actuator]
) -> list[ArmJoint]:
    """Return the joints with the limits of the URDF, else with such that fit its masses."""
    limits = robot.limits
    usual = np.where(limits.prismatic, PRISMATIC_VELOCITY, robot_class.velocity.value)
    velocity = np.where(np.isfinite(limits.velocity), limits.velocity, usual)
    needed = _needed_effort(robot, velocity / robot_class.rise_time)
    at_least = np.maximum(needed, LEVER * STANDARD_GRAVITY * robot.moving_mass)
    reasons = _why_no_effort_limit(limits.effort, at_least)
    return [
        ArmJoint(
            name=name,
            prismatic=bool(limits.prismatic[row]),
            effort=float(needed[row] if reasons[row] else limits.effort[row]),
            effort_source=reasons[row] or GIVEN,
            velocity=float(velocity[row]),
            velocity_source=GIVEN
            if np.isfinite(limits.velocity[row])
            else "no usable velocity limit in the URDF",
            actuator=actuators[name],
        )
        for row, name in enumerate(robot.joint_names)
    ]


def taken_limits(joints: Sequence[ArmJoint]) -> list[str]:
    """Name the limits that are not those of the URDF, with what was taken.

    Returns:
        One sentence for each reason.
    """
    found: dict[tuple[str, str, str], list[tuple[str, float]]] = {}
    for joint in joints:
        effort_unit, speed_unit = joint.units
        if joint.effort_source != GIVEN:
            key = joint.effort_source, effort_unit, ", from gravity and acceleration"
            found.setdefault(key, []).append((joint.name, joint.effort))
        if joint.velocity_source != GIVEN:
            key = joint.velocity_source, speed_unit, ""
            found.setdefault(key, []).append((joint.name, joint.velocity))
    return [
        f"{first_names([name for name, _ in entries])}: {reason}; "
        f"{first_names(list(dict.fromkeys(f'{value:.3g}' for _, value in entries)))} {unit} taken"
        f"{how}"
        for (reason, unit, how), entries in found.items()
    ]


def _why_no_effort_limit(given: Float, needed: Float) -> list[str]:
    """Return for each joint why its effort limit is none; empty where it is one."""
    ratio = given / needed
    if len(given) > 2 and np.all(given == given[0]) and MAX_EQUAL_RATIO < ratio.max() < np.inf:
        text = f"all joints have the effort limit {given[0]:.3g}, which looks like a placeholder"
        return [text] * len(given)
    return [
        "no usable effort limit in the URDF"
        if np.isinf(limit)
        else f"the effort limit {limit:.3g} is over {MAX_EFFORT_RATIO:g} times what it needs, "
        "which looks like a placeholder"
        if share > MAX_EFFORT_RATIO
        else ""
        for limit, share in zip(given, ratio, strict=True)
    ]


def _needed_effort(robot: Robot, acceleration: Float) -> Float:
    """Largest torque of gravity over the joint ranges, plus that of each acceleration alone."""
    limits = robot.limits
    position, gravity = gravity_torques(robot)
    zero = np.zeros_like(position)
    needed = np.max(np.abs(gravity), axis=0)
    for joint in range(robot.n_joints):
        alone = zero.copy()
        alone[:, joint] = acceleration[joint]
        inertia = robot.joint_torque(position, zero, alone) - gravity
        needed[joint] += np.max(np.abs(inertia[:, joint]))
    rotary = ~limits.prismatic
    needed[rotary] = np.maximum(
        needed[rotary], MIN_EFFORT_SHARE * np.max(needed[rotary], initial=0)
    )
    return np.maximum(needed, 0.1)
