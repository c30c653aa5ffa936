"""Which joints of a URDF a first model has, with which limits, and of which class the robot is."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RobotDescriptionError, UnknownJointError
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import MOVING_TYPES, moved_mass, parse, take_inventory
from robot_energy.physics.urdf.moving_joints import GRIPPER_MASS_SHARE, moving_joints
from robot_energy.physics.urdf.parse import first_names
from robot_energy.timeline.blocks import Float
from robot_energy_identify.starter.actuators import Actuator, read_actuators, without_defaults
from robot_energy_identify.starter.model_remarks import gravity_torques, limit_remarks
from robot_energy_identify.starter.priors import CLASSES, MAX_COBOT_MASS, MAX_COBOT_PEAK, RobotClass

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
WHEELS = ("wheel", "caster", "castor")  # in names of joints


class ArmJoint(Described):
    """One joint of the first model, joint side."""

    name: str
    prismatic: bool
    effort: Annotated[float, "Largest torque or force. [N m] or [N]"]
    effort_source: Annotated[str, "`GIVEN`, or why another value was taken."]
    velocity: Annotated[float, "Largest speed. [rad/s] or [m/s]"]
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
    """Return one sentence for each reason to take another limit than the URDF has."""
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


class Arm(Described):
    """What a first model needs to know of a URDF."""

    robot_name: str
    joints: tuple[ArmJoint, ...]
    left_out: Annotated[tuple[tuple[str, str], ...], "Moving joints not modelled, and why."]
    massless_links: Annotated[tuple[str, ...], "Links that move without inertia."]
    moving_mass: Annotated[float, "Of everything that moves. [kg]"]
    robot_class: Annotated[RobotClass, "The class it was given, or taken for."]
    class_source: str
    remarks: Annotated[tuple[str, ...], "What the user should look at, a sentence each."]

    @property
    def peak_power(self) -> float:
        """Sum over the joints of effort times speed. [W]"""
        return sum(joint.effort * joint.velocity for joint in self.joints)


def read_arm(urdf_xml: str, class_name: str | None = None, joint_names: Sequence[str] = ()) -> Arm:
    """Return the joints of a first model, and their limits.

    Without a class it is chosen by peak power and mass; without names all independent moving joints
    but grippers are modelled.
    """
    root = parse(urdf_xml)
    names, left_out = _chosen(root, joint_names)
    links = tuple({str(link.get("name")) for link in root.findall("link")})
    massless = take_inventory(root, names, links).allowed_massless
    robot = Robot(urdf_xml, names, massless_links=massless)
    mass = moved_mass(root, names)
    if not sum(mass):
        raise RobotDescriptionError(
            "the URDF gives no mass to any moving link",
            "a mass and an inertia for every body that moves",
            "use a URDF with inertials; many geometric ones have none",
        )
    remarks = _remarks(names, mass)
    actuators, ignored = read_actuators(root, names)
    guess = CLASSES[class_name or "cobot"]
    joints = scaled_joints(robot, guess, actuators)
    peak = sum(joint.effort * joint.velocity for joint in joints)
    source = "as asked"
    if class_name is None:
        is_cobot = peak <= MAX_COBOT_PEAK and sum(mass) <= MAX_COBOT_MASS
        guess = CLASSES["cobot" if is_cobot else "industrial"]
        joints = scaled_joints(robot, guess, actuators)
        source = (
            f"taken by its limits, {peak / 1e3:.1f} kW of peak power over all joints, and "
            f"{sum(mass):.0f} kg of moving mass"
        )
    actuators, defaults = without_defaults(
        actuators, [joint.effort for joint in joints], [joint.velocity for joint in joints]
    )
    joints = [replace(joint, actuator=actuators[joint.name]) for joint in joints]
    remarks += [*limit_remarks(root, names), *taken_limits(joints), *ignored, *defaults]
    return Arm(
        robot_name=root.get("name") or "robot",
        joints=tuple(joints),
        left_out=tuple(left_out),
        massless_links=massless,
        moving_mass=sum(mass),
        robot_class=guess,
        class_source=source,
        remarks=tuple(remarks),
    )


def _chosen(
    root: ET.Element, wanted: Sequence[str]
) -> tuple[tuple[str, ...], list[tuple[str, str]]]:
    below = moving_joints(root)
    moving = [name for name, joint in below.items() if not joint.mimics]
    others = [(name, "mimics another joint") for name, joint in below.items() if joint.mimics]
    if wanted:
        unknown = [name for name in wanted if name not in below]
        if unknown:
            raise UnknownJointError(
                f"the URDF has no moving joint '{unknown[0]}'",
                "joints of the URDF",
                f"it moves: {', '.join(below) or 'nothing'}",
            )
        chosen = tuple(name for name in moving if name in set(wanted))
        return chosen, others + [(n, "not asked for") for n in moving if n not in set(wanted)]
    if not moving:
        raise RobotDescriptionError(
            "no joint of the URDF moves independently", f"a joint of type {', '.join(MOVING_TYPES)}"
        )
    total = max(joint.mass for joint in below.values())
    chosen_names: list[str] = []
    for name in moving:
        joint = below[name]
        if (joint.prismatic or joint.branches) and joint.mass < GRIPPER_MASS_SHARE * total:
            others.append((name, "looks like a gripper: it carries little mass at the tip"))
        else:
            chosen_names.append(name)
    return tuple(chosen_names or moving), others


def _remarks(names: Sequence[str], mass: Sequence[float]) -> list[str]:
    """Say what looks like a placeholder among the masses, and what a model of wheels lacks."""
    remarks: list[str] = []
    if len(mass) > 2 and len({round(value, 6) for value in mass}) == 1:
        remarks.append(
            f"every body has {mass[0]:g} kg, which looks like a placeholder: torque and power are "
            "wrong until the URDF has the masses of the robot"
        )
    remarks += [
        f"{name} moves a body without mass, which is missing in torque and power"
        for name, value in zip(names, mass, strict=True)
        if value == 0.0
    ]
    wheels = [name for name in names if any(word in name.lower() for word in WHEELS)]
    if wheels:
        remarks.append(
            f"{', '.join(wheels)}: by its name a wheel; the model assumes that the base stands "
            "still, so the power of driving is missing; name the joints of the arm alone with "
            "--joints"
        )
    return remarks
