"""Which joints and drives of a URDF a first model has, with which limits, and of which class.

- ``mechanicalReduction`` and ``drake:gear_ratio`` of a transmission: motor turns per joint turn.
- ``motorInertia`` and ``drake:rotor_inertia``: of the rotor, motor side, before the gear.
- ``dynamics`` of a joint: viscous damping and Coulomb friction, joint side.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RobotDescriptionError, UnknownJointError
from robot_energy.foundation.shown_text import shown
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import MOVING_TYPES, moved_mass, parse, take_inventory
from robot_energy.physics.urdf.moving_joints import GRIPPER_MASS_SHARE, moving_joints
from robot_energy.physics.urdf.parse import first_names
from robot_energy.timeline.blocks import Float
from robot_energy_identify.starter.model_remarks import gravity_torques, limit_remarks
from robot_energy_identify.starter.priors import CLASSES, MAX_COBOT_MASS, MAX_COBOT_PEAK, RobotClass

_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction", "drake:gear_ratio")
_INERTIAS = ("motorInertia", "drake:rotor_inertia")
_UNKNOWN_RATIOS = (0.0, 1.0, -1.0)  # what exporters write where they know no gear
MIN_EQUAL = 3
"""So many joints of different strength do not have the same friction: a simulation's default."""


class Actuator(Described):
    """Drive of one joint as far as the URDF states it; None where it does not."""

    gear_ratio: Annotated[float | None, "Motor turns per joint turn, signed. [-] or [rad/m]"] = None
    rotor_inertia: Annotated[float | None, "Motor side. [kg m^2]"] = None
    damping: Annotated[float | None, "Viscous friction, joint side. [N m s/rad] or [N s/m]"] = None
    friction: Annotated[float | None, "Coulomb friction, joint side. [N m] or [N]"] = None


Ignored = dict[str, dict[str, None]]  # what is left out: joints by reason


def read_actuators(
    root: ET.Element, joint_names: Sequence[str]
) -> tuple[dict[str, Actuator], list[str]]:
    """Return the drive of every joint, and a sentence for each kind of entry that is left out."""
    actuators, ignored = {name: Actuator() for name in joint_names}, Ignored()
    for path in ("transmission", "ros2_control/transmission"):
        for transmission in root.iterfind(path):
            _read_transmission(transmission, actuators, ignored)
    for joint in root.findall("joint"):
        name, dynamics = str(joint.get("name")), joint.find("dynamics")
        if dynamics is None or name not in actuators:
            continue
        values: dict[str, float] = {}
        for key in ("damping", "friction"):
            text = dynamics.get(key, "0")
            value = _number(text)
            if value is None or value < 0.0:
                reason = (
                    f"{key} '{shown(text, 40)}' of the URDF is not used: no number of 0 or more"
                )
                ignored.setdefault(reason, {})[name] = None
            elif value > 0.0:
                values[key] = value
        actuators[name] = replace(actuators[name], **{"damping": None, "friction": None, **values})
    return actuators, _sentences(ignored)


def _sentences(ignored: Ignored) -> list[str]:
    return [f"{first_names([*names])}: {reason}" for reason, names in ignored.items()]


def without_defaults(
    actuators: dict[str, Actuator], effort: Sequence[float], velocity: Sequence[float]
) -> tuple[dict[str, Actuator], list[str]]:
    """Return the drives without friction that no such joint can have, and say what was left out.

    Args:
        effort: Largest torque or force of each joint, joint side. [N m] or [N]
        velocity: Largest speed. [rad/s] or [m/s]
    """
    kept, ignored = dict(actuators), Ignored()
    given = {name: one for name, one in actuators.items() if _rubs(one)}
    limits = dict(zip(actuators, zip(effort, velocity, strict=True), strict=True))
    pairs = {(one.damping, one.friction) for one in given.values()}
    strengths = {round(limits[name][0], 6) for name in given}
    alike = len(given) >= MIN_EQUAL and len(pairs) == 1 and len(strengths) > 1
    for name, one in given.items():
        limit, speed = limits[name]
        if alike:
            why = "it is the same for joints of different strength, as a default of a simulation is"
        elif (one.damping or 0.0) * speed + (one.friction or 0.0) >= limit:
            why = "friction at full speed would need all of the effort limit"
        else:
            continue
        ignored.setdefault(f"dynamics of the URDF is not used: {why}", {})[name] = None
        kept[name] = replace(one, damping=None, friction=None)
    return kept, _sentences(ignored)


