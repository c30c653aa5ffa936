"""The columns of a dataset, and the tables of it, or of a history, that reports are made from.

Registers have the names and units of those of a history: a bag and a robot that was recorded live
are rows of the same columns.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import polars as pl

from robot_energy.accounting.registers import JOINT_REGISTERS, SHAFT_REGISTERS
from robot_energy.foundation.described import Described
from robot_energy.foundation.units import HOUR_NS, MICROJOULE
from robot_energy.messages.fields import EXACT_FIELDS
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_history.database import FILE, JOB_SUMS, reader
from robot_energy_history.readings import COLUMNS
from robot_energy_history.rollup import Rolled
from robot_energy_history.rows import reading_from
from robot_energy_report.repeats import overlaps

STAMPS = ("start_ns", "end_ns", "hour_ns")
AT_METER = ("measured_microjoule", "predicted_microjoule_at_meter")


class FleetTables(Described):
    """Rows of all bags of a fleet, by the columns of a dataset, but energies in J and times in s.

    ``brake_microjoule`` is ``brake_energy``, ``gap_ns`` is ``gap_time``, and
    ``predicted_import_microjoule`` is ``grid_energy``; what a meter says is null without one.
    """

    runs: Annotated[
        pl.DataFrame,
        "One of each bag; ``reason`` says why one could not be read, ``problems`` what was wrong "
        "with one that was.",
    ]
    jobs: Annotated[pl.DataFrame, "One of each job."]
    hours: Annotated[pl.DataFrame, "One of each bag and clock hour."]
    joints: Annotated[pl.DataFrame, "One of each bag and joint."]

    def of_model(self, model_id: str) -> FleetTables:
        """Return the rows of the bags that were read with one model."""
        runs = self.runs.filter((pl.col("model_id") == model_id) & (pl.col("reason") == ""))
        keys = runs.select("key")
        others = (one.join(keys, on="key", how="semi", maintain_order="left")
                  for one in (self.jobs, self.hours, self.joints))  # fmt: skip
        return FleetTables(runs, *others)


def in_si(rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows of a dataset with energies in J, times in s and stamps as they are."""
    found: list[pl.Expr] = []
    for name, kind in rows.schema.items():
        column = pl.col(name)
        if name in AT_METER:
            column = pl.when(pl.col("compared_ns") > 0).then(column)
        if "_microjoule" in name:
            column = (column * MICROJOULE).alias(name.replace("microjoule", "energy"))
        elif name.endswith("_ns") and name not in STAMPS and kind.is_integer():
            column = (column * NANOSECOND).alias(f"{name[:-2]}time")
        found.append(column)
    return rows.select(found).rename({"predicted_import_energy": "grid_energy"}, strict=False)


def counted_twice(runs: pl.DataFrame) -> list[str]:
    """Return a note on each robot of which bags overlap in time."""
    bags = runs.sort("robot", "start_ns", "end_ns", "bag").partition_by("robot")
    return [
        f"{one['robot'][0]}: {note}"
        for one in bags
        for note in overlaps(one["bag"].to_list(), list(one.select("start_ns", "end_ns").rows()))
    ]


INTEGER, FLOAT, TEXT, FLOATS = pl.Int64(), pl.Float64(), pl.String(), pl.List(pl.Float64)
JOINT_ENERGIES = (*JOINT_REGISTERS, *(f"shaft_{name}" for name in SHAFT_REGISTERS))


class TableColumn(NamedTuple):
    """One column."""

    kind: pl.DataType
    unit: str
    text: str


Columns = dict[str, TableColumn]


def _registers(names: Iterable[str]) -> Columns:
    return {
        name: TableColumn(INTEGER, "ns" if name.endswith("_ns") else "uJ", f"register {name}")
        for name in names
    }


