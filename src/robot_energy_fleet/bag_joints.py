"""What bags say of the friction of every joint: sums of one bag, then rows and figures of many.

Figures are friction against the model, and a wrong payload. Both are fitted together, so that none
stands for the other: friction has the sign of the velocity, a load keeps its sign where the joint
turns back.

``y = multiplier friction_model + m p + m' i + offset``

with m' for inertia alone, whose accelerations are less certain than gravity.

The sums are of moving samples, motor side, where ``y = measured - rigid torque`` is linear:

``y = fc sgn(w) + sum_k fv_k h_k(T) w + offset + m (p + i) + ...``,

with hats h_k of temperature (linear interpolation between `NODES_DEGC`), p the torque by which
gravity of one more kilogram at the payload loads the motor, and i that by its inertia. The sums
of the products of these columns hold all that a least squares fit of any of them needs, and the
sums of two bags are the sums of both together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any
from xml.etree import ElementTree

import numpy as np
import polars as pl

from robot_energy.condition.joint_friction import shares
from robot_energy.condition.wear import WearMonitor
from robot_energy.condition.wear_records import FEATURES, WearRecord
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.model.payload import payload
from robot_energy.physics.drivetrain import Drivetrain, motor_rest
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    Float,
    Int,
    PowerBlock,
    TorqueBlock,
    differences,
)
from robot_energy_fleet.tables import FleetTables

NODE_STEP = 5.0  # between two nodes of temperature [K]
NODES_DEGC = np.arange(0.0, 90.0 + NODE_STEP, NODE_STEP)
NODES = len(NODES_DEGC)
SIGN, VISCOUS, OFFSET = 0, slice(1, 1 + NODES), 1 + NODES
PAYLOAD, INERTIA, MODEL, RIGID, MEASURED = (OFFSET + 1 + number for number in range(5))
COLUMNS = MEASURED + 1
UPPER = np.triu_indices(COLUMNS)
THINNED_NS = 40_000_000  # one sample of so much time is taken [ns]
WEAR = ("stamp_ns", "hours", "time", "excess", "variance")  # of the records of the wear alarm


class JointSums:
    """Gathers the sums of one bag.

    Samples are those that the learner of friction takes: in motion, with measured torque, without
    doubt. Of 40 ms one is taken, at its own stamp, so nothing depends on how the bag is cut.

    Attributes:
        grams: Sums of the products of two columns, shape (n, COLUMNS, COLUMNS).
        rows: Samples behind them, shape (n,).
        time: Motion, shape (n,). [s]
        heat: Sum of the measured motor temperatures of the samples, shape (n,). [degC]
        warm_rows: Samples with a measured motor temperature, shape (n,).
    """

    def __init__(self, model: RobotModel) -> None:
        self._names = model.joint_names
        self._robot, self._drivetrain = Robot.from_model(model), Drivetrain.from_model(model)
        body = payload(*_carrier(model))
        self._loaded = self._robot.with_payload([body])
        self._bare = self._robot.with_payload([])
        self._floor = motor_rest(model)
        self._fallback_degc = model.temperature.fallback_degc
        self._waiting: list[TorqueBlock] = []
        self._before: tuple[int, int] | None = None  # stamp and segment of the newest sample
        n_joints = len(self._names)
        self.grams: Float = np.zeros((n_joints, COLUMNS, COLUMNS))
        self.rows = np.zeros(n_joints, dtype=np.int64)
        self.time: Float = np.zeros(n_joints)
        self.heat: Float = np.zeros(n_joints)
        self.warm_rows = np.zeros(n_joints, dtype=np.int64)

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave: a power sample comes with its torque, or later."""
        if output.torque is not None:
            self._waiting.append(output.torque)
        if output.power is None:
            return
        torque, size = TorqueBlock.concatenate(self._waiting), len(output.power)
        self._waiting = [torque[slice(size, None)]] if len(torque) > size else []
        power = output.power
        before_ns, segment = self._before or (int(power.stamp_ns[0]) - THINNED_NS, -1)
        rows = np.flatnonzero(differences(power.stamp_ns // THINNED_NS, before_ns // THINNED_NS))
        if not len(rows):
            return
        torque, power = torque[rows], power[rows]
        period = differences(power.stamp_ns, before_ns)
        period[differences(power.segment, segment) != 0] = 0
        self._before = int(power.stamp_ns[-1]), int(power.segment[-1])
        self._add(torque, power, np.maximum(period, 0) * NANOSECOND)

    def table(self, wear: WearMonitor) -> list[dict[str, Any]]:
        """Return one row for each joint, of plain values."""
        with np.errstate(invalid="ignore", divide="ignore"):
            degc = self.heat / self.warm_rows
        return [
            {
                "joint": name,
                "friction_rows": int(self.rows[joint]),
                "motion_time": float(self.time[joint]),
                "motor_temperature_degc": None if np.isnan(degc[joint]) else float(degc[joint]),
                "friction_sums": self.grams[joint][UPPER].tolist() if self.rows[joint] else [],
                **{f"wear_{key}": [getattr(one, key) for one in records] for key in WEAR},
                "wear_features": [value for record in records for value in record.features],
            }
            for joint, (name, records) in enumerate(zip(self._names, wear.records(), strict=True))
        ]

    @np.errstate(invalid="ignore", over="ignore", divide="ignore")
    def _add(self, torque: TorqueBlock, power: PowerBlock, period: Float) -> None:
        motion = tuple(
            np.ascontiguousarray(values)
            for values in (torque.joint_position, torque.joint_velocity, torque.joint_acceleration)
        )
        rest = (motion[0], np.zeros_like(motion[0]), np.zeros_like(motion[0]))
        gravity, whole = (
            self._drivetrain.motor_torque_from_joint(
                self._loaded.joint_torque(*given) - self._bare.joint_torque(*given)
            )
            for given in (rest, motion)
        )
        measured, rigid = power.motor_torque_measured, torque.motor_torque_rigid
        speed = power.motor_velocity
        model = power.friction_power / speed
        heat = power.motor_temperature_degc
        warm = ~np.isnan(heat)
        degc = np.where(warm, heat, self._fallback_degc)
        good = (np.abs(speed) > self._floor) & np.isfinite(measured + rigid + model + whole)
        good &= ((power.quality & np.uint32(DOUBTFUL)) == 0)[:, None]
        for joint in np.flatnonzero(good.any(axis=0)).tolist():
            rows = good[:, joint]
            columns = np.empty((int(rows.sum()), COLUMNS))
            w = speed[rows, joint]
            place = np.clip(degc[rows, joint] / NODE_STEP, 0.0, NODES - 1.0)
            columns[:, SIGN] = np.sign(w)
            columns[:, VISCOUS] = shares(place, NODES) * w[:, None]
            columns[:, OFFSET] = 1.0
            columns[:, PAYLOAD] = gravity[rows, joint]
            columns[:, INERTIA] = (whole - gravity)[rows, joint]
            columns[:, MODEL] = model[rows, joint]
            columns[:, RIGID] = rigid[rows, joint]
            columns[:, MEASURED] = measured[rows, joint] - rigid[rows, joint]
            self.grams[joint] += columns.T @ columns
            self.rows[joint] += len(columns)
            self.time[joint] += period[rows].sum()
            self.heat[joint] += heat[rows & warm[:, joint], joint].sum()
            self.warm_rows[joint] += int((rows & warm[:, joint]).sum())


def gram_of(upper: Sequence[float] | Float) -> Float:
    """Return sums of products of upper triangles, shape (..., COLUMNS, COLUMNS).

    Args:
        upper: Row by row, shape (..., COLUMNS (COLUMNS + 1) / 2). [units of both columns]
    """
    values = np.asarray(upper, dtype=np.float64)
    gram = np.zeros((*values.shape[:-1], COLUMNS, COLUMNS))
    gram[..., UPPER[0], UPPER[1]] = values
    gram[..., UPPER[1], UPPER[0]] = values
    return gram


def _carrier(model: RobotModel) -> tuple[str, float, tuple[float, float, float]]:
    """Link, mass and place of one kilogram: where the payload is, or the last link's frame."""
    if model.payload:
        body = model.payload[-1]
        return body.link, 1.0, body.centre_of_mass
    root = ElementTree.fromstring(model.urdf_xml)
    child = root.find(f"joint[@name='{model.joint_names[-1]}']/child")
    return ("" if child is None else child.get("link", "")), 1.0, (0.0, 0.0, 0.0)


PART = 2000  # bags whose sums are held at once
POOLED = 2  # nodes of temperature that make one share
WORK = len(range(0, NODES, POOLED)) + 2
MIN_ROWS = 200  # samples of a joint in motion, below which a bag says nothing of it
TINY = 1e-6  # of the length of a column: less is taken as dependent on the others
_SHAPE = (COLUMNS, COLUMNS)


class BagFigures(Described):
    """Figures of B bags."""

    multiplier: Annotated[Float, "Measured over model friction, shape (B, n); NaN: unknown. [-]"]
    mass: Annotated[Float, "Beyond the model's payload, by gravity, shape (B,); NaN: unknown. [kg]"]


class BagJoints(Described):
    """Bags with moving joints, of robots with one model."""

    robots: tuple[str, ...]
    joints: Annotated[tuple[str, ...], "Names, in the order of the model."]
    key: Annotated[list[str], "Of each bag, shape (B,)."]
    robot: Annotated[Int, "Number of its robot, shape (B,)."]
    stamp_ns: Annotated[Int, "Its begin, shape (B,). [ns]"]
    figures: BagFigures
    degc: Annotated[Float, "Mean measured motor temperature, shape (B, n); NaN: none. [degC]"]
    work: Annotated[Float, "Shares of w^2 at temperatures, mean and square speed, (B, n, K). [-]"]


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
    columns = [MODEL, PAYLOAD, INERTIA, OFFSET]
    unit, length = _scaled(gram[..., columns, :][..., columns])
    right = gram[..., columns, MEASURED] / length
    fitted = np.linalg.solve(unit, right[..., None])[..., 0] / length
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
