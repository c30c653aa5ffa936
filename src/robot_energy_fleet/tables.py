"""The tables that reports of a fleet are made from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import polars as pl

from robot_energy_report.repeats import overlaps

FLOATS = pl.List(pl.Float64)


def _columns(*groups: tuple[Any, str]) -> dict[str, Any]:
    """Columns in groups of one type, in their order."""
    return {name: kind for kind, names in groups for name in names.split()}


SCHEMAS: dict[str, dict[str, Any]] = {
    "runs": _columns(
        (pl.String, "key bag robot model_id reason"),
        (pl.List(pl.String), "problems"),
        (pl.Int64, "start_ns end_ns"),
        (pl.Float64, "observed_time grid_energy brake_energy measured_energy"),
        (pl.Float64, "predicted_energy_at_meter motor_temperature_degc"),
        (pl.Int64, "jobs_left_out"),
    ),
    "jobs": _columns(
        (pl.String, "key robot name"),
        (pl.Int64, "start_ns end_ns"),
        (pl.Float64, "time gap_time energy measured_energy predicted_energy_at_meter"),
    ),
    "hours": _columns(
        (pl.String, "key robot"),
        (pl.Int64, "hour_ns"),
        (pl.Float64, "observed_time motion_time grid_energy standby_time standby_energy"),
    ),
    "joints": _columns(
        (pl.String, "key robot joint"),
        (pl.Int64, "friction_rows"),
        (pl.Float64, "motion_time motor_temperature_degc"),
        (FLOATS, "friction_sums"),
        (pl.List(pl.Int64), "wear_stamp_ns"),
        (FLOATS, "wear_hours wear_time wear_excess wear_variance wear_features"),
    ),
}
"""Columns of the tables: energies in J, times in s, stamps in ns since 1970."""

Rows = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class FleetTables:
    """Rows of all bags of a fleet.

    Attributes:
        runs: One of each bag; ``reason`` says why one could not be read, ``problems`` what
            was wrong with one that was.
        jobs: One of each job.
        hours: One of each bag and clock hour.
        joints: One of each bag and joint.
    """

    runs: pl.DataFrame
    jobs: pl.DataFrame
    hours: pl.DataFrame
    joints: pl.DataFrame

    def of_model(self, model_id: str) -> FleetTables:
        """Return the rows of the bags that were read with one model."""
        runs = self.runs.filter((pl.col("model_id") == model_id) & (pl.col("reason") == ""))
        keys = runs.select("key")
        others = (one.join(keys, on="key", how="semi", maintain_order="left")
                  for one in (self.jobs, self.hours, self.joints))  # fmt: skip
        return FleetTables(runs, *others)


def tables_of(bags: Iterable[Rows]) -> FleetTables:
    """Return the rows of many bags as tables.

    Args:
        bags: Of each bag, the rows of every table by its name.
    """
    rows: Rows = {name: [] for name in SCHEMAS}
    for bag in bags:
        for name, own in bag.items():
            rows[name] += own
    return FleetTables(
        **{name: pl.DataFrame(rows[name], schema=schema) for name, schema in SCHEMAS.items()}
    )


def counted_twice(runs: pl.DataFrame) -> list[str]:
    """Return a note on each robot of which bags overlap in time."""
    bags = runs.sort("robot", "start_ns", "end_ns", "bag").partition_by("robot")
    return [
        f"{one['robot'][0]}: {note}"
        for one in bags
        for note in overlaps(one["bag"].to_list(), list(one.select("start_ns", "end_ns").rows()))
    ]
