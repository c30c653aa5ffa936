"""Which joints of a URDF a first model has, and the limits that scale it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import RobotDescriptionError, UnknownJointError
from robot_energy.physics.plausibility import gravity_torques
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import MOVING_TYPES, moved_mass, parse, take_inventory
from robot_energy.physics.urdf.moving_joints import GRIPPER_MASS_SHARE, moving_joints
from robot_energy.starter.priors import CLASSES, MAX_COBOT_MASS, MAX_COBOT_PEAK, RobotClass

MAX_EFFORT_RATIO = 30.0
"""If all effort limits are equal and one exceeds the needed torque this often, none is a limit."""
MIN_EFFORT_SHARE = 0.1
"""Least effort of a rotary joint over the largest one: wrists of published robots have more."""
PRISMATIC_VELOCITY = 1.0  # [m/s]
WHEELS = ("wheel", "caster", "castor")  # in names of joints


@dataclass(frozen=True)
class ArmJoint:
    """One joint of the first model, joint side.

    Attributes:
        name: As in the URDF.
        prismatic: Whether it moves in m.
        effort: Largest torque or force. [N m] or [N]
        effort_source: Where it comes from.
        velocity: Largest speed. [rad/s] or [m/s]
        velocity_source: Where it comes from.
        gear_ratio: Of the URDF's transmission; None if it has none. [-] or [rad/m]
    """

    name: str
    prismatic: bool
    effort: float
    effort_source: str
    velocity: float
    velocity_source: str
    gear_ratio: float | None


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
        urdf_xml: Text of the URDF.
        class_name: A name of `CLASSES`; None: chosen by peak power and mass.
        joint_names: The joints to model; empty: all independent moving joints without grippers.

    Raises:
        RobotDescriptionError: If the URDF cannot be used, or nothing in it moves.
        UnknownJointError: If it lacks one of ``joint_names``.
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
    ratios = _transmissions(root)
    guess = CLASSES[class_name or "cobot"]
    joints = _joints(robot, guess, ratios)
    peak = sum(joint.effort * joint.velocity for joint in joints)
    source = "as asked"
    if class_name is None:
        is_cobot = peak <= MAX_COBOT_PEAK and sum(mass) <= MAX_COBOT_MASS
        guess = CLASSES["cobot" if is_cobot else "industrial"]
        joints = _joints(robot, guess, ratios)
        source = (
            f"taken by its limits, {peak / 1e3:.1f} kW of peak power over all joints, and "
            f"{sum(mass):.0f} kg of moving mass"
        )
    remarks += [
        f"{joint.name}: {text}"
        for joint in joints
        for text in (joint.effort_source, joint.velocity_source)
        if not text.startswith("limit of the URDF")
    ]
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
    """Joints to model from the base outward, and those left out with the reason."""
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
            f"{', '.join(wheels)}: by the name a wheel; the model takes the base to stand still, "
            "so the power of driving is missing; name the joints of the arm alone with --joints"
        )
    return remarks


def _transmissions(root: ET.Element) -> dict[str, float]:
    """Gear ratios of transmissions; 0 and 1 are what exporters write where they know nothing."""
    ratios: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joint = transmission.find("joint")
        for place in ("actuator/mechanicalReduction", "joint/mechanicalReduction"):
            text = transmission.findtext(place)
            try:
                ratio = float(text or 0.0)
            except ValueError:
                continue
            if joint is not None and np.isfinite(ratio) and ratio not in (0.0, 1.0, -1.0):
                ratios.setdefault(str(joint.get("name")), ratio)
    return ratios


def _joints(robot: Robot, robot_class: RobotClass, ratios: dict[str, float]) -> list[ArmJoint]:
    """Limits of the joints: the URDF's where they can be, else scaled from its masses."""
    limits = robot.limits
    usual = np.where(limits.prismatic, PRISMATIC_VELOCITY, robot_class.velocity.value)
    velocity = np.where(np.isfinite(limits.velocity), limits.velocity, usual)
    needed = _needed_effort(robot, velocity / robot_class.rise_time)
    given = limits.effort
    placeholder = bool(
        len(given) > 2
        and np.isfinite(given[0])
        and np.all(given == given[0])
        and np.any(given > MAX_EFFORT_RATIO * needed)
    )
    joints: list[ArmJoint] = []
    for row, name in enumerate(robot.joint_names):
        unit = "N" if limits.prismatic[row] else "N m"
        effort, effort_source = float(given[row]), "limit of the URDF"
        speed, speed_source = float(velocity[row]), "limit of the URDF"
        if not np.isfinite(effort) or placeholder:
            effort_source = "no effort limit in the URDF"
            if placeholder:
                effort_source = (
                    f"all joints have the effort limit {effort:.3g} {unit}, which looks like a "
                    "placeholder"
                )
            effort = float(needed[row])
            effort_source += f"; {effort:.3g} {unit} taken, from gravity and acceleration"
        if not np.isfinite(limits.velocity[row]):
            speed_source = f"no velocity limit in the URDF; {speed:.3g} {limits.unit(row)}/s taken"
        joints.append(
            ArmJoint(
                name,
                bool(limits.prismatic[row]),
                effort,
                effort_source,
                speed,
                speed_source,
                ratios.get(name),
            )
        )
    return joints


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