def _rubs(actuator: Actuator) -> bool:
    return actuator.damping is not None or actuator.friction is not None


def _read_transmission(
    transmission: ET.Element, actuators: dict[str, Actuator], ignored: Ignored
) -> None:
    joints = [str(joint.get("name")) for joint in transmission.findall("joint")]
    for name in (joint for joint in joints if joint in actuators):

        def ignore(reason: str, joint: str = name) -> None:
            ignored.setdefault(reason, {})[joint] = None

        actuator = actuators[name]
        ratio = _entry(transmission, _REDUCTIONS, ignore)
        inertia = _entry(transmission, _INERTIAS, ignore)
        if len(joints) > 1 and (ratio is not None or inertia is not None):
            ignore("its transmission moves several joints; its figures are not used")
            continue
        if ratio is not None and ratio not in _UNKNOWN_RATIOS:
            if abs(ratio) < 1.0:
                ignore(
                    f"gear ratio {ratio:.4g} of the URDF is not used: the motor would turn slower "
                    f"than the joint; is it {1 / ratio:.4g}?"
                )
            elif actuator.gear_ratio not in (None, ratio):
                ignore(f"gear ratio {ratio:.4g} is not used: the URDF gives another")
            else:
                actuator = replace(actuator, gear_ratio=ratio)
        if inertia is not None and inertia < 0.0:
            ignore(f"rotor inertia {inertia:.4g} of the URDF is not used: it is below 0")
        elif inertia and actuator.gear_ratio is None:
            ignore("rotor inertia of the URDF is not used: it gives no gear ratio")
        elif inertia:
            actuator = replace(actuator, rotor_inertia=inertia)
        actuators[name] = actuator


def _entry(
    transmission: ET.Element, tags: Sequence[str], ignore: Callable[[str], None]
) -> float | None:
    """Return a number of the actuator, or else of the joint, of a transmission."""
    places = (*transmission.findall("actuator"), *transmission.findall("joint"))
    for element in (part for place in places for part in place if part.tag in tags):
        text = (element.get("value") or element.text or "").strip()
        value = _number(text)
        if text and value is None:
            ignore(f"{element.tag} '{shown(text, 40)}' of the URDF is not a number")
        return value
    return None


def _number(text: str) -> float | None:
    """Return a finite number, None for anything else."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


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
NO_VELOCITY = "no usable velocity limit in the URDF"
WHEELS = ("wheel", "caster", "castor")  # in names of joints


class ArmJoint(Described):
    """One joint of the first model, joint side."""

    name: str
    prismatic: bool
    effort: Annotated[float, "Largest torque or force. [N m] or [N]"]
    why_effort: Annotated[str, "Why it is not that of the URDF; empty if it is."]
    velocity: Annotated[float, "Largest speed. [rad/s] or [m/s]"]
    why_velocity: Annotated[str, "The same."]
    actuator: Actuator

    @property
    def units(self) -> tuple[str, str]:
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
            why_effort=reasons[row],
            velocity=float(velocity[row]),
            why_velocity="" if np.isfinite(limits.velocity[row]) else NO_VELOCITY,
            actuator=actuators[name],
        )
        for row, name in enumerate(robot.joint_names)
    ]


def taken_limits(joints: Sequence[ArmJoint]) -> list[str]:
    """Return one sentence for each reason to take another limit than the URDF has."""
    found: dict[tuple[str, str, str], list[tuple[str, float]]] = {}
    for joint in joints:
        efforts = joint.why_effort, joint.units[0], ", from gravity and acceleration"
        speeds = joint.why_velocity, joint.units[1], ""
        for key, value in ((efforts, joint.effort), (speeds, joint.velocity)):
            if key[0]:
                found.setdefault(key, []).append((joint.name, value))
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
