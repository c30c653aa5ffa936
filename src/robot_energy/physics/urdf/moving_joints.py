"""The joints of a URDF that move, what each carries, and which of them cannot be modelled."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.physics.urdf.checks import MOVING_TYPES

GRIPPER_MASS_SHARE = 0.015
"""Prismatic joints and joints of a branch that carry less of the moving mass are a gripper's."""


class MovingJoint(Described):
    """One joint of a URDF that turns or slides."""

    mass: Annotated[float, "Of all that it carries. [kg]"]
    prismatic: bool
    branches: Annotated[bool, "Whether the body it sits on carries other moving joints too."]
    mimics: bool


def moving_joints(root: ET.Element) -> dict[str, MovingJoint]:
    """Return the joints that turn or slide, from the base outward."""
    mass = {
        str(link.get("name")): 0.0
        if (element := link.find("inertial/mass")) is None
        else float(element.get("value", "0"))
        for link in root.findall("link")
    }
    children: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        parent = joint.find("parent")
        if parent is not None:
            children.setdefault(str(parent.get("link")), []).append(joint)
    held = {str(child.get("link")) for child in root.findall("joint/child")}
    base = next(link for link in mass if link not in held)
    order: list[tuple[str, ET.Element | None, list[str]]] = []
    stack: list[tuple[str, ET.Element | None, list[str]]] = [(base, None, [])]
    while stack:
        link, joint, above = stack.pop()
        order.append((link, joint, above))
        moves = joint is not None and joint.get("type") in MOVING_TYPES
        path = [*above, str(joint.get("name"))] if joint is not None and moves else above
        for part in reversed(children.get(link, [])):
            child = part.find("child")
            if child is not None:
                stack.append((str(child.get("link")), part, path))
    carried: dict[str, float] = {}
    siblings: dict[tuple[str, ...], int] = {}
    found: dict[str, tuple[ET.Element, tuple[str, ...]]] = {}
    for link, joint, above in order:
        if joint is not None and joint.get("type") in MOVING_TYPES:
            name = str(joint.get("name"))
            found[name] = (joint, tuple(above))
            siblings[tuple(above)] = siblings.get(tuple(above), 0) + 1
            above = [*above, name]
        for name in above:
            carried[name] = carried.get(name, 0.0) + mass[link]
    return {
        name: MovingJoint(
            mass=carried[name],
            prismatic=joint.get("type") == "prismatic",
            branches=siblings[above] > 1,
            mimics=joint.find("mimic") is not None,
        )
        for name, (joint, above) in found.items()
    }


def mimic_remarks(root: ET.Element) -> list[str]:
    """Return a sentence for each follower that is locked, as it carries more than fingers."""
    joints = moving_joints(root)
    total = max((joint.mass for joint in joints.values()), default=0.0)
    return [
        f"joint '{name}' mimics another joint and carries {joint.mass:.3g} of {total:.3g} kg: its "
        "motion is not modelled, so power and energy lack it; write it as an independent joint and "
        "publish its state"
        for name, joint in joints.items()
        if joint.mimics and joint.mass > GRIPPER_MASS_SHARE * total
    ]
