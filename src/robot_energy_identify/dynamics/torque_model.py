"""Joint torque of one robot as a sum of parameters: ten of each link, then those of columns.

A column says which joint torque one unit of its parameter makes. Fit, validation and
export take it from here; the model file gets the parameter from the same object.

Parameters are those of a motor as seen at its own joint: with ``C`` the transmission
matrix, motor i turns at ``u_i = w_i / C_ii`` (the joint's own velocity where nothing is
coupled) and its torque ``t_i`` at u acts on joint k with ``C_ik / C_ii t_i``. So wrist
coupling is part of every column, and a motor-side parameter follows by powers of C_ii.

The torque of a counterbalance is linear in two figures (`robot_energy.physics.counterbalance`). A
lever spring has the form of a weight, and a torsion spring over a small angle that of a weight and
an offset: only motion that shows the inertia of the bodies, or a wide range, separates them. So
an entry is written where its figures are significant next to those of the bodies, and where
torque is predicted better on parts of the recording that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Annotated, Any, Literal

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.model.figure import Figure, PositiveFigure, Tag
from robot_energy.model.friction_laws import ConstantLaw
from robot_energy.model.joint import GasSpring, Joint, LeverSpring, Stribeck, TorsionSpring
from robot_energy.physics.counterbalance import AnySpring, torque_columns
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_identify.bounds import at_bound
from robot_energy_identify.dynamics.base_parameters import BaseParameters, base_parameters
from robot_energy_plan.motion import Trajectory

LINK_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
SAMPLES = 200  # random motions that show the structure of the robot
BOUND = 1e-3  # standard deviations: below, the solver has stopped at 0 but for rounding
SMOOTH_VELOCITY = 0.01  # at the joint [rad/s] or [m/s]


class Estimate(Described):
    """One identified number on its way into a model file."""

    value: Annotated[float, "At the joint, in the column's unit."]
    std: Annotated[float | None, "Same unit; None where it is not known on its own."]
    tag: Tag
    source: str

    def figure(self, factor: float) -> PositiveFigure:
        """Return it as an entry of a model file; at the bound where it is not above 0.

        Args:
            factor: From the column's unit to that of the entry. [-]
        """
        if not self.value > BOUND * (self.std or 0.0):
            return at_bound(self.source, max(self.value * factor, 0.0))
        std = None if self.std is None else self.std * factor
        return PositiveFigure(value=self.value * factor, std=std, tag=self.tag, source=self.source)


class ParameterColumn(Described):
    """One kind of column: one parameter per motor, coupled joint, torque sensor or counterbalance.

    A motor that another joint turns along (coupled wrist) has friction and inertia of its own
    speed; the last gear and the bearings behind it have those of the joint. Model files know
    friction of motors only.
    """

    kind: str
    unit: str
    follows: Literal["joint_position", "joint_velocity", "joint_acceleration"] = "joint_velocity"
    shape: Annotated[
        Callable[[Float], Float],
        "Torque per unit of the parameter at these values, shape (N, K) to (N, K).",
    ] = np.asarray
    owner: Literal["motor", "coupled_joint", "sensor", "counterbalance"] = "motor"
    written: Annotated[
        Callable[[Joint, float, Estimate], Joint] | None,
        "Puts a parameter into the entry of a model file: entry, gear ratio [-], estimate; None "
        "where such a file has no place for it.",
    ] = None
    at: Annotated[tuple[int, ...], "Joints with a counterbalance, which own it."] = ()

    @property
    def positive(self) -> bool:
        """Whether physics forbids a negative parameter."""
        return self.owner == "motor"

    def joints(self, transmission: Float) -> list[int]:
        """Return the motor or joint that each parameter belongs to.

        Args:
            transmission: Motor turns per joint turn, shape (n, n). [-]
        """
        if self.owner == "counterbalance":
            return list(self.at)
        if self.owner != "coupled_joint":
            return list(range(len(transmission)))
        others = transmission - np.diag(np.diagonal(transmission))
        return [int(joint) for joint in np.flatnonzero(np.abs(others).sum(axis=1) > 0)]

    def torque(self, motion: Trajectory, transmission: Float) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, K).

        Args:
            transmission: Motor turns per joint turn, shape (n, n). [-]
        """
        values: Float = getattr(motion, self.follows)
        if self.owner == "motor":
            share = transmission / np.diagonal(transmission)[:, None]
            return self.shape(values @ share.T)[:, None, :] * share.T
        own = np.ones_like(values) if self.owner == "sensor" else self.shape(values)
        joints = self.joints(transmission)
        result = np.zeros((*own.shape, len(joints)))
        result[:, joints, np.arange(len(joints))] = own[:, joints]
        return result


def _write_rotor(joint: Joint, ratio: float, estimate: Estimate) -> Joint:
    return joint.model_copy(update={"rotor_inertia": estimate.figure(ratio**-2)})


def _write_viscous(joint: Joint, ratio: float, estimate: Estimate) -> Joint:
    """Set a law that knows no temperature and is in proportion to the speed."""
    law = ConstantLaw(law="constant", viscous=estimate.figure(ratio**-2))
    return _with_friction(joint, viscous=law, viscous_exponent=None)