RUNS: Columns = {
    "name": TableColumn(TEXT, "", "hashes of the bag's address, of its state, of the settings"),
    "key": TableColumn(TEXT, "", "hash of bag, model, options and version; unique once read"),
    "bag": TableColumn(TEXT, "", "address of the bag"),
    "bag_hash": TableColumn(
        TEXT, "", "first 12 digits of the SHA-256, as in models; null if unreadable"
    ),
    "robot": TableColumn(TEXT, "", "name of the robot in the fleet"),
    "date": TableColumn(TEXT, "", "UTC day of the first sample"),
    "programme": TableColumn(TEXT, "", "as the list of bags says; may be empty"),
    "shift": TableColumn(TEXT, "", "as the list of bags says; may be empty"),
    "model_id": TableColumn(TEXT, "", "of the model used"),
    "settings": TableColumn(TEXT, "", "options of the replay, JSON"),
    "tool_version": TableColumn(TEXT, "", "that made the row"),
    "reason": TableColumn(TEXT, "", "why the bag could not be used: what was found; else empty"),
    "expected": TableColumn(TEXT, "", "what was expected instead"),
    "remedy": TableColumn(TEXT, "", "what can be done"),
    "problems": TableColumn(pl.List(TEXT), "", "what was wrong with a bag that was used"),
    "start_ns": TableColumn(INTEGER, "ns since 1970", "first sample"),
    "end_ns": TableColumn(INTEGER, "ns since 1970", "last sample"),
    **_registers(COLUMNS),
    "gap_count": TableColumn(INTEGER, "", "gaps"),
    "jumps": TableColumn(INTEGER, "", "jumps of the stamps"),
    "meter_location": TableColumn(TEXT, "", "grid or dc_bus; null without a meter"),
    "power_error_rms": TableColumn(FLOAT, "W", "predicted minus measured, reading by reading"),
    "measured_power_rms": TableColumn(FLOAT, "W", "of the measured power"),
    "energy_std": TableColumn(FLOAT, "J", "standard deviation of the predicted net energy"),
    "energy_lower": TableColumn(FLOAT, "J", "lower end of its 90 % band"),
    "energy_upper": TableColumn(FLOAT, "J", "upper end of its 90 % band"),
    "band": TableColumn(TEXT, "", "parametric, or calibrated by the meter"),
    "payload_mass": TableColumn(FLOAT, "kg", "that the model carried at the end"),
    "motor_temperature_degc": TableColumn(FLOAT, "degC", "mean over joints in motion"),
    "jobs_left_out": TableColumn(INTEGER, "", "jobs of which the bag holds a part only"),
    "samples": TableColumn(INTEGER, "", "joint states that gave a power"),
    "quality": TableColumn(
        pl.List(pl.Struct({"name": TEXT, "count": INTEGER})), "", "samples by quality bit"
    ),
    "rejected": TableColumn(
        pl.List(pl.Struct({"input": TEXT, "reason": TEXT, "count": INTEGER})),
        "",
        "messages and values refused, by input and reason",
    ),
}
REPORTED = (
    "key", "bag", "robot", "model_id", "settings", "reason", "problems", "start_ns", "end_ns",
    "observed_ns", "compared_ns", "predicted_import_microjoule", "brake_microjoule", *AT_METER,
    "motor_temperature_degc", "jobs_left_out",
)  # fmt: skip
"""Columns of runs that reports read: all would take half as long again."""
JOBS: Columns = {
    "name": TableColumn(TEXT, "", "of the job"),
    "start_ns": RUNS["start_ns"],
    "end_ns": RUNS["end_ns"],
    **_registers(("observed_ns", "gap_ns", "compared_ns", *EXACT_FIELDS.values(), *AT_METER)),
    "energy_band": TableColumn(FLOAT, "J", "half width of the 90 % band of the net energy"),
    "peak_power": TableColumn(FLOAT, "W", "highest predicted"),
}
HOURS: Columns = {
    "hour_ns": TableColumn(INTEGER, "ns since 1970", "begin of the UTC hour"),
    "motion_ns": TableColumn(INTEGER, "ns", "time not at rest"),
    **_registers(("observed_ns", "predicted_import_microjoule")),
    "standby_ns": TableColumn(
        INTEGER, "ns", "register: a rest is in the hour in which it has lasted a minute"
    ),
    "standby_microjoule": TableColumn(INTEGER, "uJ", "of standby_ns"),
}
JOINTS: Columns = {
    "joint": TableColumn(TEXT, "", "name"),
    "friction_rows": TableColumn(INTEGER, "", "samples behind friction_sums"),
    "motion_time": TableColumn(FLOAT, "s", "of these samples"),
    "motor_temperature_degc": TableColumn(FLOAT, "degC", "mean"),
    "friction_sums": TableColumn(
        FLOATS, "SI", "sums of products, upper triangle: see bag_joints.py"
    ),
    "wear_stamp_ns": TableColumn(
        pl.List(INTEGER), "ns since 1970", "of the records of the wear alarm"
    ),
    "wear_hours": TableColumn(FLOATS, "h", "time that they cover"),
    "wear_time": TableColumn(FLOATS, "s", "in motion"),
    "wear_excess": TableColumn(FLOATS, "-", "excess of friction over the model"),
    "wear_variance": TableColumn(FLOATS, "-", "of it"),
    "wear_features": TableColumn(FLOATS, "-", "what it was at"),
    **_registers(f"{name}_microjoule" for name in JOINT_ENERGIES),
}
METER_ERRORS: Columns = {
    "degc": TableColumn(FLOAT, "degC", "middle of the bin of the mean motor temperature"),
    "compared_ns": TableColumn(INTEGER, "ns", "time compared"),
    "measured": TableColumn(FLOAT, "J", "measured energy"),
    "error": TableColumn(FLOAT, "J", "predicted minus measured"),
    "error_squares": TableColumn(FLOAT, "W2 s", "sum of squared power error times time"),
}
TABLES: dict[str, Columns] = {
    "jobs": JOBS, "hours": HOURS, "joints": JOINTS, "meter_errors": METER_ERRORS
}  # fmt: skip
"""Lists in a row, each with rows of its own."""
SCHEMA = pl.Schema(
    {name: column.kind for name, column in RUNS.items()}
    | {
        name: pl.List(pl.Struct({key: column.kind for key, column in columns.items()}))
        for name, columns in TABLES.items()
    }
)


