"""Columns of the regressor beside those of the rigid bodies: one definition for all uses.

A column says which joint torque one unit of its parameter makes. Fit, validation and
export take it from here; the model file gets the parameter from the same object.

Parameters are those of a motor as seen at its own joint: with ``C`` the transmission
matrix, motor i turns at ``u_i = w_i / C_ii`` (the joint's own velocity where nothing is
coupled) and its torque ``t_i`` at u acts on joint k with ``C_ik / C_ii t_i``. So wrist
coupling is part of every column, and a motor-side parameter follows by powers of C_ii.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import ModelFileError
from robot_energy.identify.bounds import at_bound
from robot_energy.identify.data.signals import Motion
from robot_energy.model.figure import PositiveFigure, Tag
from robot_energy.model.friction_laws import ConstantLaw
from robot_energy.model.joint import Joint, Stribeck

BOUND = 1e-3  # standard deviations: below, the solver has stopped at 0 but for rounding
SMOOTH_VELOCITY = 0.01  # at the joint [rad/s] or [m/s]


@dataclass(frozen=True)
class Estimate:
    """One identified number on its way into a model file.

    Attributes:
        value: At the joint, in the column's unit.
        std: Same unit; None where it is not known on its own.
        tag: How it is known.
        source: In words.
    """

    value: float
    std: float | None
    tag: Tag
    source: str

    def figure(self, factor: float) -> PositiveFigure:
        """Return it times a factor, as an entry of a model file."""
        if not self.value > BOUND * (self.std or 0.0):
            return at_bound(self.source, max(self.value * factor, 0.0))
        std = None if self.std is None else self.std * factor
        return PositiveFigure(value=self.value * factor, std=std, tag=self.tag, source=self.source)


class Column(ABC):
    """One kind of column, with one parameter per motor unless it says otherwise.

    Attributes:
        kind: Name of the quantity.
        unit: Of the parameter, for revolute joints.
        positive: Whether physics forbids a negative parameter.
        in_model: Whether a model file can hold it, so that the monitor runs it.
    """

    kind: ClassVar[str]
    unit: ClassVar[str]
    positive: ClassVar[bool] = True
    in_model: ClassVar[bool] = True

    def names(self, joint_names: Sequence[str], transmission: Float) -> list[str]:
        """Return the name of each parameter."""
        return [f"{self.kind} {joint_names[joint]}" for joint in self.joints(transmission)]

    def joints(self, transmission: Float) -> list[int]:
        """Return the motor or joint that each parameter belongs to."""
        return list(range(len(transmission)))

    @abstractmethod
    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""

    def write(self, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
        """Return the entry of a model file with the parameter set.

        Args:
            joint: The entry.
            ratio: Gear ratio of the motor. [-]
            estimate: The parameter, at the joint.

        Raises:
            ModelFileError: If a model file has no place for it.
        """
        raise ModelFileError(
            f"a model file has no place for {self.kind}",
            "a parameter of a link, a rotor or friction",
        )


@dataclass(frozen=True)
class RotorInertia(Column):
    """Rotor and fast gear parts; C_ii^2 times the motor-side figure."""

    kind: ClassVar[str] = "rotor_inertia"
    unit: ClassVar[str] = "kg m^2"

    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""
        return _through_motors(lambda u: u, motion.joint_acceleration, transmission)

    def write(self, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
        """Return the entry of a model file with the parameter set."""
        return joint.model_copy(update={"rotor_inertia": estimate.figure(ratio**-2)})


@dataclass(frozen=True)
class Viscous(Column):
    """Friction that grows with speed."""

    kind: ClassVar[str] = "viscous"
    unit: ClassVar[str] = "N m s/rad"

    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""
        return _through_motors(lambda u: u, motion.joint_velocity, transmission)

    def write(self, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
        """Return the entry of a model file with a law that knows no temperature."""
        law = ConstantLaw(law="constant", viscous=estimate.figure(ratio**-2))
        return _with_friction(joint, viscous=law)


@dataclass(frozen=True)
class Coulomb(Column):
    """Friction with the smooth sign ``tanh(u / smooth_velocity)``.

    Attributes:
        smooth_velocity: At the joint. [rad/s] or [m/s]
    """

    smooth_velocity: float = SMOOTH_VELOCITY
    kind: ClassVar[str] = "coulomb"
    unit: ClassVar[str] = "N m"

    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""
        return _through_motors(
            lambda u: np.tanh(u / self.smooth_velocity), motion.joint_velocity, transmission
        )

    def write(self, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
        """Return the entry of a model file with the parameter set."""
        smooth = PositiveFigure(
            value=self.smooth_velocity * abs(ratio), tag="assumed", source="setting of the fit"
        )
        coulomb = estimate.figure(1.0 / abs(ratio))
        return _with_friction(joint, coulomb=coulomb, smooth_velocity=smooth)


@dataclass(frozen=True)
class StribeckFriction(Column):
    """Extra Coulomb torque near standstill, ``tanh(u / smooth) exp(-(|u| / velocity)^2)``.

    Attributes:
        velocity: Where it has fallen to 37 %, at the joint. [rad/s] or [m/s]
        smooth_velocity: As of the Coulomb friction it adds to. [rad/s] or [m/s]
    """

    velocity: float = 0.2
    smooth_velocity: float = SMOOTH_VELOCITY
    kind: ClassVar[str] = "stribeck"
    unit: ClassVar[str] = "N m"

    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""

        def shape(u: Float) -> Float:
            return np.tanh(u / self.smooth_velocity) * np.exp(-((u / self.velocity) ** 2))

        return _through_motors(shape, motion.joint_velocity, transmission)

    def write(self, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
        """Return the entry of a model file with the parameter set."""
        velocity = PositiveFigure(
            value=self.velocity * abs(ratio), tag="assumed", source="setting of the fit"
        )
        term = Stribeck(torque=estimate.figure(1.0 / abs(ratio)), velocity=velocity, exponent=2.0)
        return _with_friction(joint, stribeck=term)


@dataclass(frozen=True)
class Offset(Column):
    """Constant error of a measured torque: of the measurement, not of the robot."""

    kind: ClassVar[str] = "offset"
    unit: ClassVar[str] = "N m"
    positive: ClassVar[bool] = False
    in_model: ClassVar[bool] = False

    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""
        n_samples, n_joints = motion.joint_position.shape
        return np.broadcast_to(np.eye(n_joints), (n_samples, n_joints, n_joints))


class CoupledJoint(Column):
    """What turns with a joint rather than with its motor, where the two differ.

    A motor that another joint turns along (coupled wrist) has friction and inertia of its
    own speed; the last gear and the bearings behind it have those of the joint. Adds one
    parameter for every coupled joint. Model files know friction of motors only.
    """

    positive: ClassVar[bool] = False
    in_model: ClassVar[bool] = False

    def joints(self, transmission: Float) -> list[int]:
        """Return the joints whose motor also turns with another joint."""
        others = transmission - np.diag(np.diagonal(transmission))
        return [int(joint) for joint in np.flatnonzero(np.abs(others).sum(axis=1) > 0)]

    def torque(self, motion: Motion, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K)."""
        joints = self.joints(transmission)
        values = self._own(motion)
        result = np.zeros((*values.shape, len(joints)))
        for place, joint in enumerate(joints):
            result[:, joint, place] = values[:, joint]
        return result

    @abstractmethod
    def _own(self, motion: Motion) -> Float:
        """Torque on each joint from its own motion, shape (N, n)."""


