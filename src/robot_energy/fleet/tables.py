"""The tables that reports of a fleet are made from, and the rows that one bag gives them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import polars as pl

from robot_energy.fleet.hour_sums import HourSums
from robot_energy.results.replay import ReplayReport

FLOATS = pl.List(pl.Float64)
SCHEMAS: dict[str, dict[str, Any]] = {
    "runs": {
        "key": pl.String,
        "bag": pl.String,
        "robot": pl.String,
        "model_id": pl.String,
        "reason": pl.String,
        "start_ns": pl.Int64,
        "end_ns": pl.Int64,
        "observed_time": pl.Float64,
        "grid_energy": pl.Float64,
        "brake_energy": pl.Float64,
        "measured_energy": pl.Float64,
        "predicted_energy_at_meter": pl.Float64,
        "motor_temperature_degc": pl.Float64,
    },
    "jobs": {
        "key": pl.String,
        "robot": pl.String,
        "name": pl.String,
        "start_ns": pl.Int64,
        "end_ns": pl.Int64,
        "time": pl.Float64,
        "gap_time": pl.Float64,
        "energy": pl.Float64,
        "measured_energy": pl.Float64,
        "predicted_energy_at_meter": pl.Float64,
    },
    "hours": {
        "key": pl.String,
        "robot": pl.String,
        "hour_ns": pl.Int64,
        "observed_time": pl.Float64,
        "motion_time": pl.Float64,
        "grid_energy": pl.Float64,
        "standby_time": pl.Float64,
        "standby_energy": pl.Float64,
    },
    "joints": {
        "key": pl.String,
        "robot": pl.String,
        "joint": pl.String,
        "friction_rows": pl.Int64,
        "motion_time": pl.Float64,
        "motor_temperature_degc": pl.Float64,
        "friction_sums": FLOATS,
        "wear_stamp_ns": pl.List(pl.Int64),
        "wear_hours": FLOATS,
        "wear_time": FLOATS,
        "wear_excess": FLOATS,
        "wear_variance": FLOATS,
        "wear_features": FLOATS,
    },
}
"""Columns of the tables: energies in J, times in s, stamps in ns since 1970."""

Rows = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class FleetTables:
    """Rows of all bags of a fleet.

    Attributes:
        runs: One of each bag; ``reason`` says why one could not be read.
        jobs: One of each job.
        hours: One of each bag and clock hour.
        joints: One of each bag and joint.
    """

    runs: pl.DataFrame
    jobs: pl.DataFrame
    hours: pl.DataFrame
    joints: pl.DataFrame


def bag_rows(
    key: str, robot: str, report: ReplayReport, joints: list[dict[str, Any]], hours: HourSums
) -> Rows:
    """Return the rows of one bag.

    Args:
        key: Unique in the fleet.
        robot: Name of the robot.
        report: Of the replay of the bag.
        joints: From `JointSums.table`.
        hours: Of the same replay.
    """
    own = {"key": key, "robot": robot}
    time = sum(row["motion_time"] for row in joints if row["motor_temperature_degc"] is not None)
    heat = sum(
        row["motion_time"] * row["motor_temperature_degc"]
        for row in joints
        if row["motor_temperature_degc"] is not None
    )
    run = {
        **own,
        "bag": report.bag,
        "model_id": report.model.model_id,
        "reason": "",
        "start_ns": report.time.start_ns,
        "end_ns": report.time.end_ns,
        "observed_time": report.time.observed_time,
        "grid_energy": report.energy.grid_import,
        "brake_energy": report.energy.brake,
        "measured_energy": report.comparison.measured_energy,
        "predicted_energy_at_meter": report.comparison.predicted_energy_at_meter,
        "motor_temperature_degc": heat / time if time else None,
    }
    names = SCHEMAS["jobs"]
    return {
        "runs": [run],
        "jobs": [
            own | {name: getattr(job, name) for name in names if name not in own}
            for job in report.jobs
        ],
        "hours": [own | row for row in hours.table()],
        "joints": [own | row for row in joints],
    }


def tables_of(bags: Iterable[Rows]) -> FleetTables:
    """Return the rows of many bags as tables.

    Args:
        bags: From `bag_rows`.
    """
    rows: Rows = {name: [] for name in SCHEMAS}
    for bag in bags:
        for name, own in bag.items():
            rows[name] += own
    return FleetTables(
        **{name: pl.DataFrame(rows[name], schema=schema) for name, schema in SCHEMAS.items()}
    )
