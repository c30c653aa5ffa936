"""The tables that reports of a fleet or a history are made from, and the columns of a dataset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import polars as pl

from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, SHAFT_REGISTERS
from robot_energy.foundation.described import Described
from robot_energy.foundation.units import HOUR_NS, MICROJOULE, SECOND_NS
from robot_energy.timeline.blocks import Phase
from robot_energy_history.database import FILE, reader
from robot_energy_history.readings import COLUMNS
from robot_energy_history.rollup import Rolled
from robot_energy_history.rows import reading_from
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


class FleetTables(Described):
    """Rows of all bags of a fleet."""

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


def tables_of(bags: Iterable[Rows]) -> FleetTables:
    """Return the rows of many bags as tables."""
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


INTEGER, FLOAT, TEXT = pl.Int64(), pl.Float64(), pl.String()
JOINT_ENERGIES = (*JOINT_REGISTERS, *(f"shaft_{name}" for name in SHAFT_REGISTERS))


class TableColumn(NamedTuple):
    """One column."""

    kind: pl.DataType
    unit: str
    text: str


Columns = dict[str, TableColumn]


def _integers(names: Iterable[str], ending: str, unit: str, text: str) -> Columns:
    return {f"{n}_{ending}": TableColumn(INTEGER, unit, text.format(n)) for n in names}


_PHASES = tuple(phase.name.lower() for phase in Phase)

RUNS: Columns = {
    "name": TableColumn(TEXT, "", "hashes of the bag's address, of its state, of the settings"),
    "key": TableColumn(TEXT, "", "hash of bag, model, options and version; unique once read"),
    "bag": TableColumn(TEXT, "", "address of the bag"),
    "bag_hash": TableColumn(TEXT, "", "SHA-256 of its files with messages; null if unreadable"),
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
    "observed_ns": TableColumn(INTEGER, "ns", "time predicted"),
    "gap_ns": TableColumn(INTEGER, "ns", "time not predicted"),
    "gap_count": TableColumn(INTEGER, "", "gaps"),
    "jumps": TableColumn(INTEGER, "", "jumps of the stamps"),
    **_integers(CABINET_REGISTERS, "microjoule", "uJ", "register {}"),
    **_integers(_PHASES, "ns", "ns", "time in phase {}"),
    **_integers((f"{n}_import" for n in _PHASES), "microjoule", "uJ", "from the grid, phase {}"),
    "meter_location": TableColumn(TEXT, "", "grid or dc_bus; null without a meter"),
    "compared_ns": TableColumn(INTEGER, "ns", "time that meter and prediction cover"),
    "measured_microjoule": TableColumn(INTEGER, "uJ", "measured over that time"),
    "predicted_at_meter_microjoule": TableColumn(INTEGER, "uJ", "predicted over that time"),
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
JOBS: Columns = {
    "name": TableColumn(TEXT, "", "of the job"),
    **{name: RUNS[name] for name in (
        "start_ns", "end_ns", "observed_ns", "gap_ns",
        *(f"{name}_microjoule" for name in CABINET_REGISTERS),
        "compared_ns", "measured_microjoule", "predicted_at_meter_microjoule",
    )},
    "energy_band": TableColumn(FLOAT, "J", "half width of the 90 % band of the net energy"),
    "peak_grid_power": TableColumn(FLOAT, "W", "highest predicted"),
}  # fmt: skip
_HOURS = {"hour_ns": ("ns since 1970", "begin of the UTC hour"), "observed_time": ("s", "in it"),
          "motion_time": ("s", "not at rest"), "grid_energy": ("J", "from the grid"),
          "standby_time": ("s", "at rest for 60 s or more, drives on"),
          "standby_energy": ("J", "from the grid in standby")}  # fmt: skip
_SUMS = {"joint": ("", "name"), "friction_rows": ("", "samples behind friction_sums"),
         "motion_time": ("s", "of these samples"), "motor_temperature_degc": ("degC", "mean"),
         "friction_sums": ("SI", "sums of products, upper triangle: see joint_sums.py"),
         "wear_stamp_ns": ("ns since 1970", "of the records of the wear alarm"),
         "wear_hours": ("h", "time that they cover"), "wear_time": ("s", "in motion"),
         "wear_excess": ("-", "excess of friction over the model"),
         "wear_variance": ("-", "of it"), "wear_features": ("-", "what it was at")}  # fmt: skip


def _described(table: str, texts: Mapping[str, tuple[str, str]]) -> Columns:
    """Columns that come as `tables` has them."""
    kinds = pl.Schema(SCHEMAS[table])
    own = {name: kind for name, kind in kinds.items() if name not in ("key", "robot")}
    return {name: TableColumn(kind, *texts.get(name, ("", ""))) for name, kind in own.items()}


HOURS = _described("hours", _HOURS)
JOINTS = _described("joints", _SUMS) | _integers(JOINT_ENERGIES, "microjoule", "uJ", "register {}")
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


ENERGIES = {
    "grid_energy": "predicted_import_microjoule",
    "brake_energy": "brake_microjoule",
    "measured_energy": "measured_microjoule",
    "predicted_energy_at_meter": "predicted_microjoule_at_meter",
}


def is_history(folder: str | Path) -> bool:
    """Whether a folder is that of a history."""
    return (Path(folder).expanduser() / FILE).is_file()


def history_tables(folder: str | Path) -> FleetTables:
    """Return a history as tables: each epoch of a robot is what a bag is in a dataset.

    Spans that no hour holds are in the runs, and in no hour. Sums of friction are not kept in a
    history, so nothing is said of wear and no friction can be identified. Time in motion is that
    outside of the phase ``hold``.
    """
    rows: Rows = {"runs": [], "jobs": [], "hours": [], "joints": []}
    with reader(folder) as connection:
        robots = dict(connection.execute("SELECT id, name FROM robot").fetchall())
        keys: dict[int, dict[str, Any]] = {}
        ends: dict[int, list[tuple[int, int, dict[str, Any]]]] = {}
        for epoch, robot, origin, first_text, last_text in connection.execute(
            "SELECT id, robot, origin, first, last FROM epoch ORDER BY id"
        ):
            first, last = reading_from(first_text), reading_from(last_text)
            used = dict(
                zip(COLUMNS, (b - a for a, b in zip(first.values, last.values, strict=True)),
                    strict=True)
            )  # fmt: skip
            compared = used["compared_ns"] > 0
            key = keys[epoch] = {"key": str(epoch), "robot": robots[robot]}
            ends.setdefault(robot, []).append((first.stamp_ns, last.stamp_ns, key))
            rows["runs"].append(
                {
                    **key, "bag": origin, "model_id": last.model_id, "reason": "", "problems": [],
                    "start_ns": first.stamp_ns, "end_ns": last.stamp_ns, "jobs_left_out": 0,
                    "observed_time": used["observed_ns"] / SECOND_NS,
                    **{
                        name: used[column] * MICROJOULE
                        if compared or name in ("grid_energy", "brake_energy")
                        else None
                        for name, column in ENERGIES.items()
                    },
                }
            )  # fmt: skip
        rows["hours"] = [
            {
                **keys[epoch], "hour_ns": hour, "observed_time": observed / SECOND_NS,
                "motion_time": (observed - held) / SECOND_NS, "grid_energy": used * MICROJOULE,
                "standby_time": standby_ns / SECOND_NS, "standby_energy": standby * MICROJOULE,
            }
            for epoch, hour, observed, held, used, standby_ns, standby in connection.execute(
                f"SELECT epoch, start / {HOUR_NS} * {HOUR_NS} AS hour, sum(observed_ns), "
                "sum(hold_ns), sum(predicted_import_microjoule), sum(standby_ns), "
                "sum(standby_microjoule) FROM (SELECT * FROM slot15 WHERE NOT flags & 1 UNION ALL "
                "SELECT * FROM slot60 WHERE start < ?) GROUP BY epoch, hour ORDER BY hour, epoch",
                (Rolled.of(connection).quarters_from_ns,),
            )
        ]  # fmt: skip
        found = connection.execute("SELECT * FROM job ORDER BY start")
        for values in found:
            job = {one[0]: value for one, value in zip(found.description, values, strict=True)}
            key = next(
                (
                    key
                    for start, stop, key in ends.get(job["robot"], ())
                    if start < job["stop"] <= stop
                ),
                None,
            )
            if key is None:
                continue
            net = job["predicted_import_microjoule"] - job["predicted_return_microjoule"]
            compared = job["compared_ns"] > 0
            rows["jobs"].append(
                {
                    **key, "name": job["name"], "start_ns": job["start"], "end_ns": job["stop"],
                    "time": job["observed_ns"] / SECOND_NS, "gap_time": job["gap_ns"] / SECOND_NS,
                    "energy": net * MICROJOULE,
                    "measured_energy": (
                        job["measured_microjoule"] * MICROJOULE if compared else None
                    ),
                    "predicted_energy_at_meter": (
                        job["predicted_microjoule_at_meter"] * MICROJOULE if compared else None
                    ),
                }
            )  # fmt: skip
    return tables_of([rows])
