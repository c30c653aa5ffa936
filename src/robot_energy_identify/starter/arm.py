"""Which joints of a URDF a first model has, and of which class the robot is."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace

from robot_energy.foundation.errors import RobotDescriptionError, UnknownJointError
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import MOVING_TYPES, moved_mass, parse, take_inventory
from robot_energy.physics.urdf.limits import limit_remarks
from robot_energy.physics.urdf.moving_joints import GRIPPER_MASS_SHARE, moving_joints
from robot_energy_identify.starter.actuators import read_actuators, without_defaults
from robot_energy_identify.starter.joints import ArmJoint, scaled_joints, taken_limits
from robot_energy_identify.starter.priors import CLASSES, MAX_COBOT_MASS, MAX_COBOT_PEAK, RobotClass

WHEELS = ("wheel", "caster", "castor")  # in names of joints


@dataclass(frozen=True)
class Arm:
    """What a first model needs to know of a URDF.

    Attributes:
        robot_name: Name in the URDF.
        joints: Modelled joints from the base to the tip.
        left_out: Moving joints that are not modelled, and why.
        massless_links: Links that move without inertia of their own or of their body.
        moving_mass: Of everything that moves. [kg]
        robot_class: The class it was given, or taken for.
        class_source: Why.
        remarks: What the user should look at, a sentence each.
    """

    robot_name: str
    joints: tuple[ArmJoint, ...]
    left_out: tuple[tuple[str, str], ...]
    massless_links: tuple[str, ...]
    moving_mass: float
    robot_class: RobotClass
    class_source: str
    remarks: tuple[str, ...]

    @property
    def peak_power(self) -> float:
        """Sum over the joints of effort times speed. [W]"""
        return sum(joint.effort * joint.velocity for joint in self.joints)


def read_arm(urdf_xml: str, class_name: str | None = None, joint_names: Sequence[str] = ()) -> Arm:
    """Return the joints of a first model, and their limits.

    Args:
        class_name: A name of `CLASSES`; None: chosen by peak power and mass.
        joint_names: The joints to model; empty: all independent moving joints without grippers.
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
