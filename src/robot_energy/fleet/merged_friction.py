"""Friction of one joint from the merged sums of many bags, as `identify friction` fits it.

The offset of a bag and what a wrong payload adds to it are fitted in every bag by
itself and taken off. What is left is one fit of ``fc sgn(w) + fv(T) w`` for all robots, with fv
at the nodes of temperature. Deviations come from leaving out one robot after the other (or one
bag, where there are few robots), and from the constant errors of sensors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.blocks import Float, Int
from robot_energy.errors import NotIdentifiableError
from robot_energy.fleet.joint_sums import (
    COLUMNS,
    INERTIA,
    MEASURED,
    MODEL,
    NODES,
    NODES_DEGC,
    OFFSET,
    PAYLOAD,
    RIGID,
    SIGN,
    VISCOUS,
)
from robot_energy.identify.bounds import identified
from robot_energy.identify.friction.friction import MIN_SAMPLES, FrictionFit, points_of
from robot_energy.identify.friction.laws import GRID, MIN_RANGE, MIN_SHARE, SCALES
from robot_energy.identify.stats.cross_validation import (
    HeldOut,
    contiguous_folds,
    folds_by_value,
    simplest,
)
from robot_energy.identify.stats.regression import SCATTER, Fit, student
from robot_energy.identify.stats.systematic import (
    BODIES,
    THERMOMETER,
    TORQUE,
    SensorLimits,
    moved_by,
)
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.friction_laws import ConstantLaw, ExponentialLaw, LawEntry, TableLaw
from robot_energy.physics.friction import viscous_law

MIN_GROUPS = 5  # robots, from which on they are left out one by one
MIN_INDEPENDENT = 0.01  # share of w^2 that its sign does not explain
DAMPING = 1e-6


@dataclass(frozen=True)
class JointBags:
    """Sums of one joint in B bags.

    Attributes:
        name: Of the joint.
        gram: Sums of products, shape (B, COLUMNS, COLUMNS).
        rows: Samples, shape (B,).
        degc: Mean motor temperature, shape (B,). [degC]
        robot: Number of the robot, shape (B,).
        stamp_ns: When the bag begins, shape (B,). [ns]
    """

    name: str
    gram: Float
    rows: Int
    degc: Float
    robot: Int
    stamp_ns: Int

    def only(self, bags: np.ndarray) -> JointBags:
        """Return some of the bags.

        Args:
            bags: Mask or places.
        """
        return JointBags(
            self.name,
            self.gram[bags],
            self.rows[bags],
            self.degc[bags],
            self.robot[bags],
            self.stamp_ns[bags],
        )


@dataclass(frozen=True)
class TorqueScore:
    """Error of a friction model on bags.

    Attributes:
        rms: Of the torque. [N m]
        relative: Norm of the error over that of the friction torque. [-]
        energy_error: Predicted over measured friction energy, less 1. [-]
    """

    rms: float
    relative: float
    energy_error: float


def without_nuisances(gram: Float) -> Float:
    """Return sums from which the offset and the payload of each bag are taken.

    Args:
        gram: Shape (B, COLUMNS, COLUMNS).
    """
    own = [OFFSET, PAYLOAD, INERTIA]
    inner = gram[:, own][:, :, own]
    length = np.sqrt(np.maximum(np.diagonal(inner, axis1=1, axis2=2), 1e-30))
    unit = inner / (length[:, :, None] * length[:, None, :]) + DAMPING * np.eye(len(own))
    right = gram[:, own] / length[:, :, None]
    return gram - np.swapaxes(right, 1, 2) @ np.linalg.solve(unit, right)


@dataclass(frozen=True)
class _Merged:
    """What all fits of a joint share.

    Attributes:
        bags: Its bags.
        whole: Their sums of products, shape (COLUMNS, COLUMNS).
        group: Of bags that are left out together, shape (B,).
        sensors: Standard deviations of constant errors.
        own_bodies: Whether the bodies of the model come from measured torque.
        source: Where the data come from.
    """

    bags: JointBags
    whole: Float
    group: Int
    sensors: SensorLimits
    own_bodies: bool
    source: str

    def fit(self, shape: Float, names: tuple[str, ...]) -> Fit:
        """Return fc and the coefficients of shapes of temperature, with their covariance.

        Args:
            shape: Values at the nodes, shape (NODES, K). [-]
            names: Of the coefficients.
        """
        shapes = _shapes(shape)
        normal, right = shapes.T @ self.whole @ shapes, shapes.T @ self.whole[:, MEASURED]
        values = _solved(normal, right)
        _, place = np.unique(self.group, return_inverse=True)
        count = int(place.max()) + 1
        parts = np.zeros((count, COLUMNS, COLUMNS))
        np.add.at(parts, place, self.bags.gram)
        left_out = np.array(
            [_solved(normal - shapes.T @ part @ shapes, right - shapes.T @ part[:, MEASURED])
             for part in parts]
        )  # fmt: skip
        moved = left_out - left_out.mean(axis=0)
        covariance = moved.T @ moved * (count - 1) / count * student(count - 1) ** 2
        scatter = np.sqrt(np.diag(covariance))
        fit = Fit(
            ("Coulomb", *names), values, covariance, np.array([float(count)]), count - 1.0,
            np.empty(0), np.empty(0), {SCATTER: scatter},
        )  # fmt: skip
        rigid = shapes.T @ self.whole[:, RIGID]
        if self.own_bodies:
            return moved_by(fit, TORQUE, self.sensors.torque * values)
        fit = moved_by(fit, TORQUE, self.sensors.torque * (values + _solved(normal, rigid)))
        return moved_by(fit, BODIES, self.sensors.bodies * _solved(normal, rigid))


def fit_merged(
    bags: JointBags, sensors: SensorLimits, own_bodies: bool, source: str
) -> FrictionFit:
    """Identify the friction of one joint.

    Args:
        bags: Its sums, without nuisances.
        sensors: Standard deviations of constant errors.
        own_bodies: Whether the bodies of the model come from measured torque.
        source: Where the data come from, for the model file.

    Returns:
        The same as `identify friction` gives.

    Raises:
        NotIdentifiableError: If the joint hardly moves, or at one speed.
    """
    _require(bags)
    warnings: list[str] = []
    span = (float(bags.degc.min()), float(bags.degc.max()))
    kinds = LAWS
    if span[1] - span[0] < MIN_RANGE:
        kinds = {"constant": constant_law}
        warnings.append(
            f"{bags.name}: the range of its motor temperature is below {MIN_RANGE:g} K, so its "
            "friction is taken as constant"
        )
        fold = contiguous_folds(len(bags.degc))
    else:
        fold = folds_by_value(bags.degc)
    merged = _merge(bags, sensors, own_bodies, source)
    laws: dict[str, LawEntry] = {}
    fits: dict[str, Fit] = {}
    errors: dict[str, HeldOut] = {}
    for name, kind in kinds.items():
        try:
            laws[name], fits[name] = kind(merged)
            errors[name] = _held_out(kind, merged, fold)
        except NotIdentifiableError as error:
            if name == "constant":
                raise
            warnings.append(f"{bags.name}: no {name} law, because {error.found}")
            laws.pop(name, None)
    chosen = simplest({name: error.rms for name, error in errors.items()})
    fit, constant, whole = fits[chosen], fits["constant"], merged.whole
    samples = int(bags.rows.sum())
    speed, torque = (
        float(np.sqrt(square / samples))
        for square in (whole[VISCOUS, VISCOUS].sum(), whole[MEASURED, MEASURED])
    )
    return FrictionFit(
        name=bags.name,
        coulomb=float(fit.values[0]),
        coulomb_std=float(fit.std[0]),
        points=points_of(laws, span),
        laws=laws,
        errors=errors,
        chosen=chosen,
        samples=samples,
        range_degc=span,
        residual=score(bags, laws[chosen], float(fit.values[0])).rms,
        warnings=tuple(warnings),
        viscous=float(constant.values[1]),
        viscous_std=float(constant.std[1]),
        speed=speed,
        torque=torque,
        parts={"coulomb": fit.parts_of(0), "viscous": constant.parts_of(1)},
    )


def score(bags: JointBags, law: LawEntry | None, coulomb: float) -> TorqueScore:
    """Return the error of a friction model on bags.

    Args:
        bags: Without nuisances.
        law: Of the viscous friction; None for the model of the replay.
        coulomb: Its Coulomb torque. [N m]
    """
    whole, weights = bags.gram.sum(axis=0), np.zeros(COLUMNS)
    if law is None:
        weights[MODEL] = 1.0
    else:
        weights[SIGN] = coulomb
        weights[VISCOUS] = viscous_law(law).viscous(NODES_DEGC)
    measured = whole[MEASURED, MEASURED]
    square = weights @ whole @ weights - 2.0 * weights @ whole[:, MEASURED] + measured
    speed = whole[VISCOUS].sum(axis=0)  # products of the velocity
    energy = float(weights @ speed / speed[MEASURED]) - 1.0 if speed[MEASURED] > 0 else np.nan
    square = max(float(square), 0.0)
    return TorqueScore(
        float(np.sqrt(square / max(int(bags.rows.sum()), 1))),
        float(np.sqrt(square / measured)) if measured > 0 else float("nan"),
        energy,
    )


def constant_law(merged: _Merged) -> tuple[LawEntry, Fit]:
    """Fit one viscous coefficient for all temperatures."""
    fit = merged.fit(np.ones((NODES, 1)), ("viscous",))
    value, std = float(fit.values[1]), float(fit.std[1])
    return ConstantLaw(law="constant", viscous=identified(value, std, merged.source)), fit


def exponential_law(merged: _Merged) -> tuple[LawEntry, Fit]:
    """Search the temperature scale c; everything else is linear for a given c."""
    middle = float(np.average(merged.bags.degc, weights=merged.bags.rows))
    above = NODES_DEGC - middle

    def shape(scale: float) -> Float:
        return np.column_stack([np.ones(NODES), np.exp(-above / scale)])

    def cost(scale: float) -> float:
        shapes = _shapes(shape(scale))
        values = _solved(shapes.T @ merged.whole @ shapes, shapes.T @ merged.whole[:, MEASURED])
        if (values[1:] < 0).any():
            return float("inf")
        return -float(values @ (shapes.T @ merged.whole[:, MEASURED]))

    costs = [cost(float(scale)) for scale in SCALES]
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        raise NotIdentifiableError(
            "the viscous friction does not fall with temperature towards a limit >= 0",
            "points that do",
        )
    fine = np.geomspace(SCALES[max(best - 1, 0)], SCALES[min(best + 1, len(SCALES) - 1)], 41)
    scale = float(min(fine, key=lambda one: cost(float(one))))
    found = merged.fit(shape(scale), ("hot viscous", "cold viscous"))
    hot, cold = (float(value) for value in found.values[1:])
    slope = cold * np.exp(-above / scale) * above / scale**2
    tangent = merged.fit(np.column_stack([shape(scale), slope]), ("hot", "cold", "scale"))
    moves = np.zeros(4)
    moves[2] = -cold / scale * merged.sensors.thermometer
    tangent = moved_by(tangent, THERMOMETER, moves)
    lift = float(np.exp(middle / scale))
    to_law = np.array([[1, 0, 0], [0, lift, -cold * lift * middle / scale**2], [0, 0, 1.0]])
    known = to_law @ tangent.covariance[1:, 1:] @ to_law.T
    known = 0.5 * (known + known.T)
    std = np.sqrt(np.diag(known)).tolist()
    law = ExponentialLaw(
        law="exponential",
        a=identified(hot, std[0], merged.source),
        b=identified(cold * lift, std[1], merged.source),
        c=PositiveFigure(value=scale, tag="identified", std=std[2], source=merged.source),
        fitted_degc=(float(merged.bags.degc.min()), float(merged.bags.degc.max())),
        covariance=known.tolist(),
    )
    greatest = viscous_law(law).std(np.linspace(*law.fitted_degc, GRID)).max()
    fit = replace(found, covariance=tangent.covariance[:3, :3], parts={
        cause: part[:3] for cause, part in tangent.parts.items()
    })  # fmt: skip
    return law.model_copy(update={"std": float(greatest)}), fit


def table_law(merged: _Merged) -> tuple[LawEntry, Fit]:
    """Fit the viscous coefficient at every node that the bags have seen."""
    seen = merged.whole[VISCOUS, VISCOUS].sum(axis=1)
    kept = np.flatnonzero(seen >= MIN_SHARE * seen.sum())
    if len(kept) < 2:
        raise NotIdentifiableError("its motion lies at one temperature", "two that differ")
    nodes = NODES_DEGC[kept]
    shape = np.column_stack([np.interp(NODES_DEGC, nodes, row) for row in np.eye(len(kept))])
    fit = merged.fit(shape, tuple(f"viscous at {node:.0f} degC" for node in nodes))
    slope = np.append(0.0, np.gradient(fit.values[1:], nodes))
    fit = moved_by(fit, THERMOMETER, merged.sensors.thermometer * slope)
    above = fit.values[1:] > 0.0
    law = TableLaw(
        law="table",
        motor_temperature_degc=nodes.tolist(),
        viscous=np.maximum(fit.values[1:], 0.0).tolist(),
        std=fit.std[1:].tolist(),
        tag="identified" if above.all() else "assumed",
        source=merged.source,
    )
    return law, fit


LAWS: dict[str, Callable[[_Merged], tuple[LawEntry, Fit]]] = {
    "constant": constant_law,
    "exponential": exponential_law,
    "table": table_law,
}
"""The simplest first."""


def _merge(bags: JointBags, sensors: SensorLimits, own_bodies: bool, source: str) -> _Merged:
    robots = len(np.unique(bags.robot))
    group = bags.robot if robots >= MIN_GROUPS else np.arange(len(bags.robot))
    return _Merged(bags, bags.gram.sum(axis=0), group, sensors, own_bodies, source)


def _held_out(
    kind: Callable[[_Merged], tuple[LawEntry, Fit]], merged: _Merged, fold: Int
) -> HeldOut:
    """Error of a law on bags at temperatures that its fit has not seen."""
    square = total = rows = 0.0
    folds = np.unique(fold)
    for one in folds:
        seen, unseen = merged.bags.only(fold != one), merged.bags.only(fold == one)
        law, fit = kind(_merge(seen, merged.sensors, merged.own_bodies, ""))
        error = score(unseen, law, float(fit.values[0]))
        count = float(unseen.rows.sum())
        square += error.rms**2 * count
        total += float(unseen.gram[:, MEASURED, MEASURED].sum())
        rows += count
    relative = float(np.sqrt(square / total)) if total > 0 else float("nan")
    return HeldOut(len(folds), float(np.sqrt(square / rows)), relative)


def _shapes(shape: Float) -> Float:
    """Columns of fc and of shapes of temperature, in all columns, shape (COLUMNS, 1 + K)."""
    shapes = np.zeros((COLUMNS, 1 + shape.shape[1]))
    shapes[SIGN, 0] = 1.0
    shapes[VISCOUS, 1:] = shape
    return shapes


def _solved(normal: Float, right: Float) -> Float:
    return np.linalg.lstsq(normal, right, rcond=1e-12)[0]


def _require(bags: JointBags) -> None:
    samples = int(bags.rows.sum())
    if samples < MIN_SAMPLES or len(bags.rows) < 2:
        raise NotIdentifiableError(
            f"{bags.name} moves in {samples} samples of {len(bags.rows)} bags",
            f"at least {MIN_SAMPLES} in two bags",
            "record motions of this joint at several speeds and in both directions",
        )
    whole = bags.gram.sum(axis=0)
    square = float(whole[VISCOUS, VISCOUS].sum())
    along = float(whole[SIGN, VISCOUS].sum()) ** 2 / max(float(whole[SIGN, SIGN]), 1e-300)
    if not square - along > MIN_INDEPENDENT * square:
        raise NotIdentifiableError(
            f"{bags.name} moves at one speed: Coulomb and viscous friction cannot be separated",
            "speeds that differ by a factor of 1.5 or more",
            "record slow and fast motions in both directions",
        )