class JointViscous(CoupledJoint):
    """Viscous friction at a coupled joint."""

    kind: ClassVar[str] = "joint_viscous"
    unit: ClassVar[str] = Viscous.unit

    def _own(self, motion: Motion) -> Float:
        return motion.joint_velocity


@dataclass(frozen=True)
class JointCoulomb(CoupledJoint):
    """Coulomb friction at a coupled joint.

    Attributes:
        smooth_velocity: Of the smooth sign. [rad/s] or [m/s]
    """

    smooth_velocity: float = SMOOTH_VELOCITY
    kind: ClassVar[str] = "joint_coulomb"
    unit: ClassVar[str] = Coulomb.unit

    def _own(self, motion: Motion) -> Float:
        return np.tanh(motion.joint_velocity / self.smooth_velocity)


class JointInertia(CoupledJoint):
    """Inertia that turns with a coupled joint, beside its link and its rotor."""

    kind: ClassVar[str] = "joint_inertia"
    unit: ClassVar[str] = RotorInertia.unit

    def _own(self, motion: Motion) -> Float:
        return motion.joint_acceleration


def standard_columns(
    smooth_velocity: float = SMOOTH_VELOCITY,
    stribeck_velocity: float | None = None,
) -> tuple[Column, ...]:
    """Return the columns of a usual robot, in the order of a table.

    Args:
        smooth_velocity: Of the smooth sign, at the joint. [rad/s] or [m/s]
        stribeck_velocity: Adds a Stribeck term with this velocity. [rad/s] or [m/s]

    Returns:
        The columns; those of coupled joints have parameters where there are such joints.
    """
    columns: list[Column] = [Viscous(), Coulomb(smooth_velocity), RotorInertia(), Offset()]
    if stribeck_velocity is not None:
        columns.append(StribeckFriction(stribeck_velocity, smooth_velocity))
    return (*columns, JointViscous(), JointCoulomb(smooth_velocity), JointInertia())


def _through_motors(
    function: Callable[[Float], Float], joint_values: Float, transmission: Float
) -> Float:
    """Evaluate at the motors and spread to the joints, shape (N, n joints, n motors)."""
    share = transmission / np.diagonal(transmission)[:, None]
    values = function(joint_values @ share.T)
    return values[:, None, :] * share.T


def _with_friction(joint: Joint, **entries: Any) -> Joint:
    return joint.model_copy(update={"friction": joint.friction.model_copy(update=entries)})
