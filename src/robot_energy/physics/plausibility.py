"""What in a model or its URDF contradicts the rest, as figures in wrong units do.

Torques of gravity are those of paper A, eq. 1, at rest.
"""

from __future__ import annotations

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import parse
from robot_energy.physics.urdf.limits import limit_remarks
from robot_energy.physics.urdf.moving_joints import mimic_remarks
from robot_energy.physics.urdf.parse import inertia_remarks, prefix_remarks
from robot_energy.timeline.blocks import Float

CONFIGURATIONS = 200  # drawn for the largest torque of gravity
MAX_GRAVITY_RATIO = 3.0  # gravity over the effort limit, where springs may balance a part
MAX_TURNING = 30.0  # rad/s of a joint between two ends; quick wrists reach 20
MAX_RISE = 5.0  # s, from standstill to the velocity limit; robots need less than one
_SEED = 1


def implausible(model: RobotModel, robot: Robot) -> list[str]:
    """Return a sentence for all in a model or its URDF that contradicts the rest: wrong units."""
    limits = robot.limits
    gravity = np.max(np.abs(gravity_torques(robot)[1]), axis=0)
    root = parse(model.urdf_xml)
    found = [
        *prefix_remarks(root),
        *limit_remarks(root, robot.joint_names),
        *mimic_remarks(root),
        *inertia_remarks(root),
    ]
    for row, joint in enumerate(model.joints):
        velocity, effort = float(limits.velocity[row]), float(limits.effort[row])
        unit = "N" if limits.prismatic[row] else "N m"
        ratio = joint.gear_ratio.value
        coulomb = joint.friction.coulomb.value * abs(ratio)
        rise = joint.rotor_inertia.value * ratio**2 * velocity / effort
        limit = f"its effort limit in the URDF is {effort:.4g} {unit}"
        turns = not (limits.prismatic[row] or limits.wraps[row])
        if turns and MAX_TURNING < velocity < np.inf:
            found.append(
                f"{joint.name}: its velocity limit in the URDF is {velocity:.4g} rad/s: are these "
                "degrees per second?"
            )
        if gravity[row] > MAX_GRAVITY_RATIO * effort:
            found.append(
                f"{joint.name}: gravity needs {gravity[row]:.4g} {unit}, {limit}: are lengths in "
                "m and masses in kg?"
            )
        if coulomb > effort:
            found.append(
                f"{joint.name}: Coulomb friction is {coulomb:.4g} {unit} on the joint side, "
                f"{limit}: is coulomb that of the motor side?"
            )
        if MAX_RISE < rise < np.inf:
            found.append(
                f"{joint.name}: its rotor alone needs {rise:.3g} s to the velocity limit, {limit}: "
                "is rotor_inertia in kg m^2, motor side?"
            )
    return found


def gravity_torques(robot: Robot) -> tuple[Float, Float]:
    """Return positions drawn from the joint ranges and the torque of gravity there, joint side.

    Args:
        robot: The robot, n joints; the same positions for the same robot.

    Returns:
        Positions [rad] or [m] and torques [N m] or [N], shapes (N, n).
    """
    limits = robot.limits
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    rng = np.random.default_rng(_SEED)
    position = rng.uniform(low, high, (CONFIGURATIONS, robot.n_joints))
    zero = np.zeros_like(position)
    return position, robot.joint_torque(position, zero, zero)
