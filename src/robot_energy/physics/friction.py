"""Friction laws over speed, load and temperature, motor side.

``motor_torque_friction = fc sgn(w) + fv(T) w`` (paper A, eq. 3 and 8): Coulomb friction
does not depend on temperature, viscous friction does. Friction torque is what the
drive must add, so it has the sign of the velocity and its power is never negative.

Optional terms, off unless the model file has them: the smooth sign ``tanh(w/w0)``, a Stribeck
term, Coulomb friction that grows with the load, up to a saturation or without, and a viscous
exponent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import KindError
from robot_energy.model.figure import PositiveFigure, tag_of
from robot_energy.model.friction_laws import (
    FRICTION_LAWS,
    ConstantLaw,
    ExponentialLaw,
    LawEntry,
    TableLaw,
)
from robot_energy.model.joint import JointFriction
from robot_energy.model.schema import RobotModel
from robot_energy.physics.equations import (
    constant_viscous,
    exponential_viscous,
    friction_torque,
    table_curve,
    viscous_velocity,
)
from robot_energy.timeline.blocks import PLAUSIBLE_DEGC, Float

SPREAD_POINTS = 101  # of a law, over its range
REACH_POINTS = 401  # between an edge of the fitted range and the end of what motors can read


@dataclass(frozen=True)
class ViscousLaw:
    """fv(T) of one axis with its range of validity.

    Attributes:
        lower_degc: Lower end of the fitted range. [degC]
        formula: fv of temperatures in ``used_degc``. [N m s/rad]
        deviation: Standard deviation of ``formula`` at temperatures in ``known_degc``; None for
            unknown. [N m s/rad]
        used_degc: Range in which ``formula`` is used; beyond it the value at its ends is held.
            None for the fitted range. [degC]
        known_degc: Range for which ``deviation`` was made; None for the fitted range. [degC]
    """

    lower_degc: float
    upper_degc: float
    formula: Callable[[Float], Float]
    deviation: Callable[[Float], Float] | None
    used_degc: tuple[float, float] | None = None
    known_degc: tuple[float, float] | None = None

    @property
    def used(self) -> tuple[float, float]:
        """Range in which ``formula`` is used. [degC]"""
        return self.used_degc or (self.lower_degc, self.upper_degc)

    def viscous(self, motor_temperature_degc: Float | float) -> Float:
        """Return the viscous coefficient, motor side; NaN where the temperature is. [N m s/rad]

        Args:
            motor_temperature_degc: Any shape. [degC]
        """
        values = np.asarray(motor_temperature_degc, dtype=np.float64)
        return self.formula(np.clip(values, *self.used))

    def std(self, motor_temperature_degc: Float | float) -> Float:
        """Return the standard deviation of the viscous coefficient at a known temperature.

        Where ``deviation`` is known it is that, outside the fitted range never less than at its
        edge. Further out the change that is to be expected there is added,
        ``sqrt(std^2 + (slope (T - end))^2)`` with the slope of fv at the end of that range,
        and at most fv itself where friction falls.

        Args:
            motor_temperature_degc: Any shape. [degC]

        Returns:
            Same shape, motor side; NaN where the law has none and where the temperature is
            NaN. [N m s/rad]
        """
        values = np.asarray(motor_temperature_degc, dtype=np.float64)
        if self.deviation is None:
            return np.full_like(values, np.nan)
        finite = np.isfinite(values)
        degc = np.where(finite, values, 0.0)
        low, high = self.known_degc or (self.lower_degc, self.upper_degc)
        known = np.clip(degc, low, high)
        fitted = np.clip(degc, self.lower_degc, self.upper_degc)
        own = np.maximum(self.deviation(known), self.deviation(fitted))
        end = self.formula(known)
        slope = (self.formula(np.clip(known + 1.0, low, high)) - end) + (
            end - self.formula(np.clip(known - 1.0, low, high))
        )
        change = np.maximum(slope * (degc - known), -end)
        return np.where(finite, np.hypot(own, change), np.nan)

    def spread(self, assumed_degc: float) -> float:
        """Return what an unknown temperature adds to the deviation; 0 without a range. [N m s/rad]

        The true temperature is taken to lie anywhere in the fitted range, each value as
        likely as another: ``sqrt(mean((fv(T) - fv(assumed))^2))``.

        Args:
            assumed_degc: Used instead of a measurement. [degC]
        """
        if not np.isfinite([self.lower_degc, self.upper_degc]).all():
            return 0.0
        span = np.linspace(self.lower_degc, self.upper_degc, SPREAD_POINTS)
        off = (self.viscous(span) - self.viscous(assumed_degc)) ** 2
        return float(np.sqrt(np.trapezoid(off, span) / (self.upper_degc - self.lower_degc)))

    def extrapolated(self, motor_temperature_degc: Float | float) -> NDArray[np.bool_]:
        """Whether a temperature is outside the fitted range, same shape.

        Args:
            motor_temperature_degc: Any shape (...). [degC]
        """
        values = np.asarray(motor_temperature_degc, dtype=np.float64)
        return (values < self.lower_degc) | (values > self.upper_degc)


def viscous_law(entry: LawEntry) -> ViscousLaw:
    """Return the law that a model file names."""
    kind = FRICTION_LAWS[entry.law]
    if kind.curve is None:
        raise KindError(f"the friction law '{kind.name}' has no curve", "a `ViscousLaw`")
    return kind.curve(entry)


def constant_law(entry: ConstantLaw) -> ViscousLaw:
    """Return one viscous coefficient; outside a fitted range its deviation is not known."""
    lower, upper = entry.fitted_degc or (-np.inf, np.inf)
    formula, std = partial(constant_viscous, viscous=entry.viscous.value), entry.viscous.std
    if std is None or entry.fitted_degc is None:
        return ViscousLaw(lower, upper, formula, _level(std))
    deviation = partial(_within, value=std, lower=lower, upper=upper)
    return ViscousLaw(lower, upper, formula, deviation, known_degc=(-np.inf, np.inf))


def exponential_law(entry: ExponentialLaw) -> ViscousLaw:
    """Return ``a + b exp(-T/c)``, as far outside the fitted range as the entry says."""
    a, b, c = entry.a.value, entry.b.value, entry.c.value
    lower, upper = entry.fitted_degc
    formula = partial(exponential_viscous, a=a, b=b, c=c)
    if entry.covariance is None:
        used = PLAUSIBLE_DEGC if entry.outside == "extend" else None
        return ViscousLaw(lower, upper, formula, _level(entry.std), used)
    covariance = np.array(entry.covariance)

    def reach(edge: float, end: float) -> float:
        """The last temperature to which the change from the edge is larger than its deviation."""
        degc = np.linspace(edge, end, REACH_POINTS)
        change = np.abs(formula(degc) - formula(np.array(edge)))
        along = _slopes(degc, b, c) - _slopes(np.array(edge), b, c)
        sure = change > _std_along(along, covariance)
        return float(degc[int(np.argmin(np.append(sure[1:], False)))])

    ends = min(PLAUSIBLE_DEGC[0], lower), max(PLAUSIBLE_DEGC[1], upper)
    match entry.outside:
        case "hold":
            used = (lower, upper)
        case "extend":
            used = ends
        case _:
            with np.errstate(over="ignore", invalid="ignore"):  # of a tiny c: nothing is sure
                used = (reach(lower, ends[0]), reach(upper, ends[1]))
    deviation = partial(_exponential_std, b=b, c=c, covariance=covariance)
    return ViscousLaw(lower, upper, formula, deviation, used, used)


def _slopes(degc: Float, b: float, c: float) -> Float:
    """Derivatives of fv by a, b and c, shape (..., 3)."""
    decay = np.exp(-degc / c)
    return np.stack([np.ones_like(decay), decay, b * decay * degc / c**2], axis=-1)


def _std_along(slopes: Float, covariance: Float) -> Float:
    return np.sqrt(np.maximum(((slopes @ covariance) * slopes).sum(axis=-1), 0.0))


def _exponential_std(degc: Float, b: float, c: float, covariance: Float) -> Float:
    return _std_along(_slopes(degc, b, c), covariance)


def table_law(entry: TableLaw) -> ViscousLaw:
    """Return the monotone curve through identified points."""
    points, std = entry.motor_temperature_degc, entry.std
    deviation = None if std is None else partial(np.interp, xp=points, fp=std)
    return ViscousLaw(points[0], points[-1], table_curve(points, entry.viscous), deviation)


class FrictionModel:
    """Friction of all axes of one robot.

    Attributes:
        torque: `robot_energy.physics.equations.friction_torque` with the terms of these axes, which
            takes ``motor_torque_rigid`` and ``standing`` by name.
    """

    def __init__(self, entries: list[JointFriction]) -> None:
        self.laws = [viscous_law(entry.viscous) for entry in entries]
        self._lower_degc = np.asarray([law.lower_degc for law in self.laws])
        self._upper_degc = np.asarray([law.upper_degc for law in self.laws])
        self._used_degc = np.asarray([law.used for law in self.laws]).T
        self.coulomb = np.asarray([entry.coulomb.value for entry in entries])
        stribeck = [entry.stribeck for entry in entries]
        terms = {
            "load_coulomb": _values([entry.load_coulomb for entry in entries]),
            "smooth_velocity": _values([entry.smooth_velocity for entry in entries]),
            "stribeck_torque": _values([s.torque if s else None for s in stribeck]),
        }
        self._terms = {name: values for name, values in terms.items() if values.any()}
        limits = [entry.load_saturation for entry in entries]
        if any(limits) and "load_coulomb" in self._terms:
            self._terms["load_saturation"] = np.asarray(
                [one.value if one else np.inf for one in limits]
            )
        bent = [entry.viscous_exponent for entry in entries]
        if any(bent):
            self._terms["viscous_exponent"], self._terms["exponent_velocity"] = np.asarray(
                [(one.exponent.value, one.velocity.value) if one else (1.0, 1.0) for one in bent]
            ).T
        if "stribeck_torque" in self._terms:
            self._terms["stribeck_velocity"], self._terms["stribeck_exponent"] = np.asarray(
                [(s.velocity.value, s.exponent) if s else (1.0, 1.0) for s in stribeck]
            ).T
        self.torque = partial(friction_torque, **self._terms)

    @classmethod
    def from_model(cls, model: RobotModel) -> FrictionModel:
        """Return the friction that a model file describes, joints in model order."""
        return cls([joint.friction for joint in model.joints])

    def viscous(self, motor_temperature_degc: Float) -> Float:
        """Return viscous coefficients, motor side; NaN where the temperature is. [N m s/rad]

        Args:
            motor_temperature_degc: Shape (..., n). [degC]
        """
        inside = np.clip(motor_temperature_degc, *self._used_degc)
        columns = [law.formula(inside[..., i]) for i, law in enumerate(self.laws)]
        return np.stack(columns, axis=-1)

    def viscous_std(self, motor_temperature_degc: Float) -> Float:
        """Return deviations as `ViscousLaw.std`, same shape; NaN: not known. [N m s/rad]

        Args:
            motor_temperature_degc: Shape (..., n). [degC]
        """
        columns = [law.std(motor_temperature_degc[..., i]) for i, law in enumerate(self.laws)]
        return np.stack(columns, axis=-1)

    def viscous_spread(self, assumed_degc: float) -> Float:
        """Return what an unknown temperature adds, see `ViscousLaw.spread`, shape (n,). [N m s/rad]

        Args:
            assumed_degc: Used for every motor. [degC]
        """
        return np.asarray([law.spread(assumed_degc) for law in self.laws])

    def extrapolated(self, motor_temperature_degc: Float) -> NDArray[np.bool_]:
        """Whether a law is used outside its fitted range, shape (..., n).

        Args:
            motor_temperature_degc: Shape (..., n). [degC]
        """
        below = motor_temperature_degc < self._lower_degc
        return below | (motor_temperature_degc > self._upper_degc)

    def viscous_velocity(self, motor_velocity: Float) -> Float:
        """Return what viscous friction is in proportion to: w without a viscous exponent. [rad/s]

        Args:
            motor_velocity: w, shape (N, n). [rad/s]
        """
        if "viscous_exponent" not in self._terms:
            return motor_velocity
        bent = self._terms["viscous_exponent"], self._terms["exponent_velocity"]
        return viscous_velocity(motor_velocity, *bent)

    def loaded_coulomb(self, motor_torque_rigid: Float) -> Float:
        """Return the Coulomb torque under a load, ``fc + load min(|tau|, taus)``. [N m]

        Args:
            motor_torque_rigid: tau, shape (N, n). [N m]
        """
        load = self._terms.get("load_coulomb")
        if load is None:
            return self.coulomb
        limit = self._terms.get("load_saturation", np.inf)
        return self.coulomb + load * np.minimum(np.abs(motor_torque_rigid), limit)


def with_fixed_friction(
    model: RobotModel, motor_temperature_degc: float, viscous_std: Float | None = None
) -> RobotModel:
    """Return a model whose friction stays at one temperature.

    This is the state of the art that paper A improves upon: coefficients of one
    operating point, used at every temperature. They are known as the laws are.

    Args:
        motor_temperature_degc: The operating point. [degC]
        viscous_std: Standard deviations of the coefficients, motor side, shape (n,); None for
            those that the laws state. [N m s/rad]
    """
    joints = list(model.joints)
    for index, joint in enumerate(joints):
        entry = joint.friction.viscous
        curve = viscous_law(entry)
        std = curve.std(motor_temperature_degc) if viscous_std is None else viscous_std[index]
        figure = PositiveFigure(
            value=float(curve.viscous(motor_temperature_degc)),
            tag=tag_of(entry),
            std=float(std) if np.isfinite(std) else None,
            source=f"law at {motor_temperature_degc:g} degC",
        )
        law = ConstantLaw(law="constant", viscous=figure)
        friction = joint.friction.model_copy(update={"viscous": law})
        joints[index] = joint.model_copy(update={"friction": friction})
    return model.changed(joints=joints, covariance=model.covariance)  # in deviations of the law


def _level(std: float | None) -> Callable[[Float], Float] | None:
    """The same deviation at every temperature; None for none."""
    return None if std is None else partial(_same, value=std)


def _within(degc: Float, value: float, lower: float, upper: float) -> Float:
    return np.where((degc >= lower) & (degc <= upper), value, np.nan)


def _same(degc: Float, value: float) -> Float:
    return np.full(np.shape(degc), value)


def _values(figures: list[PositiveFigure | None]) -> Float:
    return np.asarray([0.0 if figure is None else figure.value for figure in figures])
