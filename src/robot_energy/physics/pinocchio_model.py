"""Models of Pinocchio for paper A, eq. 2: of a URDF, reduced, with payload, for the kernel."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from robot_energy.foundation.errors import RobotDescriptionError
from robot_energy.model.payload import Payload
from robot_energy.physics import kernels
from robot_energy.timeline.blocks import Float


def full_model(urdf_xml: str) -> pin.Model:
    """Return all joints of a URDF, its links as frames of `frame_of`."""
    try:
        model = pin.buildModelFromXML(urdf_xml)
        for frame in model.frames:  # a link and a joint may have one name, frames may not
            if frame.type == pin.FrameType.BODY:
                frame.name = frame_of(frame.name)
        return model
    except (ValueError, RuntimeError, IndexError) as error:
        raise RobotDescriptionError(
            f"the URDF is not accepted: {error}", "a URDF that Pinocchio reads"
        ) from error


def frame_of(link: str) -> str:
    """Return the name of the frame of a link: no joint has it, as XML lacks the character."""
    return f"\x1f{link}"


def reduced(full: pin.Model, locked_joints: Sequence[str]) -> pin.Model:
    """Return a model without the locked joints."""
    try:
        locked = [full.getJointId(name) for name in locked_joints]
        return pin.buildReducedModel(full, locked, pin.neutral(full))
    except (ValueError, RuntimeError, IndexError) as error:
        raise RobotDescriptionError(
            f"the URDF is not accepted: {error}", "a URDF that Pinocchio reads"
        ) from error


def kernel_table(model: pin.Model) -> Float | None:
    """Return the joints and bodies as the kernel takes them; None where it cannot.

    The kernel has the z axis of each frame along the axis of its joint, so frames are turned.
    """
    if model.njoints - 1 > kernels.MAX_JOINTS:
        return None
    turns: list[Float] = [np.eye(3)]  # of each frame of the kernel in that of Pinocchio
    rows: list[list[float]] = []
    for body in range(1, model.njoints):
        joint = model.joints[body]
        if (joint.nq, joint.nv) != (1, 1):
            return None
        data = joint.createData()
        joint.calc(data, np.zeros(1))
        linear, angular = np.asarray(data.S, dtype=np.float64).reshape(2, 3)
        prismatic = bool(linear.any())
        parent, place = int(model.parents[body]), model.jointPlacements[body]
        inertia = model.inertias[body]
        above, turn = turns[parent].T, _onto_z(linear if prismatic else angular)
        rotation = above @ np.asarray(place.rotation) @ turn
        tensor = turn.T @ np.asarray(inertia.matrix())[3:, 3:] @ turn  # about the origin
        rows.append(
            [
                float(parent),
                float(prismatic),
                *rotation.flat,
                *(above @ np.asarray(place.translation)),
                float(inertia.mass),
                *(turn.T @ (inertia.mass * np.asarray(inertia.lever))),
                *tensor.flat,
            ]
        )
        turns.append(turn)
    return np.array(rows)


def _onto_z(axis: Float) -> Float:
    """Return a rotation that turns z onto a unit vector."""
    first = np.zeros(3)
    first[int(np.argmin(np.abs(axis)))] = 1.0
    first -= axis * (axis @ first)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def check_mass(model: pin.Model, joint_names: Sequence[str], mass: Sequence[float]) -> None:
    """Refuse a model that lost or found mass on the way; the URDF parser says nothing.

    Args:
        mass: That each joint moves, as the URDF has it, shape (n,). [kg]
    """
    for name, expected in zip(joint_names, mass, strict=True):
        found = float(model.inertias[model.getJointId(name)].mass)
        if not math.isclose(found, expected, rel_tol=1e-9, abs_tol=1e-12):
            raise RobotDescriptionError(
                f"the body that joint '{name}' moves has {expected:g} kg in the URDF but "
                f"{found:g} kg once read",
                "the same mass",
                "check the inertials of its links",
            )


def attach(model: pin.Model, body: Payload) -> None:
    """Add a rigid body to the joint that carries a link."""
    if not model.existFrame(frame_of(body.link), pin.FrameType.BODY):
        links = [one.name[1:] for one in model.frames if one.type == pin.FrameType.BODY]
        raise RobotDescriptionError(
            f"the payload sits on the link '{body.link}' that the URDF lacks",
            f"one of its links {', '.join(links)}",
        )
    frame = model.frames[model.getFrameId(frame_of(body.link), pin.FrameType.BODY)]
    inertia = pin.Inertia.Zero()  # its constructor refuses moments a rounding below zero
    inertia.mass, inertia.lever = body.mass, np.asarray(body.centre_of_mass)
    inertia.inertia = body.tensor
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