def is_history(folder: str | Path) -> bool:
    """Whether a folder is that of a history."""
    return (Path(folder).expanduser() / FILE).is_file()


def history_tables(folder: str | Path) -> FleetTables:
    """Return a history as tables: each epoch of a robot is what a bag is in a dataset.

    Spans that no hour holds are in the runs, and in no hour. Sums of friction are not kept in a
    history, so nothing is said of wear and no friction can be identified. Time in motion is that
    outside of the phase ``hold``.
    """
    with reader(folder) as connection:
        runs: list[dict[str, Any]] = []
        for epoch, robot, origin, *texts in connection.execute(
            "SELECT e.id, r.name, e.origin, e.first, e.last FROM epoch e JOIN robot r "
            "ON r.id = e.robot ORDER BY e.id"
        ):
            first, last = map(reading_from, texts)
            used = (b - a for a, b in zip(first.values, last.values, strict=True))
            runs.append(
                {
                    "key": str(epoch), "robot": robot, "bag": origin, "model_id": last.model_id,
                    "reason": "", "problems": [], "start_ns": first.stamp_ns,
                    "end_ns": last.stamp_ns, "jobs_left_out": 0,
                    **dict(zip(COLUMNS, used, strict=True)),
                }
            )  # fmt: skip
        hours = connection.execute(
            f"SELECT CAST(epoch AS TEXT), r.name, s.start / {HOUR_NS} * {HOUR_NS} AS hour, "
            "sum(observed_ns - hold_ns), sum(observed_ns), sum(predicted_import_microjoule), "
            "sum(standby_ns), sum(standby_microjoule) FROM (SELECT * FROM slot15 WHERE NOT "
            "flags & 1 UNION ALL SELECT * FROM slot60 WHERE start < ?) s JOIN robot r "
            "ON r.id = s.robot GROUP BY epoch, hour ORDER BY hour, epoch",
            (Rolled.of(connection).quarters_from_ns,),
        ).fetchall()
        jobs = connection.execute(
            "SELECT CAST(min(e.id) AS TEXT), r.name, j.name, j.start, j.stop, "
            f"{', '.join(f'j.{name}' for name in JOB_SUMS)} FROM job j JOIN robot r "
            "ON r.id = j.robot JOIN epoch e ON e.robot = j.robot "
            "AND j.stop > json_extract(e.first, '$.stamp_ns') "
            "AND j.stop <= json_extract(e.last, '$.stamp_ns') "
            "GROUP BY j.robot, j.start, j.id ORDER BY j.start"
        ).fetchall()

    def table(rows: list[Any], columns: Columns, *names: str) -> pl.DataFrame:
        kinds = {"key": TEXT, "robot": TEXT} | {
            name: columns[name].kind for name in names or columns
        }
        return in_si(pl.DataFrame(rows, schema=kinds, orient="row"))

    return FleetTables(
        in_si(pl.DataFrame(runs, schema={name: RUNS[name].kind for name in REPORTED})),
        table(jobs, JOBS, "name", "start_ns", "end_ns", *JOB_SUMS),
        table(hours, HOURS),
        table([], JOINTS),
    )
