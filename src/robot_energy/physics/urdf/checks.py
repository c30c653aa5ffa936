"""What a URDF says: checked, with its limits, and which of its joints are modelled.

Nothing here moves: `robot` turns the same text into rigid-body dynamics.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RobotDescriptionError, UnknownJointError
from robot_energy.model import RobotModel
from robot_energy.physics.urdf.parse import (
    RESERVED_NAMES,
    UNLIMITED,
    check_numbers,
    first_names,
    limit_values,
    read_elements,
    usable_limit,
)
from robot_energy.timeline.blocks import Float

MAX_LINKS = 1000
MOVING_TYPES = ("revolute", "continuous", "prismatic")
_OF_DYNAMICS = {"link": ("inertial",), "joint": ("parent", "child", "origin", "axis")}
LOCKED_AT = 0.0  # where joints stand that the model does not name [rad] or [m]


class JointLimits(Described):
    """Limits of the modelled joints from the URDF, joint side."""

    joint_names: tuple[str, ...]
    lower: Annotated[
        Float, "Shape (n,), -inf where there is none (continuous joints). [rad] or [m]"
    ]
    upper: Annotated[Float, "Shape (n,), inf where there is none. [rad] or [m]"]
    velocity: Annotated[
        Float, "Shape (n,), inf where the URDF gives none that can be one. [rad/s] or [m/s]"
    ]
    effort: Annotated[Float, "Shape (n,), likewise. [N m] or [N]"]
    prismatic: Annotated[NDArray[np.bool_], "Which joints move in m, shape (n,)."]
    wraps: Annotated[
        NDArray[np.bool_], "Which joints turn without end, so that 2 pi is not a step, shape (n,)."
    ]

    def unit(self, joint: int) -> str:
        """Return the unit of the position: ``m`` of a prismatic joint, else ``rad``."""
        return "m" if self.prismatic[joint] else "rad"


class JointEntry(Described):
    """One moving joint of a URDF."""

    name: str
    kind: str
    modelled: Annotated[bool, "Whether its motion is modelled; if not, it is locked."]
    remark: Annotated[str, "Its limits if it is modelled, else why it is not."]

    @property
    def state(self) -> str:
        """How it is treated, in two or three words."""
        return "modelled" if self.modelled else f"locked at {LOCKED_AT:g}"


class Inventory(Described):
    """What of a URDF is modelled, and what is not."""

    joints: tuple[JointEntry, ...]
    fixed_joints: int
    massless_links: Annotated[tuple[str, ...], "Links that move without a mass of their own."]
    allowed_massless: Annotated[
        tuple[str, ...], "Those of them whose whole body has none, on purpose."
    ]

    @property
    def locked_joints(self) -> tuple[str, ...]:
        """Joints that could move but are not modelled."""
        return tuple(entry.name for entry in self.joints if not entry.modelled)

    def sentences(self) -> list[str]:
        """Return one line per joint, then one per remark on the whole robot."""
        wide = max((len(entry.name) for entry in self.joints), default=0)
        lines = [
            f"{entry.name:<{wide}}  {entry.kind:<10}  {entry.state:<11}  {entry.remark}"
            for entry in self.joints
        ]
        if self.fixed_joints:
            lines.append(f"{self.fixed_joints} fixed joint(s): their links move with their parents")
        carried = [name for name in self.massless_links if name not in self.allowed_massless]
        if carried:
            lines.append(f"links without mass, on a body that has one: {', '.join(carried)}")
        if self.allowed_massless:
            allowed = ", ".join(self.allowed_massless)
            lines.append(f"links that move without mass, as massless_links allows: {allowed}")
        return lines


def parse(urdf_xml: str) -> ET.Element:
    """Return the root of a URDF without entities and geometry that is one tree, names unique."""
    root = read_elements(urdf_xml)
    if root.tag != "robot":
        raise RobotDescriptionError(f"the XML has the root '{root.tag}'", "'robot' (a URDF)")
    for kind in ("link", "joint"):
        if len(root.findall(kind)) > MAX_LINKS:
            raise RobotDescriptionError(
                f"the URDF has over {MAX_LINKS} {kind}s", f"at most {MAX_LINKS}"
            )
    for kind in ("link", "joint"):
        counts = Counter(str(element.get("name")) for element in root.findall(kind))
        for name, count in counts.items():
            if count > 1:
                raise RobotDescriptionError(
                    f"the URDF has {count} {kind}s of the name '{name}'", "unique names"
                )
    if root.find("link") is None:
        raise RobotDescriptionError(
            "the URDF has no links",
            "a robot of links and joints",
            "a xacro file may only define macros: name the one that calls them",
        )
    check_numbers(root)
    _check_tree(root)
    return root


def take_inventory(
    root: ET.Element, joint_names: Sequence[str], massless_links: Sequence[str] = ()
) -> Inventory:
    """Return every joint that can move, and what is done with it."""
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    moving = {name: joint for name, joint in joints.items() if joint.get("type") != "fixed"}
    for name in joint_names:
        if name not in joints:
            raise UnknownJointError(
                f"the URDF has no joint '{name}'",
                "the joints of the model file",
                f"the URDF moves: {', '.join(moving) or 'nothing'}",
            )
        kind = str(joints[name].get("type"))
        if kind not in MOVING_TYPES:
            raise RobotDescriptionError(
                f"joint '{name}' is of type '{kind}'", " or ".join(MOVING_TYPES)
            )
        if joints[name].find("mimic") is not None:
            raise RobotDescriptionError(
                f"joint '{name}' mimics another joint",
                "independent joints",
                "leave it out of the model file; it is then locked",
            )
    bodies = _bodies(root, tuple(joint_names))
    without = {name: [] if mass > 0.0 else links for name, (mass, links, _) in bodies.items()}
    empty = sorted(links[0] for links in without.values() if links)
    refused = [link for link in empty if link not in set(massless_links)]
    if refused:
        raise RobotDescriptionError(
            f"the URDF gives no mass to moving links: {', '.join(refused)}",
            "an inertial with mass for every body that moves",
            "use a URDF with inertias, or name them under massless_links on purpose",
        )
    limits = joint_limits(root, joint_names)
    entries = [
        JointEntry(name, str(joints[name].get("type")), True, _range(limits, index))
        for index, name in enumerate(joint_names)
    ]
    entries += [
        JointEntry(name, str(joint.get("type")), False, _why_locked(joint))
        for name, joint in moving.items()
        if name not in joint_names
    ]
    return Inventory(
        joints=tuple(entries),
        fixed_joints=len(joints) - len(moving),
        massless_links=tuple(link for _, _, massless in bodies.values() for link in massless),
        allowed_massless=tuple(link for links in without.values() for link in links),
    )


def moved_mass(root: ET.Element, joint_names: Sequence[str]) -> list[float]:
    """Return the mass of the rigid body that each modelled joint moves. [kg]"""
    bodies = _bodies(root, tuple(joint_names))
    return [bodies[name][0] for name in joint_names]


def joint_limits(root: ET.Element, joint_names: Sequence[str]) -> JointLimits:
    """Return the limits of the modelled joints.

    Velocity and effort limits of 0 or less or beyond all robots, and ranges without extent, are
    what exporters write where no limit is known: they count as none.
    """
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    kinds = [str(joints[name].get("type")) for name in joint_names]
    size = len(kinds)
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    velocity, effort = np.full(size, np.inf), np.full(size, np.inf)
    for row, (name, kind) in enumerate(zip(joint_names, kinds, strict=True)):
        limit = joints[name].find("limit")
        given = {} if limit is None else limit_values(limit)
        low, high = given.get("lower", 0.0), given.get("upper", 0.0)
        if kind != "continuous" and low < high:
            lower[row] = low if low > -UNLIMITED else -np.inf
            upper[row] = high if high < UNLIMITED else np.inf
        for key, values in (("velocity", velocity), ("effort", effort)):
            values[row] = usable_limit(kind, key, given.get(key, 0.0))
    return JointLimits(
        joint_names=tuple(joint_names),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort,
        prismatic=np.array([kind == "prismatic" for kind in kinds], dtype=np.bool_),
        wraps=np.array([kind == "continuous" for kind in kinds], dtype=np.bool_),
    )


def for_dynamics(root: ET.Element) -> str:
    """Return the URDF with what the dynamics need alone, and in the way the parser accepts.

    Limits play no part in the dynamics and are opened wide, since the parser refuses joints
    without them. Continuous joints become revolute, one coordinate instead of (cos, sin).
    Mimics become joints of their own, which `Robot` locks. A joint that only holds may have a name
    that the dynamics keep for themselves; it gets another one.
    """
    wide = {"lower": -UNLIMITED, "upper": UNLIMITED, "velocity": UNLIMITED, "effort": UNLIMITED}
    for element in list(root):
        if element.tag not in _OF_DYNAMICS:
            root.remove(element)
            continue
        for part in list(element):
            if part.tag not in _OF_DYNAMICS[element.tag]:
                element.remove(part)
    for joint in root.findall("joint"):
        if joint.get("name") in RESERVED_NAMES:
            joint.set("name", f"{joint.get('name')} of the URDF")
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
        if joint.get("type") in MOVING_TYPES:
            ET.SubElement(joint, "limit", {key: str(value) for key, value in wide.items()})
    return ET.tostring(root, encoding="unicode")


def _check_tree(root: ET.Element) -> None:
    """Refuse joints between links that are not there, loops and several roots."""
    links = [str(link.get("name")) for link in root.findall("link")]
    parent_of: dict[str, str] = {}
    for joint in root.findall("joint"):
        name, parent, child = joint.get("name"), joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            raise RobotDescriptionError(f"joint '{name}' lacks a parent or child", "both, as links")
        above, below = str(parent.get("link")), str(child.get("link"))
        for link in (above, below):
            if link not in links:
                raise RobotDescriptionError(
                    f"joint '{name}' names the link '{link}' that is not there",
                    "a link of the URDF",
                )
        if below in parent_of:
            raise RobotDescriptionError(
                f"the links form a loop: '{below}' has two parents", "a tree of links"
            )
        parent_of[below] = above
    for link in links:
        seen = {link}
        while link in parent_of:
            link = parent_of[link]
            if link in seen:
                raise RobotDescriptionError(f"the links form a loop through '{link}'", "a tree")
            seen.add(link)
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise RobotDescriptionError(
            f"the URDF has {len(roots)} roots: {', '.join(roots)}", "one tree of links"
        )


def _bodies(
    root: ET.Element, joint_names: tuple[str, ...]
) -> dict[str, tuple[float, list[str], list[str]]]:
    """Mass, links and massless links of the rigid body that each modelled joint moves."""
    mass: dict[str, float] = {}
    for link in root.findall("link"):
        element = link.find("inertial/mass")
        mass[str(link.get("name"))] = 0.0 if element is None else float(element.get("value", "0"))
    children: dict[str, list[str]] = {}
    child_of: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:  # which `parse` has refused
            continue
        child_of[str(joint.get("name"))] = str(child.get("link"))
        if str(joint.get("name")) not in joint_names:
            children.setdefault(str(parent.get("link")), []).append(str(child.get("link")))
    bodies: dict[str, tuple[float, list[str], list[str]]] = {}
    for name in joint_names:
        stack, links = [child_of[name]], list[str]()
        while stack:
            links.append(stack.pop())
            stack.extend(children.get(links[-1], []))
        total = math.fsum(mass[link] for link in links)
        bodies[name] = (total, links, [link for link in links if mass[link] == 0.0])
    return bodies


def _range(limits: JointLimits, joint: int) -> str:
    unit = limits.unit(joint)
    parts: list[str] = []
    if np.isfinite(limits.lower[joint]):
        parts.append(f"{limits.lower[joint]:.4g} to {limits.upper[joint]:.4g} {unit}")
    if np.isfinite(limits.velocity[joint]):
        parts.append(f"up to {limits.velocity[joint]:.4g} {unit}/s")
    return ", ".join(parts) or f"in {unit}, without limits"


def _why_locked(joint: ET.Element) -> str:
    mimic = joint.find("mimic")
    if mimic is not None:
        return f"mimics {mimic.get('joint')}; its motion is not modelled"
    if joint.get("type") not in MOVING_TYPES:
        return "a joint of this type cannot be modelled"
    return "not in the model file"


LIKE = 0.01  # limits that differ by less than this share are the same [-]
SHOWN = 3  # joints named in one sentence


def disagreements(model: RobotModel, urdf_xml: str) -> list[str]:
    """Compare the joints of a model with a description that the robot publishes.

    Joint names, kinds and limits of position and velocity are compared, the limits only
    where both descriptions give them. Poses and inertias are not.

    Returns:
        One part of a sentence for each kind of difference; empty if there is none.
    """
    ours, theirs = parse(model.urdf_xml), parse(urdf_xml)
    known = {str(joint.get("name")): str(joint.get("type")) for joint in theirs.findall("joint")}
    lacking = [name for name in model.joint_names if known.get(name, "fixed") == "fixed"]
    found = [f"it has no moving joint {first_names(lacking, SHOWN)}"] if lacking else []
    both = [name for name in model.joint_names if name not in lacking]
    if not both:
        return found
    first, second = joint_limits(ours, both), joint_limits(theirs, both)
    turned = first.prismatic != second.prismatic
    if turned.any():
        names = [both[row] for row in np.flatnonzero(turned)]
        found.append(f"it has another kind of joint {first_names(names, SHOWN)}")
    for what, keys in (("range", ("lower", "upper")), ("velocity limit", ("velocity",))):
        differs = np.zeros(len(both), dtype=np.bool_)
        for key in keys:
            one, other = getattr(first, key), getattr(second, key)
            given = np.isfinite(one) & np.isfinite(other)
            scale = np.where(given, np.maximum(np.abs(one), np.abs(other)), 1.0)
            step = np.where(given, one, 0.0) - np.where(given, other, 0.0)
            differs |= np.abs(step) > LIKE * scale
        if differs.any():
            names = [both[row] for row in np.flatnonzero(differs)]
            found.append(f"its {what} differs for {first_names(names, SHOWN)}")
    return found
