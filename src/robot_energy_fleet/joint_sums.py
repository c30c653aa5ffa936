"""What one bag says of the friction of every joint, as sums that bags can be merged by.

For moving samples, motor side, ``y = measured - rigid torque`` is a linear function of unknowns,

``y = fc sgn(w) + sum_k fv_k h_k(T) w + offset + m (p + i) + ...``,

with hats h_k of temperature (linear interpolation between `NODES_DEGC`), p the torque by which
gravity of one more kilogram at the payload loads the motor, and i that by its inertia. The sums
of the products of these columns hold all that a least squares fit of any of them needs, and the
sums of two bags are the sums of both together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from robot_energy.condition.joint_friction import shares
from robot_energy.condition.wear import WearMonitor
from robot_energy.model import RobotModel
from robot_energy.model.payload import payload
from robot_energy.physics.drivetrain import Drivetrain, motor_rest
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    Float,
    PowerBlock,
    TorqueBlock,
    differences,
)

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
        heat: Sum of the motor temperatures of the samples, shape (n,). [degC]
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

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave.

        Args:
            output: Every torque sample comes once, its power sample then or later.
        """
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
            degc = self.heat / self.rows
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
        degc = power.motor_temperature_degc
        degc = np.where(np.isnan(degc), self._fallback_degc, degc)
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
            self.heat[joint] += degc[rows, joint].sum()


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
