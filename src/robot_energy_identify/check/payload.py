"""What a robot carries instead of its model's payload, all of it at one link."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from robot_energy.model.payload import Payload
from robot_energy.timeline.blocks import Float
from robot_energy_identify.check.evidence import Evidence

FARTHEST = 3.0  # m of a payload from its link
PLACE = (0.0, 0.0, 0.1)  # of a body at a link that carries none [m]


def more_payload(evidence: Evidence, mass: float) -> tuple[Payload, ...]:
    """Return the payload of the robot with more mass in the same place.

    Args:
        mass: More than in the model. [kg]
    """
    carried = evidence.robot.payload
    if not carried or not carried[-1].mass:
        body = Payload(link=_last_link(evidence), mass=mass, centre_of_mass=PLACE, tag="assumed")
        return (*carried, body)
    last = carried[-1]
    factor = 1.0 + mass / last.mass
    inertia = tuple(factor * value for value in last.inertia)
    return (*carried[:-1], last.model_copy(update={"mass": factor * last.mass, "inertia": inertia}))


def _last_link(evidence: Evidence) -> str:
    root = ElementTree.fromstring(evidence.model.urdf_xml)
    child = root.find(f"joint[@name='{evidence.names[-1]}']/child")
    return "" if child is None else child.get("link", "")


def carried_payload(
    evidence: Evidence, mass: float, std: float, moment: Float
) -> tuple[Payload, ...] | None:
    """Return the payload of the robot with a body added at its last link.

    None if it would be surely less than nothing, or if nothing would change.

    Args:
        mass: More than in the model. [kg]
        std: Standard deviation of it. [kg]
        moment: Its mass times its centre, in the frame of the last link, shape (3,). [kg m]
    """
    robot, carried, last = evidence.robot, evidence.robot.payload, _last_link(evidence)
    link = carried[-1].link if carried else last
    rest = np.zeros(len(evidence.names))
    at, turn = robot.link_pose(rest, link)
    last_at, last_turn = robot.link_pose(rest, last)
    moments = turn.T @ (last_turn @ moment + (last_at - at) * mass)
    total = mass
    if carried:
        total += carried[-1].mass
        moments = moments + carried[-1].mass * np.asarray(carried[-1].centre_of_mass)
    others = tuple(body for body in carried[:-1] if body.link != link)
    total = round(total, 2)
    if carried and -2.0 * std < total <= 0.0:
        return others
    if total <= 0.0:
        return None
    if np.max(np.abs(moments)) > FARTHEST * total:
        return None
    x, y, z = (round(float(value), 3) for value in moments / total)
    inertia = carried[-1].inertia if carried else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    body = Payload(link=link, mass=total, centre_of_mass=(x, y, z), inertia=inertia, tag="assumed")
    return (*others, body)
