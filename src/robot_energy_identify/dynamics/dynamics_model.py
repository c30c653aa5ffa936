"""Identified dynamics -> a model file that the monitor runs."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from robot_energy.certainty.figure_deviations import BODY_TAGS, TORQUE_TAG
from robot_energy.foundation.errors import check_shape
from robot_energy.model import RobotModel
from robot_energy.model.schema import Urdf
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.blocks import Float
from robot_energy_identify.dynamics.base_parameters import SHOWN
from robot_energy_identify.dynamics.consistent import second_moments
from robot_energy_identify.dynamics.dynamics import Dynamics
from robot_energy_identify.dynamics.torque_model import Estimate
from robot_energy_identify.provenance import identified_from

SOURCE = "identify dynamics"  # of its figures
IDENTIFIED_TAGS = {**dict.fromkeys(BODY_TAGS, "derived"), TORQUE_TAG: "identified"}


def to_model(result: Dynamics, recordings: Sequence[str] = ()) -> RobotModel:
    """Return the model, not yet saved, with identified bodies, rotors and friction.

    Bodies are those of the physically consistent fit: single figures of a body that torque
    determines only in groups are the prior's share, so their tag is ``derived``; the torque of the
    whole is what was identified. Rotor inertia and friction carry standard deviations where
    they are identified on their own. Offsets of the torque sensor stay out.
    """
    model, base, values = result.model, result.exported_base, result.standard
    torque_model = result.torque_model
    ratio = np.diagonal(torque_model.transmission)
    joints = list(model.joints)
    for (column, owner, name), value in zip(
        torque_model.extra, values[torque_model.n_links :], strict=True
    ):
        if column.written is not None:
            estimate = _estimate(result, name, float(value))
            joints[owner] = column.written(joints[owner], float(ratio[owner]), estimate)
    urdf_xml = with_link_parameters(model.urdf_xml, model.joint_names, values[: 10 * len(joints)])
    inertial = int((base.independent < 10 * len(joints)).sum())
    urdf = Urdf(
        xml=urdf_xml,
        tags={**model.urdf.tags, **IDENTIFIED_TAGS},  # type: ignore[dict-item]
        source=f"{model.urdf.source}; bodies: physically consistent fit of {inertial} groups of "
        "inertial parameters",
    )
    done = "Dynamics identified from motor torque."
    provenance = identified_from(model.provenance, done, recordings)
    update = {"joints": joints, "urdf": urdf, "provenance": provenance}
    return model.model_copy(update=update).with_urdf(urdf_xml, model.source)


def _estimate(result: Dynamics, name: str, value: float) -> Estimate:
    """Say how well one parameter is known on its own."""
    base = result.exported_base
    if base.alone(name):
        std = float(result.exported.std[base.labels.index(name)])
        return Estimate(value, std, "identified", SOURCE)
    index = base.names.index(name)
    for group, weights in enumerate(base.matrix):
        if abs(float(weights[index])) > SHOWN:
            return Estimate(
                value, None, "derived", f"only the sum {base.expression(group)} is identified"
            )
    return Estimate(value, None, "assumed", "no torque depends on it")


def with_link_parameters(urdf_xml: str, joint_names: Sequence[str], link_parameters: Float) -> str:
    """Return the text of a URDF with identified bodies.

    All that moves with a joint is one body; it goes to the link behind the joint, and the
    links fixed to that one (or locked to it) lose their own.

    Args:
        link_parameters: Ten per joint, as of `Robot.link_parameters`, shape (10 n,).
            [kg], [kg m] and [kg m^2]
    """
    check_shape("link_parameters", link_parameters.shape, (10 * len(joint_names),))
    root = ET.fromstring(urdf_xml.strip())
    links = {str(link.get("name")): link for link in root.findall("link")}
    below: dict[str, list[str]] = {}
    behind: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent, child = (
            "" if (element := joint.find(end)) is None else str(element.get("link"))
            for end in ("parent", "child")
        )
        behind[str(joint.get("name"))] = child
        if str(joint.get("name")) not in joint_names:
            below.setdefault(parent, []).append(child)
    for place, name in enumerate(joint_names):
        body = link_parameters[10 * place : 10 * place + 10]
        carried = [behind[name]]
        while carried:
            link = carried.pop()
            for old in links[link].findall("inertial"):
                links[link].remove(old)
            carried += below.get(link, [])
        links[behind[name]].insert(0, _inertial(body))
    return ET.tostring(root, encoding="unicode")


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


def friction_at_joints(result: Dynamics) -> dict[str, tuple[Float, Float]]:
    """Friction as textbooks give it: torque of each joint by its own motion.

    A coupled motor drags the joint that it is coupled to as well, so the viscous torque of
    a joint per its own velocity sums over all motors that turn with it. Coulomb friction of
    a coupled joint is its own where it was fitted apart from its motor's.

    Returns:
        ``viscous`` [N m s/rad] and ``coulomb`` [N m]: values and standard deviations, each
        of shape (n,).
    """
    transmission = Drivetrain.from_model(result.model).transmission
    share = transmission / np.diagonal(transmission)[:, None]
    names, labels, fit = result.model.joint_names, result.base.labels, result.fit
    found: dict[str, tuple[Float, Float]] = {}
    for kind in ("viscous", "coulomb"):
        matrix = np.zeros((len(names), len(labels)))
        for joint, name in enumerate(names):
            weights = {f"joint_{kind} {name}": 1.0}
            if kind == "viscous":
                turned = zip(names, share[:, joint].tolist(), strict=True)
                weights |= {f"viscous {motor}": turns**2 for motor, turns in turned}
            elif f"joint_coulomb {name}" not in labels:
                weights[f"coulomb {name}"] = 1.0
            matrix[joint] = [weights.get(label, 0.0) for label in labels]
        std = np.sqrt(np.diag(matrix @ fit.covariance @ matrix.T))
        found[kind] = matrix @ fit.values, std
    return found
