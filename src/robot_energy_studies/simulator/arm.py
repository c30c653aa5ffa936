"""Rigid bodies, rotors and elastic gears of an arm as a model of MuJoCo.

Each gear is a spring and a damper between a link and its rotor, joint side
``torque = k u + d du/dt`` with the wind-up ``u = motor angle / ratio - joint angle``. Rotors are
bodies that turn at motor speed about the axis of their joint, so that their gyroscopic torques
and their coupling with the other links are there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from robot_energy.foundation.extras import require
from robot_energy.timeline.blocks import Float, Int

GRAVITY = 9.81  # m/s^2
MOMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
ROTOR_MASS = 1e-3  # kg, of the body that turns; the mass of a motor is part of its link


@dataclass(frozen=True)
class Body:
    """A link and the revolute joint before it; frames are parallel at the zero pose."""

    joint: str  # name of the joint
    place: Float  # of the joint in the frame of the link before, shape (3,) [m]
    axis: Float  # of the joint, shape (3,) [-]
    mass: float  # [kg]
    centre: Float  # of mass, shape (3,) [m]
    inertia: Float  # about the centre of mass, shape (3, 3) [kg m^2]

    def with_load(self, mass: float, centre: Float, inertia: Float) -> Body:
        """Return the link with something fixed to it.

        Args:
            mass: [kg]
            centre: In the frame of the link, shape (3,). [m]
            inertia: About the centre, shape (3, 3). [kg m^2]
        """
        total = self.mass + mass
        middle = (self.mass * self.centre + mass * centre) / total
        whole = np.zeros((3, 3))
        for m, c, i in ((self.mass, self.centre, self.inertia), (mass, centre, inertia)):
            arm = c - middle
            whole += i + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return replace(self, mass=total, centre=middle, inertia=whole)


@dataclass(frozen=True)
class ElasticArm:
    """A chain of bodies with one drive for each joint, shape (n,) each."""

    bodies: tuple[Body, ...]
    gear_ratio: Float  # motor angle over joint angle [-]
    rotor_inertia: Float  # about its axis, motor side [kg m^2]
    stiffness: Float  # of the gear, joint side [N m/rad]
    damping: Float  # of the gear, joint side [N m s/rad]
    carrier: tuple[int, ...]  # index of the link on which each motor sits, -1 for the base

    def mjcf(self, step: float) -> str:
        """Return the model as MuJoCo reads it, joints ``q0`` ... and rotors ``m0`` ...

        Args:
            step: Of the integration. [s]
        """
        add, root = ElementTree.SubElement, ElementTree.Element("mujoco")
        add(root, "compiler", angle="radian")
        option = add(
            root, "option", timestep=f"{step}", integrator="Euler", gravity=f"0 0 {-GRAVITY}"
        )
        add(option, "flag", contact="disable", energy="enable")
        links, tendons = [add(root, "worldbody")], add(root, "tendon")
        for index, body in enumerate(self.bodies):
            link = add(links[-1], "body", pos=_text(body.place))
            _inertial(link, body.mass, body.centre, body.inertia)
            add(link, "joint", name=f"q{index}", axis=_text(body.axis))
            links.append(link)
        for index, (body, carrier) in enumerate(zip(self.bodies, self.carrier, strict=True)):
            rotor = add(links[carrier + 1], "body")
            _inertial(rotor, ROTOR_MASS, np.zeros(3), self.rotor_inertia[index] * np.eye(3))
            add(rotor, "joint", name=f"m{index}", axis=_text(body.axis))
            spring = {"stiffness": f"{self.stiffness[index]}", "damping": f"{self.damping[index]}"}
            gear = add(tendons, "fixed", spring, springlength="0")
            add(gear, "joint", joint=f"q{index}", coef="-1")
            add(gear, "joint", joint=f"m{index}", coef=f"{1.0 / self.gear_ratio[index]}")
        return ElementTree.tostring(root, encoding="unicode")

    def compiled(self, step: float) -> tuple[Any, Int, Int]:
        """Return MuJoCo's model, and where joints and rotors stand in its vectors, shape (n,) each.

        Args:
            step: Of the integration. [s]
        """
        require("mujoco", "the second simulator")
        import mujoco

        mujoco.set_mju_user_warning(_counted)  # MuJoCo would write a file where it runs
        model: Any = mujoco.MjModel.from_xml_string(self.mjcf(step))
        n_joints = len(self.bodies)
        joints, rotors = (
            np.array([int(model.joint(f"{letter}{index}").qposadr[0]) for index in range(n_joints)])
            for letter in "qm"
        )
        return model, joints, rotors


def read_urdf(path: Path) -> tuple[tuple[Body, ...], dict[str, tuple[int, Float]]]:
    """Return the bodies of a serial arm, and the place of every link.

    Joints stand in their order from the base; frames of links are not turned.

    Returns:
        The bodies, and by name of a link the index of the body that carries it and its place there.
    """
    root: Any = ElementTree.parse(path).getroot()  # of which every entry is there
    inertial = {link.attrib["name"]: link.find("inertial") for link in root.iter("link")}
    bodies: list[Body] = []
    frames: dict[str, tuple[int, Float]] = {}
    for joint in root.iter("joint"):
        place = _vector(joint.find("origin").attrib["xyz"])
        child = joint.find("child").attrib["link"]
        if joint.attrib["type"] == "fixed":
            index, before = frames[joint.find("parent").attrib["link"]]
            frames[child] = (index, before + place)
            continue
        frames[child] = (len(bodies), np.zeros(3))
        entry = inertial[child]
        moments = entry.find("inertia").attrib
        xx, yy, zz, xy, xz, yz = (float(moments[f"i{key}"]) for key in MOMENTS)
        bodies.append(
            Body(
                joint.attrib["name"],
                place,
                _vector(joint.find("axis").attrib["xyz"]),
                float(entry.find("mass").attrib["value"]),
                _vector(entry.find("origin").attrib["xyz"]),
                np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
            )
        )
    return tuple(bodies), frames


def limits_of_urdf(path: Path) -> Mapping[str, Float]:
    """Return ``velocity`` [rad/s] and ``effort`` [N m] of the moving joints, shape (n,) each."""
    entries = [joint.find("limit") for joint in ElementTree.parse(path).iter("joint")]
    return {
        key: np.array([float(entry.attrib[key]) for entry in entries if entry is not None])
        for key in ("velocity", "effort")
    }


def _counted(_warning: str) -> None:
    """Do nothing: MuJoCo counts its warnings in its data."""


def _inertial(parent: ElementTree.Element, mass: float, centre: Float, inertia: Float) -> None:
    full = [inertia[place] for place in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    place = {"pos": _text(centre), "mass": f"{mass}", "fullinertia": _text(np.array(full))}
    ElementTree.SubElement(parent, "inertial", place)


def _text(values: Float) -> str:
    return " ".join(f"{value:.17g}" for value in values.tolist())


def _vector(text: str) -> Float:
    return np.array([float(part) for part in text.split()])