def _write_coulomb(smooth_velocity: float, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
    smooth = _setting(smooth_velocity * abs(ratio))
    coulomb = estimate.figure(1.0 / abs(ratio))
    return _with_friction(joint, coulomb=coulomb, smooth_velocity=smooth)


def _write_stribeck(velocity: float, joint: Joint, ratio: float, estimate: Estimate) -> Joint:
    torque, where = estimate.figure(1.0 / abs(ratio)), _setting(velocity * abs(ratio))
    return _with_friction(joint, stribeck=Stribeck(torque=torque, velocity=where, exponent=2.0))


def standard_columns(
    smooth_velocity: float = SMOOTH_VELOCITY, stribeck_velocity: float | None = None
) -> tuple[ParameterColumn, ...]:
    """Return the columns of a usual robot, in the order of a table.

    Args:
        smooth_velocity: Of the smooth sign ``tanh(u / smooth_velocity)`` of Coulomb friction, at
            the joint. [rad/s] or [m/s]
        stribeck_velocity: Adds a Stribeck term, extra Coulomb torque near standstill,
            ``tanh(u / smooth_velocity) exp(-(|u| / stribeck_velocity)^2)``. [rad/s] or [m/s]

    Returns:
        The columns; those of coupled joints have parameters where there are such joints. An
        offset is the constant error of a measured torque: not of the robot.
    """
    inertia, viscous, coulomb = "kg m^2", "N m s/rad", "N m"

    def sign(velocity: Float) -> Float:
        return np.tanh(velocity / smooth_velocity)

    columns = [
        ParameterColumn("viscous", viscous, written=_write_viscous),
        ParameterColumn(
            "coulomb", coulomb, shape=sign, written=partial(_write_coulomb, smooth_velocity)
        ),
        ParameterColumn("rotor_inertia", inertia, "joint_acceleration", written=_write_rotor),
        ParameterColumn("offset", coulomb, owner="sensor"),
    ]
    if stribeck_velocity is not None:
        columns.append(
            ParameterColumn(
                "stribeck",
                coulomb,
                shape=lambda u: sign(u) * np.exp(-((u / stribeck_velocity) ** 2)),
                written=partial(_write_stribeck, stribeck_velocity),
            )
        )
    return (
        *columns,
        ParameterColumn("joint_viscous", viscous, owner="coupled_joint"),
        ParameterColumn("joint_coulomb", coulomb, shape=sign, owner="coupled_joint"),
        ParameterColumn("joint_inertia", inertia, "joint_acceleration", owner="coupled_joint"),
    )


def _setting(value: float) -> PositiveFigure:
    return PositiveFigure(value=value, tag="assumed", source="setting of the fit")


def _with_friction(joint: Joint, **entries: Any) -> Joint:
    return joint.model_copy(update={"friction": joint.friction.model_copy(update=entries)})


class TorqueModel(Described):
    """``joint_torque = regressor(motion) . parameters`` (paper B, eq. 18)."""

    robot: Robot
    transmission: Annotated[Float, "Motor turns per joint turn, shape (n, n). [-]"]
    columns: tuple[ParameterColumn, ...]

    @classmethod
    def from_model(cls, model: RobotModel, columns: Sequence[ParameterColumn]) -> TorqueModel:
        transmission = Drivetrain.from_model(model).transmission
        return cls(Robot.from_model(model), transmission, tuple(columns))

    @property
    def n_links(self) -> int:
        return 10 * self.robot.n_joints

    @cached_property
    def extra(self) -> list[tuple[ParameterColumn, int, str]]:
        """Column, motor or joint, and name of every parameter behind those of the links."""
        names = self.robot.joint_names
        return [
            (column, owner, f"{column.kind} {names[owner]}")
            for column in self.columns
            for owner in column.joints(self.transmission)
        ]

    @cached_property
    def names(self) -> tuple[str, ...]:
        joints = self.robot.joint_names  # the links in the order of `Robot.link_parameters`
        links = [f"{parameter} {joint}" for joint in joints for parameter in LINK_PARAMETERS]
        return (*links, *(name for _, _, name in self.extra))

    def regressor(self, motion: Trajectory) -> Float:
        """Return joint torque per unit of each parameter, shape (N, n, P)."""
        links = self.robot.torque_regressor(
            motion.joint_position, motion.joint_velocity, motion.joint_acceleration
        )
        columns = [column.torque(motion, self.transmission) for column in self.columns]
        return np.concatenate([links, *columns], axis=2)

    def payload_torque(self, motion: Trajectory, regressor: Float) -> Float:
        """Return the joint torque of the payload, which is known, shape (N, n). [N m] or [N]

        Args:
            regressor: Of the same samples, shape (N, n, P): joint torque over each parameter.
                [N m] or [N], over the unit of the parameter
        """
        whole = self.robot.joint_torque(
            motion.joint_position, motion.joint_velocity, motion.joint_acceleration
        )
        return whole - regressor[:, :, : self.n_links] @ self.robot.link_parameters

    def structure(self) -> BaseParameters:
        """Return the groups of parameters that any motion can determine."""
        random = np.random.default_rng(0)
        lower = np.maximum(self.robot.limits.lower, -np.pi)
        upper = np.minimum(self.robot.limits.upper, np.pi)
        shape = (SAMPLES, self.robot.n_joints)
        motion = Trajectory(random.uniform(lower, upper, shape), *random.normal(size=(2, *shape)))
        return base_parameters(self.regressor(motion).reshape(-1, len(self.names)), self.names)

    def without_offsets(self, values: Float) -> Float:
        """Return parameters as a model file holds them: offsets of the sensors are 0.

        Args:
            values: Shape (P,), in the unit of each. [-]
        """
        offsets = [column.owner == "sensor" for column, _, _ in self.extra]
        return np.where([*[False] * self.n_links, *offsets], 0.0, values)


SIGNIFICANT = 13.8  # of chi squared with two degrees of freedom: one chance in a thousand
NAMES = {
    "spring": (("stiffness", "N m/rad"), ("rest_torque", "N m")),
    "lever": (("moment_cosine", "N m"), ("moment_sine", "N m")),
    "gas_spring": (("gas_force", "N"), ("gas_rate", "N/m")),
}


STRENGTH = {"spring": "stiffness", "lever": "moment", "gas_spring": "force"}


def open_springs(model: RobotModel) -> dict[int, AnySpring]:
    """Return counterbalances of assumed strength, which recordings are to determine, by joint."""
    return {
        joint: entry
        for joint, entry in enumerate(one.counterbalance for one in model.joints)
        if entry is not None and getattr(entry, STRENGTH[entry.kind]).tag == "assumed"
    }


def spring_columns(springs: Mapping[int, AnySpring]) -> tuple[ParameterColumn, ...]:
    return tuple(
        ParameterColumn(
            kind,
            unit,
            "joint_position",
            partial(_shape, entry, place),
            "counterbalance",
            partial(WRITTEN[entry.kind], entry, place),
            (joint,),
        )
        for joint, entry in springs.items()
        for place, (kind, unit) in enumerate(NAMES[entry.kind])
    )


def _shape(entry: AnySpring, place: int, position: Float) -> Float:
    return torque_columns(entry, position)[..., place]


def _write_spring(
    entry: TorsionSpring, place: int, joint: Joint, ratio: float, estimate: Estimate
) -> Joint:
    if place == 0:
        return _with(joint, entry, stiffness=estimate.figure(1.0), rest=entry.rest)
    found = joint.counterbalance
    stiffness = found.stiffness.value if isinstance(found, TorsionSpring) else 0.0
    if stiffness == 0.0:
        return joint
    return _with(joint, found, rest=_figure(estimate, -1.0 / stiffness))


def _write_lever(
    entry: LeverSpring, place: int, joint: Joint, ratio: float, estimate: Estimate
) -> Joint:
    """A cos q + B sin q: moment and angle are the polar form."""
    if place == 0:
        size = replace(estimate, value=abs(estimate.value)).figure(1.0)
        angle = Figure(value=0.0 if estimate.value >= 0.0 else np.pi, tag=estimate.tag)
        return _with(joint, entry, moment=size, angle=angle)
    first = joint.counterbalance
    if not isinstance(first, LeverSpring):
        return joint
    a = first.moment.value * float(np.cos(first.angle.value))
    moment = float(np.hypot(a, estimate.value))
    std: list[float | None] = [None, None]
    if first.moment.std is not None and estimate.std is not None and moment > 0.0:
        own, other = first.moment.std, estimate.std
        std[0] = float(np.hypot(a * own, estimate.value * other)) / moment
        std[1] = float(np.hypot(estimate.value * own, a * other)) / moment**2
    angle = float(np.arctan2(estimate.value, a))
    return _with(
        joint,
        first,
        moment=PositiveFigure(value=moment, std=std[0], tag=estimate.tag, source=estimate.source),
        angle=Figure(value=angle, std=std[1], tag=estimate.tag, source=estimate.source),
    )


def _write_gas(
    entry: GasSpring, place: int, joint: Joint, ratio: float, estimate: Estimate
) -> Joint:
    before = joint.counterbalance if place else entry
    return _with(joint, before or entry, **{("force", "rate")[place]: estimate.figure(1.0)})


WRITTEN: dict[str, Callable[..., Joint]] = {
    "spring": _write_spring, "lever": _write_lever, "gas_spring": _write_gas,
}  # fmt: skip


def _figure(estimate: Estimate, factor: float) -> Figure:
    std = None if estimate.std is None else estimate.std * abs(factor)
    value = estimate.value * factor
    return Figure(value=value, std=std, tag=estimate.tag, source=estimate.source)


def _with(joint: Joint, entry: AnySpring | None, **figures: Figure) -> Joint:
    changed = None if entry is None else entry.model_copy(update=figures)
    return joint.model_copy(update={"counterbalance": changed})
