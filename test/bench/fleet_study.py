"""How often the report of a fleet finds the faults, and how often one that is not there.

The fleets are those of `robot_energy_studies.generated_fleet`, without the way through bags: rig
and pipeline are joined directly, which takes a third of the time. All that the report reads comes
from the same accumulators; only the energy of a job is summed here, from the samples and the meter.

    python test/bench/fleet_study.py SEEDS [--sound]
"""

from __future__ import annotations

import time
from argparse import ArgumentParser
from collections.abc import Iterable, Iterator
from typing import Annotated, Any

import numpy as np
import polars as pl

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel, load
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Learning
from robot_energy_fleet.bag_joints import JointSums
from robot_energy_fleet.bag_row import register_values
from robot_energy_fleet.bag_sums import HourSums
from robot_energy_fleet.report import fleet_report
from robot_energy_fleet.results.fleet import FleetReport
from robot_energy_fleet.tables import RUNS, TABLES, FleetTables, in_si
from robot_energy_history.readings import COLUMNS
from robot_energy_rig.config import RigOutput
from robot_energy_studies.generated_fleet import ROBOT, FleetPlan, Visit, visits
from robot_energy_studies.learning_study import joint_block, pipeline_of

STEP = 30.0  # of rig and pipeline [s]
CAUSES = {"wear": "friction"}  # kinds of findings that mean the same fault
Rows = dict[str, list[dict[str, Any]]]


class FleetRow(Described):
    """What the report of one fleet has found."""

    found: tuple[str, ...]
    missed: Annotated[tuple[str, ...], "Robots with a fault that is not named."]
    false: Annotated[
        tuple[str, ...], "Findings of a fault on a robot that has another one, or none."
    ]
    report: FleetReport


def judged(report: FleetReport, faults: dict[str, str]) -> FleetRow:
    """Return what a report has found of what was made.

    Energy and friction of a robot with a fault may differ as a consequence of it; they count as
    false on a robot without one.
    """
    named = {(one.robot, CAUSES.get(one.kind, one.kind)) for one in report.findings}
    causes = {(robot, kind) for robot, kind in named if kind in ("payload", "friction", "standby")}
    found = [robot for robot, kind in faults.items() if (robot, kind) in causes]
    false = [
        f"{robot}: {kind}"
        for robot, kind in sorted(named)
        if faults.get(robot) != kind and not (robot in faults and kind == "energy")
    ]
    missed = tuple(robot for robot in faults if robot not in found)
    return FleetRow(tuple(found), missed, tuple(false), report)


def tables_of(bags: Iterable[Rows]) -> FleetTables:
    """Return the rows of many bags, by the columns of a dataset, as tables."""
    rows: Rows = {name: [] for name in ("runs", "jobs", "hours", "joints")}
    for bag in bags:
        for name, own in bag.items():
            rows[name] += own
    of_bag, columns = {"key": pl.String, "robot": pl.String}, {"runs": RUNS, **TABLES}
    kinds = {name: of_bag | {key: one.kind for key, one in columns[name].items()} for name in rows}
    return FleetTables(
        **{name: in_si(pl.DataFrame(own, schema=kinds[name])) for name, own in rows.items()}
    )


def fleet_tables(plan: FleetPlan) -> FleetTables:
    """Return the tables of a generated fleet, without bags."""
    model = load(ROBOT)
    return tables_of(_rows(visit, model, key) for key, visit in enumerate(visits(plan)))


def _rows(visit: Visit, model: RobotModel, key: int) -> Rows:
    pipeline = pipeline_of(model, Learning.OBSERVE, with_torque=True)
    joints, hours = JointSums(model), HourSums()
    pipeline.account.on_reading = lambda ns: hours.take(pipeline.account)
    power: list[tuple[Int, Float]] = []
    meter: list[tuple[Int, Float]] = []

    def take(output: Output) -> None:
        joints.take(output)
        if output.power is not None:
            power.append((output.power.stamp_ns, output.power.grid_power))
        if output.meter is not None:
            meter.append((output.meter.stamp_ns, output.meter.power * output.meter.interval))

    for output in _steps(visit):
        take(pipeline.step(joint_block(output.joints), output.temperatures, output.meter))
    take(pipeline.flush())
    hours.take(pipeline.account)
    stamp_ns, grid = (np.concatenate(parts) for parts in zip(*power, strict=True))
    read_ns, read = (np.concatenate(parts) for parts in zip(*meter, strict=True))
    own = {"key": str(key), "robot": visit.robot}
    rows, registers = joints.table(pipeline.condition.wear), register_values(pipeline.account)
    known = [row["motor_temperature_degc"] for row in rows]
    jobs: list[dict[str, Any]] = []
    for begin, end in visit.jobs:
        first, last = round(begin / NANOSECOND), round(end / NANOSECOND)
        inside = (stamp_ns >= first) & (stamp_ns <= last)
        within = (read_ns > first) & (read_ns <= last)
        energy = float(np.trapezoid(grid[inside], stamp_ns[inside] * NANOSECOND))
        jobs.append(
            own
            | {
                "name": visit.programme, "start_ns": first, "end_ns": last,
                "observed_ns": last - first, "gap_ns": 0, "compared_ns": last - first,
                "predicted_import_microjoule": round(energy * 1e6),
                "predicted_return_microjoule": 0,
                "measured_microjoule": round(float(read[within].sum()) * 1e6),
                "predicted_microjoule_at_meter": round(energy * 1e6),
            }
        )  # fmt: skip
    run = own | dict(zip(COLUMNS, registers, strict=True)) | {
        "bag": visit.name, "model_id": model.model_id, "reason": "",
        "start_ns": int(stamp_ns[0]), "end_ns": int(stamp_ns[-1]),
        "motor_temperature_degc": None if None in known else float(np.mean(known)),
    }  # fmt: skip
    return {
        "runs": [run],
        "jobs": jobs,
        "hours": [own | row for row in hours.table()],
        "joints": [own | row for row in rows],
    }


def _steps(visit: Visit) -> Iterator[RigOutput]:
    rig, left = visit.rig, round(visit.duration / visit.rig.period)
    while left > 0:
        count = min(left, round(STEP / rig.period))
        yield rig.step(count)
        left -= count


def main(argv: list[str] | None = None) -> int:
    """Return the exit code, after the reports of several fleets are judged.

    Args:
        argv: Words of the command line; None for those of the process.
    """
    parser = ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("seeds", type=int, nargs="+", help="of the fleets")
    parser.add_argument("--sound", action="store_true", help="without the three faults")
    args = parser.parse_args(argv)
    for seed in args.seeds:
        begun, plan = time.perf_counter(), FleetPlan(seed=seed, faults=not args.sound)
        row = judged(fleet_report(fleet_tables(plan), f"seed {seed}"), plan.faulty())
        print(
            f"seed {seed}: found {len(row.found)} of {len(plan.faulty())}, missed "
            f"{', '.join(row.missed) or 'none'}, false {', '.join(row.false) or 'none'}; "
            f"{row.report.bags} recordings, {time.perf_counter() - begun:.0f} s",
            flush=True,
        )
        for one in row.report.findings:
            print(f"  {one.robot} {one.kind} {one.subject}: {one.sentence}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
