"""The rows of joints as arrays, one row for each bag, and what its sums say of each joint.

That is friction against the model, and a wrong payload. Both are fitted together, so that neither
stands for the other: friction has the sign of the velocity, a load keeps its sign where the joint
turns back.

``y = multiplier friction_model + m p + m' i + offset``

with m' for inertia alone, whose accelerations are less certain than gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
import polars as pl

from robot_energy.condition.wear_records import FEATURES, WearRecord
from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float, Int
from robot_energy_fleet.joint_sums import (
    COLUMNS,
    INERTIA,
    MEASURED,
    MODEL,
    NODES,
    OFFSET,
    PAYLOAD,
    SIGN,
    UPPER,
    VISCOUS,
    WEAR,
    gram_of,
)
from robot_energy_fleet.tables import FleetTables

PART = 2000  # bags whose sums are held at once
POOLED = 2  # nodes of temperature that make one share
WORK = len(range(0, NODES, POOLED)) + 2
MIN_ROWS = 200  # samples of a joint in motion, below which a bag says nothing of it
TINY = 1e-6  # of the length of a column: less is taken as dependent on the others
_SHAPE = (COLUMNS, COLUMNS)


class BagFigures(Described):
    """Figures of B bags."""

    multiplier: Annotated[
        Float, "Measured over model friction, shape (B, n); NaN where unknown. [-]"
    ]
    mass: Annotated[
        Float, "More than the model's payload, of gravity alone, shape (B,); NaN: unknown. [kg]"
    ]


class BagJoints(Described):
    """Bags with moving joints, of robots with one model."""

    robots: tuple[str, ...]
    joints: Annotated[tuple[str, ...], "Names, in the order of the model."]
    key: Annotated[list[str], "Of each bag, shape (B,)."]
    robot: Annotated[Int, "Number of its robot, shape (B,)."]
    stamp_ns: Annotated[Int, "Its begin, shape (B,). [ns]"]
    figures: BagFigures
    degc: Annotated[Float, "Mean motor temperature, shape (B, n). [degC]"]
    work: Annotated[
        Float,
        "What bags differ in: shares of w^2 at temperatures, mean and square speed, shape (B, n, "
        "K). [-]",
    ]


def bag_joints(tables: FleetTables, robots: Sequence[str]) -> BagJoints:
    """Return the bags of robots with one model."""
    rows = (
        tables.joints.lazy()
        .join(tables.runs.lazy().select("key", "start_ns"), on="key", maintain_order="left")
        .filter(pl.col("friction_rows") > 0)
        .collect()
    )
    joints = tuple(rows["joint"].unique(maintain_order=True).to_list())
    bags = rows.select("key", "robot", "start_ns").unique("key").sort("start_ns", "key")
    place = {key: number for number, key in enumerate(bags["key"].to_list())}
    size, n_joints = len(place), len(joints)
    count = np.zeros((size, n_joints), dtype=np.int64)
    degc = np.full((size, n_joints), np.nan)
    multiplier, work = np.full((size, n_joints), np.nan), np.zeros((size, n_joints, WORK))
    mass = np.full(size, np.nan)
    row = np.array([place[key] for key in rows["key"].to_list()], dtype=np.int64)
    column = np.array([joints.index(name) for name in rows["joint"].to_list()], dtype=np.int64)
    count[row, column] = rows["friction_rows"].to_numpy()
    degc[row, column] = rows["motor_temperature_degc"].fill_null(np.nan).to_numpy()
    upper = rows["friction_sums"].explode().to_numpy().reshape(-1, len(UPPER[0]))
    for first in range(0, size, PART):
        own = (row >= first) & (row < first + PART)
        gram = np.zeros((min(PART, size - first), n_joints, *_SHAPE))
        gram[row[own] - first, column[own]] = gram_of(upper[own])
        part = slice(first, first + PART)
        found = bag_figures(gram, count[part])
        multiplier[part], mass[part] = found.multiplier, found.mass
        work[part] = _work(gram, count[part])
    names = {name: number for number, name in enumerate(robots)}
    return BagJoints(
        tuple(robots),
        joints,
        list(place),
        np.array([names[name] for name in bags["robot"].to_list()], dtype=np.int64),
        bags["start_ns"].to_numpy(),
        BagFigures(multiplier, mass),
        degc,
        work,
    )


def sums_of_joint(tables: FleetTables, bags: BagJoints, joint: str) -> tuple[Float, Int]:
    """Return sums of products of a joint, (B, COLUMNS, COLUMNS), and samples, (B,); 0: none."""
    order = pl.DataFrame({"key": bags.key})
    rows = order.join(
        tables.joints.filter(pl.col("joint") == joint), on="key", how="left", maintain_order="left"
    )
    count = rows["friction_rows"].fill_null(0).to_numpy()
    gram = np.zeros((len(count), *_SHAPE))
    upper = rows.filter(pl.col("friction_rows") > 0)["friction_sums"].explode().to_numpy()
    gram[count > 0] = gram_of(upper.reshape(-1, len(UPPER[0])))
    return gram, count


def wear_records(rows: pl.DataFrame) -> list[WearRecord]:
    """Return the records of one joint of one robot, in order of time."""
    written = (
        one
        for one in rows.iter_rows(named=True)  # an earlier release wrote other features
        if len(one["wear_features"]) == FEATURES * len(one["wear_stamp_ns"])
    )
    found = [
        WearRecord(stamp_ns, hours, time, excess, variance, tuple(features))
        for one in written
        for stamp_ns, hours, time, excess, variance, features in zip(
            *(one[f"wear_{key}"] for key in WEAR),
            np.reshape(one["wear_features"], (-1, FEATURES)).tolist(),
            strict=True,
        )
    ]
    return sorted(found)


def _work(gram: Float, count: Int) -> Float:
    """Shares of w^2 at pooled nodes of temperature, and log of mean and square speed."""
    square = gram[..., VISCOUS, VISCOUS].sum(axis=-1)
    total = np.maximum(square.sum(axis=-1, keepdims=True), 1e-300)
    edges = np.arange(0, NODES, POOLED)
    pooled = np.add.reduceat(square / total, edges, axis=-1)
    amount = np.abs(gram[..., SIGN, VISCOUS].sum(axis=-1))
    rows = np.maximum(count, 1)
    with np.errstate(divide="ignore"):
        speeds = np.log(np.stack([amount / rows, np.sqrt(total[..., 0] / rows)], axis=-1))
    return np.concatenate([pooled, speeds], axis=-1)


def bag_figures(gram: Float, rows: Int) -> BagFigures:
    """Return the figures of bags.

    Args:
        gram: Sums of products, shape (B, n, COLUMNS, COLUMNS). [units of both columns]
        rows: Samples behind them, shape (B, n).
    """
    enough = rows >= MIN_ROWS
    fitted = _solved(gram, [MODEL, PAYLOAD, INERTIA, OFFSET])
    multiplier = np.where(enough & (fitted[..., 0] > 0.0), fitted[..., 0], np.nan)
    square, product, noise = _load(gram, np.maximum(rows, 1))
    weight = np.where(enough & (noise > 0.0), 1.0 / np.maximum(noise, 1e-12), 0.0)
    known = (weight * square).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mass = (weight * product).sum(axis=1) / known
    return BagFigures(multiplier, np.where(known > 0.0, mass, np.nan))


def _scaled(gram: Float) -> tuple[Float, Float]:
    """Products of columns of length 1, and the lengths; what depends on others is damped."""
    length = np.sqrt(np.maximum(np.diagonal(gram, axis1=-2, axis2=-1), 0.0))
    length = np.where(length > 0.0, length, 1.0)
    unit = gram / (length[..., :, None] * length[..., None, :])
    return unit + TINY * np.eye(gram.shape[-1]), length


def _solved(gram: Float, columns: list[int]) -> Float:
    """Coefficients of columns in a fit of the measured friction, shape (..., len(columns))."""
    unit, length = _scaled(gram[..., columns, :][..., columns])
    right = gram[..., columns, MEASURED] / length
    return np.linalg.solve(unit, right[..., None])[..., 0] / length


def _load(gram: Float, rows: Int) -> tuple[Float, Float, Float]:
    """Squares of p, its products with y, and variance of y, less friction, inertia, offset."""
    speed = gram[..., VISCOUS, :].sum(axis=-2)  # products of the velocity with all columns
    own = np.stack([gram[..., SIGN, :], speed, gram[..., INERTIA, :], gram[..., OFFSET, :]], -2)
    inner = np.stack(
        [own[..., SIGN], own[..., VISCOUS].sum(-1), own[..., INERTIA], own[..., OFFSET]], -1
    )
    unit, length = _scaled(inner)
    pair = [PAYLOAD, MEASURED]
    right = own[..., pair] / length[..., None]
    left = gram[..., pair, :][..., pair] - np.swapaxes(right, -1, -2) @ np.linalg.solve(unit, right)
    # of a gravity that hardly changes in a bag, the offset has taken all
    square = np.where(left[..., 0, 0] > 1e-4 * gram[..., PAYLOAD, PAYLOAD], left[..., 0, 0], 0.0)
    product = np.where(square > 0.0, left[..., 0, 1], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        explained = np.where(square > 0.0, product**2 / square, 0.0)
    return square, product, np.maximum(left[..., 1, 1] - explained, 0.0) / rows
