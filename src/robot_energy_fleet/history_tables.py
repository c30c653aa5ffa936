"""A history as the tables that reports of a fleet are made from: live robots and bags alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robot_energy.foundation.units import HOUR_NS, MICROJOULE, SECOND_NS
from robot_energy_fleet.tables import FleetTables, Rows, tables_of
from robot_energy_history.files import reader
from robot_energy_history.readings import COLUMNS
from robot_energy_history.rollup import Rolled
from robot_energy_history.rows import reading_from
from robot_energy_history.schema import FILE

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
        for job in _rows(connection, "SELECT * FROM job ORDER BY start"):
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


def _rows(connection: Any, query: str) -> list[dict[str, Any]]:
    found = connection.execute(query)
    names = [one[0] for one in found.description]
    return [dict(zip(names, row, strict=True)) for row in found]
