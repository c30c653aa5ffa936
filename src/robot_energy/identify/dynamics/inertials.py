"""Inertial parameters of moving bodies -> the URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import NotIdentifiableError, check_shape
from robot_energy.identify.dynamics.consistent import second_moments
from robot_energy.physics.urdf.checks import parse


def with_link_parameters(urdf_xml: str, joint_names: Sequence[str], link_parameters: Float) -> str:
    """Write identified bodies into a URDF.

    All that moves with a joint is one body; it goes to the link behind the joint, and the
    links fixed to that one (or locked to it) lose their own.

    Args:
        urdf_xml: Text of the URDF.
        joint_names: Modelled joints.
        link_parameters: Ten per joint, as of `Robot.link_parameters`, shape (10 n,).
            [kg], [kg m] and [kg m^2]

    Returns:
        Text of the URDF with new inertials.

    Raises:
        NotIdentifiableError: If a body has no mass: only bodies that can exist are written.
    """
    check_shape("link_parameters", link_parameters.shape, (10 * len(joint_names),))
    parse(urdf_xml)  # refuses what cannot be used
    root = ET.fromstring(urdf_xml.strip())
    links = {str(link.get("name")): link for link in root.findall("link")}
    below: dict[str, list[str]] = {}
    behind: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent, child = _link(joint, "parent"), _link(joint, "child")
        behind[str(joint.get("name"))] = child
        if str(joint.get("name")) not in joint_names:
            below.setdefault(parent, []).append(child)
    for place, name in enumerate(joint_names):
        body = link_parameters[10 * place : 10 * place + 10]
        if not body[0] > 0.0:
            raise NotIdentifiableError(
                f"the body behind joint '{name}' came out with {body[0]:g} kg",
                "bodies that can exist",
                "write the physically consistent fit",
            )
        carried = [behind[name]]
        while carried:
            link = carried.pop()
            for old in links[link].findall("inertial"):
                links[link].remove(old)
            carried += below.get(link, [])
        links[behind[name]].insert(0, _inertial(body))
    return ET.tostring(root, encoding="unicode")


def _link(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else str(element.get("link"))


def _inertial(body: Float) -> ET.Element:
    """Return the element, about the centre of mass, with every digit."""
    mass, centre = float(body[0]), body[1:4] / body[0]
    about_centre = second_moments(body) - mass * np.outer(centre, centre)
    tensor = float(np.trace(about_centre)) * np.eye(3) - about_centre
    element = ET.Element("inertial")
    ET.SubElement(element, "origin", xyz=" ".join(repr(float(v)) for v in centre), rpy="0 0 0")
    ET.SubElement(element, "mass", value=repr(mass))
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    places["izz"] = (2, 2)
    ET.SubElement(
        element, "inertia", {name: repr(float(tensor[at])) for name, at in places.items()}
    )
    return element
