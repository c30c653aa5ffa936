"""Rigid-body dynamics of one robot in the joint order of its model file.

Its models of Pinocchio come from `pinocchio_model`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from robot_energy.foundation.errors import RobotDescriptionError, check_shape
from robot_energy.model.payload import Payload
from robot_energy.model.schema import RobotModel
from robot_energy.physics import kernels
from robot_energy.physics.counterbalance import AnySpring, add_counterbalance
from robot_energy.physics.pinocchio_model import (
    attach,
    check_mass,
    frame_of,
    full_model,
    kernel_table,
    reduced,
)
from robot_energy.physics.urdf.checks import (
    for_dynamics,
    joint_limits,
    moved_mass,
    parse,
    take_inventory,
)
from robot_energy.timeline.blocks import Float


class Robot:
    """Inverse dynamics by the recursive Newton-Euler algorithm, payload included.

    Joints of the URDF that the model does not name are locked at zero; they are listed
    in ``inventory``.

    Args:
        urdf_xml: Text of the URDF. Meshes are never opened.
        joint_names: Modelled joints, in the order of every array.
        gravity: In the base frame. [m/s^2]
        massless_links: Links that may move without inertia, on purpose.
        counterbalance: Springs at the joints, one entry per joint; empty for none.
    """

    def __init__(
        self,
        urdf_xml: str,
        joint_names: Sequence[str],
        gravity: Sequence[float] = (0.0, 0.0, -9.80665),
        payload: Sequence[Payload] = (),
        massless_links: Sequence[str] = (),
        counterbalance: Sequence[AnySpring | None] = (),
    ) -> None:
        self.counterbalance = tuple(counterbalance)
        root = parse(urdf_xml)
        self._given = (urdf_xml, tuple(gravity), tuple(massless_links))
        self.joint_names = tuple(joint_names)
        self.n_joints = len(self.joint_names)
        self.inventory = take_inventory(root, self.joint_names, massless_links)
        self.limits = joint_limits(root, self.joint_names)
        self._full = full_model(for_dynamics(root))
        self._unloaded = reduced(self._full, self.inventory.locked_joints)
        check_mass(self._unloaded, self.joint_names, moved_mass(root, self.joint_names))
        self._unloaded.gravity.linear = np.asarray(gravity, dtype=np.float64)
        self._bodies = [self._unloaded.getJointId(name) for name in self.joint_names]
        indices = [self._unloaded.joints[body].idx_v for body in self._bodies]
        self._to_model = np.argsort(np.asarray(indices, dtype=np.int64))
        self._from_model = np.asarray(indices, dtype=np.int64)
        self._same_order = bool(np.array_equal(indices, np.arange(self.n_joints)))
        self._load(payload)

    def _load(self, payload: Sequence[Payload]) -> None:
        """Carry these bodies and no others."""
        self.payload, self._model = tuple(payload), self._unloaded
        self.payload_mass = float(sum(body.mass for body in payload))
        if payload:
            loaded = pin.Model(self._full)
            for body in payload:
                attach(loaded, body)
            self._model = reduced(loaded, self.inventory.locked_joints)
            self._model.gravity.linear = self._unloaded.gravity.linear
        self._begin()
        self._table = kernel_table(self._model) if kernels.compiled is not None else None

    def _begin(self) -> None:
        """Make room of its own to compute in; models of Pinocchio are only read."""
        self._pool = pin.ModelPool(self._model, 1)
        self._scratch = self._model.createData()

    def _copy(self) -> Robot:
        robot = object.__new__(type(self))
        robot.__dict__.update(self.__dict__)
        return robot

    @classmethod
    def from_model(cls, model: RobotModel) -> Robot:
        """Return the robot that a model file describes, with its payload."""
        robot = _robot_of(
            model.urdf_xml, tuple(model.joint_names), tuple(model.gravity), tuple(model.payload),
            tuple(model.massless_links),
        )._copy()  # fmt: skip
        robot.counterbalance = tuple(joint.counterbalance for joint in model.joints)
        robot._begin()
        return robot

    def __reduce__(self) -> tuple[type[Robot], tuple[Any, ...]]:
        """Pickle what it was built from: Pinocchio's own objects cannot be."""
        urdf_xml, gravity, massless_links = self._given
        springs = self.counterbalance
        return Robot, (
            urdf_xml, self.joint_names, gravity, self.payload, massless_links, springs,
        )  # fmt: skip

    def with_payload(self, payload: Sequence[Payload]) -> Robot:
        """Return this robot with another payload instead of its own."""
        robot = self._copy()  # not read again: what it carries is all that differs
        robot._load(payload)
        return robot

    @property
    def moving_mass(self) -> float:
        """Mass of everything that moves, payload included. [kg]"""
        return float(sum(inertia.mass for inertia in self._model.inertias[1:]))

    def joint_torque(
        self, joint_position: Float, joint_velocity: Float, joint_acceleration: Float
    ) -> Float:
        """Rigid-body joint torque ``M(q) qdd + c(q, qd) + g(q)`` (paper A, eq. 2).

        Counterbalances are in it, ``+ dU/dq``: they carry weight and lose nothing.

        A sample that is not finite gives NaN; samples never influence each other, and
        the result of a sample does not depend on the block it came in.

        Args:
            joint_position: Shape (N, n). [rad] or [m]
            joint_velocity: Shape (N, n). [rad/s] or [m/s]
            joint_acceleration: Shape (N, n). [rad/s^2] or [m/s^2]

        Returns:
            Joint side, without friction and rotor inertia, shape (N, n). [N m] or [N]
        """
        motion, size = (joint_position, joint_velocity, joint_acceleration), len(joint_position)
        if {*map(np.shape, motion)} != {(size, self.n_joints)}:
            self._check(*motion)
        if size == 0:
            return np.empty((0, self.n_joints))
        if kernels.compiled is not None and self._table is not None:
            torque = np.empty((self.n_joints, size)).T
            position, velocity, acceleration = (
                motion if self._same_order else [values[:, self._to_model] for values in motion]
            )
            gravity = np.array(self._model.gravity.linear)
            kernels.compiled.inverse_dynamics(
                self._table, gravity, position, velocity, acceleration, torque
            )
            torque = torque if self._same_order else torque[:, self._from_model]
        else:
            torque = self._parallel_torque(*motion)
        if any(self.counterbalance):
            add_counterbalance(torque, joint_position, self.counterbalance)
        return torque

    def _parallel_torque(self, *motion: Float) -> Float:
        """Return the joint torque by Pinocchio, from position, velocity and acceleration."""
        columns = [
            (values if self._same_order else values[:, self._to_model]).T for values in motion
        ]
        torque = pin.rneaInParallel(1, self._pool, *map(np.asfortranarray, columns))
        torque = torque.reshape(self.n_joints, len(motion[0]))  # one sample comes back flat
        if not self._same_order:
            torque = torque[self._from_model]
        return np.ascontiguousarray(torque).T

    @property
    def link_parameters(self) -> Float:
        """Inertial parameters of the moving bodies, without payload, shape (10 n,).

        Ten per joint in model order, of all that moves with it as one body: m [kg]; m cx,
        m cy, m cz [kg m]; Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg m^2], in the frame of the joint
        and about its origin (not about the centre of mass), as Pinocchio orders them.
        """
        rows = [self._unloaded.inertias[body].toDynamicParameters() for body in self._bodies]
        return np.concatenate(rows)

    def torque_regressor(
        self, joint_position: Float, joint_velocity: Float, joint_acceleration: Float
    ) -> Float:
        """Return W of ``M(q) qdd + c(q, qd) + g(q) = W link_parameters``, shape (N, n, 10 n).

        Args:
            joint_position: Shape (N, n). [rad] or [m]
            joint_velocity: Shape (N, n). [rad/s] or [m/s]
            joint_acceleration: Shape (N, n). [rad/s^2] or [m/s^2]
        """
        n_samples, n_joints = self._check(joint_position, joint_velocity, joint_acceleration)
        result = np.empty((n_samples, n_joints, 10 * n_joints))
        data = self._unloaded.createData()
        q, v, a = (
            values if self._same_order else np.ascontiguousarray(values[:, self._to_model])
            for values in (joint_position, joint_velocity, joint_acceleration)
        )
        for row in range(n_samples):
            result[row] = pin.computeJointTorqueRegressor(
                self._unloaded, data, q[row], v[row], a[row]
            )
        if self._same_order:
            return result
        columns = np.concatenate([np.arange(10) + 10 * (body - 1) for body in self._bodies])
        return np.ascontiguousarray(result[:, self._from_model][:, :, columns])

    def _check(
        self, joint_position: Float, joint_velocity: Float, joint_acceleration: Float
    ) -> tuple[int, int]:
        """Return the common shape (N, n) of a motion."""
        shape = (len(joint_position), self.n_joints)
        check_shape("joint_position", joint_position.shape, shape)
        check_shape("joint_velocity", joint_velocity.shape, shape)
        check_shape("joint_acceleration", joint_acceleration.shape, shape)
        return shape

    def has_link(self, link: str) -> bool:
        """Whether the URDF has a link of that name."""
        return bool(self._model.existFrame(frame_of(link), pin.FrameType.BODY))

    def link_position(self, joint_position: Float, link: str) -> Float:
        """Return where a link's frame is in the base frame at one configuration, shape (3,). [m]

        Args:
            joint_position: Shape (n,). [rad] or [m]
        """
        return self.link_pose(joint_position, link)[0]

    def link_pose(self, joint_position: Float, link: str) -> tuple[Float, Float]:
        """Pose of a link's frame in the base frame at one configuration.

        Args:
            joint_position: Shape (n,). [rad] or [m]

        Returns:
            Position, shape (3,) [m], and rotation, shape (3, 3).
        """
        data, frame = self._placed(joint_position, link, jacobian=False)
        return np.array(data.oMf[frame].translation), np.array(data.oMf[frame].rotation)

    def link_jacobian(self, joint_position: Float, link: str) -> tuple[Float, Float, Float]:
        """Pose of a link's frame, and how it moves with the joints, at one configuration.

        Args:
            joint_position: Shape (n,). [rad] or [m]

        Returns:
            Position, shape (3,) [m]; rotation, shape (3, 3); Jacobian in base axes, shape
            (6, n): velocity of the frame's origin, then angular velocity, per joint velocity.
        """
        data, frame = self._placed(joint_position, link, jacobian=True)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = pin.getFrameJacobian(self._model, data, frame, axes)
        place = data.oMf[frame]
        return (
            np.array(place.translation),
            np.array(place.rotation),
            np.ascontiguousarray(jacobian[:, self._from_model]),
        )

    def joint_origins(self, joint_position: Float) -> Float:
        """Return the origins of the joint frames in the base frame, model order, shape (n, 3). [m]

        Args:
            joint_position: Shape (n,). [rad] or [m]
        """
        data = self._model.createData()
        pin.forwardKinematics(self._model, data, np.asarray(joint_position)[self._to_model])
        return np.array([data.oMi[body].translation for body in self._bodies])

    def _placed(self, joint_position: Float, link: str, *, jacobian: bool) -> tuple[pin.Data, int]:
        if not self.has_link(link):
            raise RobotDescriptionError(f"the URDF has no link '{link}'", "a link of the URDF")
        data = self._scratch
        q = np.asarray(joint_position, dtype=np.float64)[self._to_model]
        if jacobian:
            pin.computeJointJacobians(self._model, data, q)
        else:
            pin.forwardKinematics(self._model, data, q)
        frame = int(self._model.getFrameId(frame_of(link), pin.FrameType.BODY))
        pin.updateFramePlacement(self._model, data, frame)
        return data, frame


@lru_cache(maxsize=16)
def _robot_of(
    urdf_xml: str,
    joint_names: tuple[str, ...],
    gravity: tuple[float, ...],
    payload: tuple[Payload, ...],
    massless_links: tuple[str, ...],
) -> Robot:
    """Read a URDF once for many bags of one robot."""
    return Robot(urdf_xml, joint_names, gravity, payload, massless_links)
