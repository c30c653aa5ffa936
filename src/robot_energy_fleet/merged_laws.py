"""The laws of viscous friction over temperature, fitted to merged sums of many bags.

They are those of `robot_energy_identify.friction.laws`, whose samples are summed here: with fv at
the nodes of temperature all sums of squares follow from the products of the columns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.friction_laws import LawEntry
from robot_energy.timeline.blocks import Float, Int, Rows
from robot_energy_fleet.bag_joints import (
    COLUMNS,
    INERTIA,
    MEASURED,
    NODES,
    NODES_DEGC,
    OFFSET,
    PAYLOAD,
    RIGID,
    SIGN,
    VISCOUS,
)
from robot_energy_identify.bounds import identified
from robot_energy_identify.friction.laws import (
    MIN_RANGE,
    MIN_SHARE,
    SCALES,
    constant_law,
    exponential_law,
    table_law,
)
from robot_energy_identify.stats.regression import SCATTER, Fit, student
from robot_energy_identify.stats.systematic import (
    BODIES,
    THERMOMETER,
    TORQUE,
    SensorLimits,
    moved_by,
)

FINE = 40  # steps of the scale of the exponential law, about the best of the coarse ones
SMOOTH = 1e-3  # weight of no bend at a node against its mean square of speed
ROUNDING = 1e-12  # sum of squares of a nuisance that is none, such as gravity about an upright axis
DAMPING = 1e-6  # of a column of length 1, where a bag does not show a nuisance


class JointBags(Rows):
    """Sums of one joint in B bags."""

    name: str
    gram: Annotated[Float, "Sums of products, shape (B, COLUMNS, COLUMNS)."]
    rows: Annotated[Int, "Samples, shape (B,)."]
    degc: Annotated[Float, "Mean motor temperature, shape (B,); NaN: not known. [degC]"]
    robot: Annotated[Int, "Number of the robot, shape (B,)."]
    stamp_ns: Annotated[Int, "When the bag begins, shape (B,). [ns]"]


def without_nuisances(gram: Float) -> Float:
    """Return sums without the offset and the payload of each bag, same shape.

    Args:
        gram: Shape (B, COLUMNS, COLUMNS). [units of both columns]
    """
    own = [OFFSET, PAYLOAD, INERTIA]
    inner = gram[:, own][:, :, own]
    length = np.sqrt(np.maximum(np.diagonal(inner, axis1=1, axis2=2), ROUNDING))
    unit = inner / (length[:, :, None] * length[:, None, :]) + DAMPING * np.eye(len(own))
    right = gram[:, own] / length[:, :, None]
    return gram - np.swapaxes(right, 1, 2) @ np.linalg.solve(unit, right)


class MergedSums(Described):
    """Sums of a joint, for fits of any shape over temperature."""

    bags: JointBags
    whole: Annotated[Float, "Their sums of products, shape (COLUMNS, COLUMNS)."]
    group: Annotated[Int, "Of bags that are left out together, shape (B,)."]
    sensors: SensorLimits
    own_bodies: Annotated[bool, "Whether the bodies of the model come from measured torque."]
    source: str

    def fit(self, shape: Float, names: tuple[str, ...], bend: Float | None = None) -> Fit:
        """Return fc and the coefficients of shapes of temperature, with their covariance.

        Args:
            shape: Values at the nodes, shape (NODES, K). [-]
            bend: Combinations of the coefficients that are 0 where the bags do not show them,
                shape (M, K); None for none. [-]
        """
        shapes = _shapes(shape)
        normal, right = shapes.T @ self.whole @ shapes, shapes.T @ self.whole[:, MEASURED]
        if bend is not None:
            normal[1:, 1:] += SMOOTH * float(np.trace(normal[1:, 1:])) / len(names) * bend.T @ bend
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
        covariance = moved.T @ moved * (count - 1) / count * student(count - 1.0) ** 2
        if count == 1:  # nothing to leave out: nothing is known of the scatter
            covariance = np.diag(np.full(len(values), np.inf))
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


def fit_constant(merged: MergedSums) -> tuple[LawEntry, Fit]:
    """Return a law with one viscous coefficient, and fc with that."""
    fit = merged.fit(np.ones((NODES, 1)), ("viscous",))
    value, std = float(fit.values[1]), float(fit.std[1])
    return constant_law(identified(value, std, merged.source), merged.bags.degc), fit


def fit_exponential(merged: MergedSums) -> tuple[LawEntry, Fit]:
    """Fit the exponential law: its scale c is searched, everything else is linear.

    Returns:
        The law, and fc with its coefficients.
    """
    span = float(np.ptp(merged.bags.degc))
    if span < MIN_RANGE:
        raise NotIdentifiableError(f"its bags lie within {span:.1f} K", f"{MIN_RANGE:g} K or more")
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
    low, high = float(SCALES[max(best - 1, 0)]), float(SCALES[min(best + 1, len(SCALES) - 1)])
    fine = [low * (high / low) ** (step / FINE) for step in range(FINE + 1)]
    scale = min(fine, key=cost)
    found = merged.fit(shape(scale), ("hot viscous", "cold viscous"))
    hot, cold = (float(value) for value in found.values[1:])
    slope = cold * np.exp(-above / scale) * above / scale**2
    tangent = merged.fit(np.column_stack([shape(scale), slope]), ("hot", "cold", "scale"))
    moves = np.zeros(4)
    moves[2] = -cold / scale * merged.sensors.thermometer
    tangent = moved_by(tangent, THERMOMETER, moves)
    known, figures = tangent.covariance[1:, 1:], (hot, cold, scale)
    law = exponential_law(figures, middle, merged.bags.degc, known, merged.source)
    fit = replace(found, covariance=tangent.covariance[:3, :3], parts={
        cause: part[:3] for cause, part in tangent.parts.items()
    })  # fmt: skip
    return law, fit


def fit_table(merged: MergedSums) -> tuple[LawEntry, Fit]:
    """Fit the viscous coefficient at every node that the bags have seen.

    Returns:
        The law, and fc with its coefficients.
    """
    seen = merged.whole[VISCOUS, VISCOUS].sum(axis=1)
    kept = np.flatnonzero(seen >= MIN_SHARE * seen.sum())
    if len(kept) < 2:
        raise NotIdentifiableError("its motion lies at one temperature", "two that differ")
    nodes = NODES_DEGC[kept]
    shape = np.column_stack([np.interp(NODES_DEGC, nodes, row) for row in np.eye(len(kept))])
    bend = np.diff(np.eye(len(kept)), 2, axis=0)
    fit = merged.fit(shape, tuple(f"viscous at {node:.0f} degC" for node in nodes), bend)
    slope = np.append(0.0, np.gradient(fit.values[1:], nodes))
    fit = moved_by(fit, THERMOMETER, merged.sensors.thermometer * slope)
    return table_law(nodes, fit.values[1:], fit.std[1:], merged.source), fit


def _shapes(shape: Float) -> Float:
    """Columns of fc and of shapes of temperature, in all columns, shape (COLUMNS, 1 + K)."""
    shapes = np.zeros((COLUMNS, 1 + shape.shape[1]))
    shapes[SIGN, 0] = 1.0
    shapes[VISCOUS, 1:] = shape
    return shapes


def _solved(normal: Float, right: Float) -> Float:
    return np.linalg.lstsq(normal, right, rcond=1e-12)[0]
