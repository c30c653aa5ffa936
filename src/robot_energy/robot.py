"""Rigid-body dynamics of one robot in the joint order of its model file.

The only module that imports Pinocchio.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robot_energy.blocks import Float, check_shape
from robot_energy.errors import RobotDescriptionError, UnknownJointError
from robot_energy.model_file.schema import Payload, RobotModel

MAX_URDF_BYTES = 8 * 1024 * 1024
MAX_LINKS = 1000
UNLIMITED = 1e12  # stands for infinity, which the URDF parser does not accept
MOVING_TYPES = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class JointLimits:
    """Limits of the modelled joints from the URDF, joint side.

    Attributes:
        lower: Shape (n,), -inf for a continuous joint. [rad] or [m]
        upper: Shape (n,). [rad] or [m]
        velocity: Shape (n,), inf where the URDF gives none. [rad/s] or [m/s]
        effort: Shape (n,), inf where the URDF gives none. [N m] or [N]
    """

    lower: Float
    upper: Float
    velocity: Float
    effort: Float


class Robot:
    """Inverse dynamics by the recursive Newton-Euler algorithm, payload included.

    Joints of the URDF that the model does not name are locked at zero; they are listed
    in ``locked_joints``.

    Args:
        urdf_xml: Text of the URDF. Meshes are never opened.
        joint_names: Modelled joints, in the order of every array.
        gravity: In the base frame. [m/s^2]
        payload: Rigid bodies fixed to links.
        massless_links: Links that may move without inertia, on purpose.

    Raises:
        RobotDescriptionError: If the URDF cannot be used.
        UnknownJointError: If it lacks a joint that the model names.
    """

    def __init__(
        self,
        urdf_xml: str,
        joint_names: Sequence[str],
        gravity: Sequence[float] = (0.0, 0.0, -9.80665),
        payload: Sequence[Payload] = (),
        massless_links: Sequence[str] = (),
    ) -> None:
        root = _parse(urdf_xml)
        self.joint_names = tuple(joint_names)
        self.n_joints = len(self.joint_names)
        self.locked_joints = _check(root, self.joint_names, massless_links)
        self.limits = _limits(root, self.joint_names)
        try:
            full = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise RobotDescriptionError(f"the URDF is not accepted: {error}") from error
        for body in payload:
            _attach(full, body)
        locked = [full.getJointId(name) for name in self.locked_joints]
        self._model = pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full
        self._model.gravity.linear = np.asarray(gravity, dtype=np.float64)
        self._pool = pin.ModelPool(self._model, 1)
        indices = [
            self._model.joints[self._model.getJointId(name)].idx_v for name in self.joint_names
        ]
        self._to_model = np.argsort(np.asarray(indices, dtype=np.int64))
        self._from_model = np.asarray(indices, dtype=np.int64)
        self._same_order = bool(np.array_equal(indices, np.arange(self.n_joints)))

    @classmethod
    def from_model(cls, model: RobotModel) -> Robot:
        """Build the robot that a model file describes.

        Raises:
            RobotDescriptionError: If the URDF cannot be used.
            UnknownJointError: If the URDF lacks a joint of the model.
        """
        return cls(
            model.urdf_xml, model.joint_names, model.gravity, model.payload, model.massless_links
        )

    @property
    def moving_mass(self) -> float:
        """Mass of everything that moves, payload included. [kg]"""
        return float(sum(inertia.mass for inertia in self._model.inertias[1:]))

    def joint_torque(
        self, joint_position: Float, joint_velocity: Float, joint_acceleration: Float
    ) -> Float:
        """Rigid-body joint torque ``M(q) qdd + c(q, qd) + g(q)`` (paper A, eq. 2).

        A sample that is not finite gives NaN; samples never influence each other, and
        the result of a sample does not depend on the block it came in.

        Args:
            joint_position: Shape (N, n). [rad] or [m]
            joint_velocity: Shape (N, n). [rad/s] or [m/s]
            joint_acceleration: Shape (N, n). [rad/s^2] or [m/s^2]

        Returns:
            Joint side, without friction and rotor inertia, shape (N, n). [N m] or [N]

        Raises:
            ShapeError: If a shape is not (N, n).
        """
        shape = (len(joint_position), self.n_joints)
        check_shape("joint_position", joint_position, shape)
        check_shape("joint_velocity", joint_velocity, shape)
        check_shape("joint_acceleration", joint_acceleration, shape)
        if shape[0] == 0:
            return np.empty(shape)
        columns = [
            (values if self._same_order else values[:, self._to_model]).T
            for values in (joint_position, joint_velocity, joint_acceleration)
        ]
        torque = pin.rneaInParallel(1, self._pool, *map(np.asfortranarray, columns))
        torque = torque.reshape(self.n_joints, shape[0]).T  # one sample comes back flat
        if not self._same_order:
            torque = torque[:, self._from_model]
        return np.ascontiguousarray(torque)

    def link_position(self, joint_position: Float, link: str) -> Float:
        """Position of a link's frame in the base frame at one configuration.

        Args:
            joint_position: Shape (n,). [rad] or [m]
            link: Name of the link.

        Returns:
            Shape (3,). [m]

        Raises:
            RobotDescriptionError: If there is no such link.
        """
        if not self._model.existFrame(link):
            raise RobotDescriptionError(f"the URDF has no link '{link}'")
        data = self._model.createData()
        pin.framesForwardKinematics(self._model, data, np.asarray(joint_position)[self._to_model])
        return np.array(data.oMf[self._model.getFrameId(link)].translation)


def _parse(urdf_xml: str) -> ET.Element:
    """Parse the URDF without entities, geometry and wrap-around joints."""
    if len(urdf_xml) > MAX_URDF_BYTES:
        raise RobotDescriptionError(
            f"the URDF has {len(urdf_xml)} characters", f"at most {MAX_URDF_BYTES}"
        )
    if "<!DOCTYPE" in urdf_xml or "<!ENTITY" in urdf_xml:
        raise RobotDescriptionError("the URDF declares a DOCTYPE or entities", "plain XML")
    try:
        root = ET.fromstring(urdf_xml.strip())
    except (ET.ParseError, ValueError) as error:
        raise RobotDescriptionError(f"the URDF is not well-formed XML ({error})") from error
    if root.tag != "robot":
        raise RobotDescriptionError(f"the XML has the root '{root.tag}'", "'robot' (a URDF)")
    if len(root.findall("link")) > MAX_LINKS:
        raise RobotDescriptionError(f"the URDF has over {MAX_LINKS} links")
    for link in root.findall("link"):
        for geometry in (*link.findall("visual"), *link.findall("collision")):
            link.remove(geometry)
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":  # one coordinate instead of (cos, sin)
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ET.SubElement(joint, "limit") if limit is None else limit
            limit.set("lower", str(-UNLIMITED))
            limit.set("upper", str(UNLIMITED))
            for key in ("effort", "velocity"):
                limit.set(key, limit.get(key, str(UNLIMITED)))
    return root


def _check(
    root: ET.Element, joint_names: tuple[str, ...], massless_links: Sequence[str]
) -> tuple[str, ...]:
    """Check joints and inertias; return the moving joints that are not modelled."""
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
    without = sorted(
        link for link in _links_moved_by(root, joint_names) if link not in set(massless_links)
    )
    if without:
        raise RobotDescriptionError(
            f"the URDF gives no mass to the moving link(s) {', '.join(without)}",
            "an inertial with mass for every body that moves",
            "use a URDF with inertias, or name them under massless_links on purpose",
        )
    return tuple(name for name in moving if name not in joint_names)


def _links_moved_by(root: ET.Element, joint_names: tuple[str, ...]) -> list[str]:
    """Child links of modelled joints whose rigid body (with fixed children) has no mass."""
    mass: dict[str, float] = {}
    for link in root.findall("link"):
        element = link.find("inertial/mass")
        text = "0" if element is None else element.get("value", "0")
        try:
            mass[str(link.get("name"))] = float(text)
        except ValueError as error:
            raise RobotDescriptionError(
                f"link '{link.get('name')}' has the mass '{text}'", "a number"
            ) from error
    children: dict[str, list[str]] = {}
    child_of: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            raise RobotDescriptionError(f"joint '{joint.get('name')}' lacks a parent or child")
        child_of[str(joint.get("name"))] = str(child.get("link"))
        if str(joint.get("name")) not in joint_names:
            children.setdefault(str(parent.get("link")), []).append(str(child.get("link")))
    empty: list[str] = []
    for name in joint_names:
        stack, total, seen = [child_of[name]], 0.0, set[str]()
        while stack:
            link = stack.pop()
            if link in seen:
                raise RobotDescriptionError(f"the links form a loop through '{link}'")
            seen.add(link)
            total += mass.get(link, 0.0)
            stack.extend(children.get(link, []))
        if total <= 0.0:
            empty.append(child_of[name])
    return empty


def _limits(root: ET.Element, joint_names: tuple[str, ...]) -> JointLimits:
    rows: dict[str, list[float]] = {"lower": [], "upper": [], "velocity": [], "effort": []}
    default = {"lower": -np.inf, "upper": np.inf, "velocity": np.inf, "effort": np.inf}
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name in joint_names:
        limit = joints[name].find("limit")
        for key, values in rows.items():
            text = None if limit is None else limit.get(key)
            try:
                values.append(default[key] if text is None else float(text))
            except ValueError as error:
                raise RobotDescriptionError(
                    f"joint '{name}' has the limit {key}='{text}'", "a number"
                ) from error
    arrays = {key: np.asarray(values) for key, values in rows.items()}
    for key, values in arrays.items():
        values[np.abs(values) >= UNLIMITED] = default[key]
    return JointLimits(**arrays)


def _attach(model: pin.Model, body: Payload) -> None:
    """Add a rigid body to the joint that carries a link."""
    if not model.existFrame(body.link):
        raise RobotDescriptionError(
            f"the payload sits on the link '{body.link}' that the URDF lacks", "a link of the URDF"
        )
    frame = model.frames[model.getFrameId(body.link)]
    ixx, iyy, izz, ixy, ixz, iyz = body.inertia
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    inertia = pin.Inertia(body.mass, np.asarray(body.centre_of_mass), tensor)
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
