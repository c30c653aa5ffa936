"""Whether two descriptions can be of the same robot, by a quick comparison."""

from __future__ import annotations

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.urdf.checks import joint_limits, parse
from robot_energy.physics.urdf.limits import first_names

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
