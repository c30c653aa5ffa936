"""What in a model or its URDF contradicts the rest, as figures in wrong units do.

Torques of gravity are those of paper A, eq. 1, at rest.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import parse
from robot_energy.physics.urdf.moving_joints import mimic_remarks
from robot_energy.physics.urdf.parse import (
    INERTIA_TOLERANCE,
    MAX_EFFORT,
    fastest,
    first_names,
    limit_values,
    principal_moments,
    usable_limit,
)
from robot_energy.timeline.blocks import Float

CONFIGURATIONS = 200  # drawn for the largest torque of gravity
MAX_GRAVITY_RATIO = 3.0  # gravity over the effort limit, where springs may balance a part
MAX_TURNING = 30.0  # rad/s of a joint between two ends; quick wrists reach 20
MAX_RISE = 5.0  # s, from standstill to the velocity limit; robots need less than one
_SEED = 1
MAX_MOMENT_RATIO = 1.5  # of a principal moment over the sum of the other two; digits leave 1
MIN_REACH = 1.0  # m; a smaller robot is taken for one of that size


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
    """Return positions [rad] or [m] drawn from the ranges, and torques of gravity, (N, n). [N m]"""
    limits = robot.limits
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    rng = np.random.default_rng(_SEED)
    position = rng.uniform(low, high, (CONFIGURATIONS, robot.n_joints))
    zero = np.zeros_like(position)
    return position, robot.joint_torque(position, zero, zero)


def limit_remarks(root: ET.Element, joint_names: Sequence[str]) -> list[str]:
    """Return a sentence for each kind of limit that counts as not given, though it is stated."""
    found: dict[str, list[str]] = {}
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name in joint_names:
        kind, limit = str(joints[name].get("type")), joints[name].find("limit")
        given = {} if limit is None else limit_values(limit)
        for key in ("effort", "velocity"):
            value = given.get(key, 0.0)
            if value and np.isinf(usable_limit(kind, key, value)) and not np.isinf(value):
                found.setdefault(_unusable(kind, key, value), []).append(name)
        low, high = given.get("lower", 0.0), given.get("upper", 0.0)
        if kind != "continuous" and low > high:
            text = f"lower limit {low:.4g} is above the upper limit {high:.4g}: the range counts "
            found.setdefault(text + "as not given; exchange them", []).append(name)
    return [f"{first_names(names)}: {text}" for text, names in found.items()]


def prefix_remarks(root: ET.Element) -> list[str]:
    """Return a sentence for each prefix that the URDF uses and does not declare."""
    known, used = {"xml", "xmlns"}, dict[str, None]()
    for element in root.iter():
        for name in (element.tag, *element.keys()):
            prefix, colon, rest = name.partition(":")
            if colon:
                used[prefix] = None
                known.update([rest] if prefix == "xmlns" else [])
    return [
        f"the URDF uses the prefix '{prefix}' without declaring it, which other programs refuse: "
        f'add xmlns:{prefix}="..." to its element robot'
        for prefix in used
        if prefix not in known
    ]


def inertia_remarks(root: ET.Element) -> list[str]:
    """Return a sentence for each body whose inertia no distribution of its mass can have.

    That is where the mass would lie outside of the robot, or where a principal moment of inertia
    exceeds the sum of the other two. The numbers of the URDF are checked before.
    """
    origins = [*root.iterfind("joint/origin"), *root.iterfind("link/inertial/origin")]
    offsets = [[float(word) for word in origin.get("xyz", "0").split()] for origin in origins]
    travel = [
        abs(float(limit.get(key, "0")))
        for limit in root.iterfind("joint[@type='prismatic']/limit")
        for key in ("lower", "upper")
    ]
    reach = max(MIN_REACH, sum(travel) + sum(float(np.linalg.norm(xyz)) for xyz in offsets))
    found: list[str] = []
    for link in root.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is None or inertia is None:
            continue
        kilogram = float(mass.get("value", "0"))
        small, middle, largest = principal_moments(inertia)
        if largest > kilogram * reach**2 > 0:
            found.append(
                f"link '{link.get('name')}': {kilogram:.4g} kg cannot have an inertia of "
                f"{largest:.4g} kg m^2 in a robot of {reach:.2g} m: are its units right?"
            )
        elif largest > MAX_MOMENT_RATIO * (small + middle) + INERTIA_TOLERANCE:
            found.append(
                f"link '{link.get('name')}': no body has principal moments of inertia of "
                f"{small:.4g}, {middle:.4g} and {largest:.4g} kg m^2: the largest is at most "
                "the sum of the others; check ixx to iyz"
            )
    return found


def _unusable(kind: str, key: str, value: float) -> str:
    linear = kind == "prismatic"
    effort_unit, speed_unit = ("N", "m/s") if linear else ("N m", "rad/s")
    unit = effort_unit if key == "effort" else speed_unit
    if value < 0.0:
        why = "a limit is above 0"
    elif key == "effort":
        why = f"no joint of a robot has {MAX_EFFORT:.0e} {unit}"
    else:
        why = f"a joint moves at less than {fastest(kind):g} {unit}"
        if not linear:
            why += "; are these degrees per second?"
    return f"{key} limit of {value:.4g} {unit} in the URDF counts as not given ({why})"
