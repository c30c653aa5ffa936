"""One bag of a fleet to one row of its dataset: what a worker does."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

from robot_energy import __version__
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.totals import Totals
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import DatasetError, RobotEnergyError
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.foundation.kinds import load_kinds
from robot_energy.foundation.process_memory import keep_freed_memory, peak_memory
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import SECOND_NS
from robot_energy.messages.fields import EXACT_FIELDS
from robot_energy.messages.registers import exact_columns
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.recorded_jobs import MAX_LATE_NS, load_jobs
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import ReplayReport, replay_report
from robot_energy.timeline.blocks import Phase
from robot_energy_fleet.bag_joints import JointSums
from robot_energy_fleet.bag_list import FleetBag
from robot_energy_fleet.bag_places import BagPlace, file_system
from robot_energy_fleet.bag_sums import HourSums, MeterErrors
from robot_energy_fleet.dataset import UNKNOWN_DATE, RowKey, row_bytes
from robot_energy_fleet.tables import AT_METER, JOINT_ENERGIES, SCHEMA, TABLES
from robot_energy_history.bags import BagReadings
from robot_energy_history.database import JOB_SUMS
from robot_energy_history.readings import (
    COLUMNS,
    FROM_MESSAGE,
    JOINT_COLUMNS,
    OF_JOINTS,
    Reading,
)
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.provenance import sha256_of

Row = dict[str, Any]
_load_kinds = cache(load_kinds)  # of the user, which a worker has not loaded yet


class BagRow(Described):
    """What a worker gives back."""

    key: Annotated[RowKey, "Of which bag it is, and why that could not be used, if so."]
    date: str
    data: bytes
    problems: Annotated[tuple[str, ...], "What was wrong with a bag that was used."]
    jobs_left_out: Annotated[int, "Jobs of which the bag holds a part only, how many."]
    observed_time: Annotated[float, "Predicted. [s]"]
    peak_memory: Annotated[int, "Most memory that the process has held so far. [bytes]"]
    history: Annotated[BagReadings | None, "Registers of minutes, and jobs; None: not asked."] = (
        None
    )


def refused(bag: FleetBag, error: BaseException, bag_hash: str | None = None) -> BagRow:
    """Return the row of a bag that could not be used.

    Args:
        bag_hash: Hash of its content; None if it could not be read, so that the next run tries
            again.
    """
    if isinstance(error, RobotEnergyError):
        found, expected, remedy = error.found, error.expected, error.remedy
    elif isinstance(error, OSError):
        found, expected, remedy = f"{bag.place.address} cannot be read ({error})", "a bag", ""
    else:
        found = f"unexpected error, {type(error).__name__}: {' '.join(str(error).split())}"
        expected, remedy = "a bag that can be replayed", "report it with the bag"
    row = _common(bag, bag_hash) | {"reason": found, "expected": expected, "remedy": remedy}
    name = bag.unread_name if bag_hash is None else bag.name
    return _sealed(bag, name, row, UNKNOWN_DATE, 0.0)


@one_thread
def replay_bag(bag: FleetBag, model: RobotModel, max_scratch: int) -> BagRow:
    """Return the row of a bag; whatever is wrong with it becomes a row with the reason."""
    if bag.version != __version__:
        raise DatasetError(
            f"a worker runs version {__version__}",
            f"version {bag.version}, as the command",
            "install the same version on all hosts",
        )
    keep_freed_memory()
    bag_hash = None
    try:
        _load_kinds()
        with contextlib.ExitStack() as stack:
            scratch = stack.enter_context(TemporaryFolder()).path
            path = _here(bag.place, scratch, max_scratch)
            bag_hash = sha256_of(path)
            return _replayed(bag, bag_hash, path, model, scratch)
    except Exception as error:  # a bag stops no fleet
        return refused(bag, error, None if isinstance(error, OSError) else bag_hash)


def _here(place: BagPlace, scratch: Path, max_scratch: int) -> Path:
    if place.is_local:
        return Path(place.address)
    if place.size > max_scratch:
        raise DatasetError(
            f"{place.address} has {place.size / 1e9:.2f} GB",
            f"at most {max_scratch / 1e9:.2f} GB to copy to this host",
            "raise --scratch, or split the bag",
        )
    target = scratch / "bag"
    target.mkdir()
    for address in place.files:
        system, path = file_system(address)
        system.get_file(path, str(target / PurePosixPath(path).name))
    return target if place.is_folder else target / PurePosixPath(place.address).name


def _replayed(bag: FleetBag, bag_hash: str, path: Path, model: RobotModel, scratch: Path) -> BagRow:
    options: Any = dict(bag.options)
    for name, text in bag.texts.items():
        file = scratch / f"{name}.yaml"
        file.write_text(text, encoding="utf-8")
        options[name] = file
    joints, hours, errors = JointSums(model), HourSums(), MeterErrors()
    readings: list[Reading] = []

    def take(output: Output) -> None:
        joints.take(output)
        errors.take(output)

    def read(account: EnergyAccount, minute_ns: int) -> None:
        hours.take(account)
        if bag.with_history and (reading := reading_of(account, model, minute_ns)) is not None:
            readings.append(reading)

    setup = ReplaySetup.of(options)
    result = replay(path, model, setup, on_output=take, on_reading=read, on_compared=errors.compare)
    report, totals = replay_report(result), result.account.totals()
    rows = joints.table(result.pipeline.condition.wear)
    start_ns = report.time.start_ns
    day = UNKNOWN_DATE
    if start_ns is not None:
        day = f"{local_time(start_ns):%Y-%m-%d}"
    listed, registers = list(_jobs(result, report)), totals.joint_energy_microjoule
    row = {
        **_common(bag, bag_hash),
        **_counted(result, report, totals),
        "reason": "",
        "problems": [
            *report.problems,
            *(one.sentence for one in result.joint_states.findings() if one.wrong_power),
        ],
        "date": day,
        "motor_temperature_degc": _mean_degc(rows),
        "jobs": listed,
        "jobs_left_out": _left_out(options.get("jobs"), result, report),
        "hours": hours.table(),
        "joints": [
            own | {f"{name}_microjoule": registers[name][joint] for name in JOINT_ENERGIES}
            for joint, own in enumerate(rows)
        ],
        "meter_errors": errors.table(),
    }
    sealed = _sealed(bag, bag.name, row, day, report.time.observed_time)
    if not bag.with_history:
        return sealed
    jobs = tuple(_history_job(place, one) for place, one in enumerate(listed))
    return replace(sealed, history=BagReadings(bag.robot, bag.name, tuple(readings), jobs))


def _common(bag: FleetBag, bag_hash: str | None) -> Row:
    """What holds for a bag whether it can be used or not."""
    content = bag_hash or f"{bag.place.address} {bag.place.state}"
    texts = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in bag.texts.items()}
    return {
        "key": hashlib.sha256(f"{content} {bag.settings}".encode()).hexdigest(),
        "bag": bag.place.address,
        "bag_hash": bag_hash,
        "robot": bag.robot,
        "date": UNKNOWN_DATE,
        "programme": bag.programme,
        "shift": bag.shift,
        "model_id": "",
        "settings": json.dumps({"model": bag.model, **bag.options, **texts}, sort_keys=True),
        "tool_version": bag.version,
    }


def _counted(result: Replay, report: ReplayReport, totals: Totals) -> Row:
    compared = totals.compared_ns > 0
    registers = dict(zip(COLUMNS, register_values(result.account), strict=True))
    return {
        **registers,
        **({} if compared else dict.fromkeys(AT_METER)),
        "model_id": report.model.model_id,
        "start_ns": report.time.start_ns,
        "end_ns": report.time.end_ns,
        "gap_count": totals.gap_count,
        "jumps": totals.jumps,
        "meter_location": report.comparison.meter_location if compared else None,
        "power_error_rms": report.comparison.power_error_rms,
        "measured_power_rms": report.comparison.measured_power_rms,
        "energy_std": report.uncertainty.std,
        "energy_lower": report.uncertainty.lower,
        "energy_upper": report.uncertainty.upper,
        "band": report.uncertainty.band,
        "payload_mass": float(result.pipeline.torque.robot.payload_mass),
        "samples": report.quality.samples,
        "quality": [
            {"name": name, "count": count} for name, count in report.quality.counts.items()
        ],
        "rejected": [
            {"input": name, "reason": str(reason), "count": count}
            for name, account in report.inputs.items()
            for reason, count in account.rejected.items()
        ],
    }


def _jobs(result: Replay, report: ReplayReport) -> Iterator[Row]:
    for counted, figures in zip(result.jobs.closed, report.jobs, strict=True):
        own = counted.counted
        at_meter = own.measured_energy_microjoule, own.predicted_energy_at_meter_microjoule
        known = at_meter if own.compared_ns > 0 else (None, None)
        yield {
            **{field: own.cabinet_energy_microjoule[key] for key, field in EXACT_FIELDS.items()},
            **dict(zip(AT_METER, known, strict=True)),
            "observed_ns": own.observed_ns,
            "gap_ns": own.gap_ns,
            "compared_ns": own.compared_ns,
            "name": counted.name,
            "start_ns": counted.start_ns,
            "end_ns": counted.end_ns,
            "energy_band": figures.energy_band,
            "peak_power": figures.peak_grid_power,
        }


def _left_out(jobs: Path | None, result: Replay, report: ReplayReport) -> int:
    """Jobs of which the bag holds a part only: the list may be that of many bags."""
    start_ns, end_ns = report.time.start_ns, report.time.end_ns
    if jobs is None or start_ns is None or end_ns is None:
        return 0
    first, last = start_ns + MAX_LATE_NS, end_ns - MAX_LATE_NS
    listed = ((round(one.begin * SECOND_NS), round(one.end * SECOND_NS)) for one in load_jobs(jobs))
    whole = ((one.start_ns, one.end_ns) for one in result.jobs.closed)
    held, counted = (
        sum(begin < last and end > first for begin, end in spans) for spans in (listed, whole)
    )
    return max(0, held - counted)


def _mean_degc(joints: list[Row]) -> float | None:
    """Mean motor temperature over joints in motion, each weighted by its time."""
    known = [row for row in joints if row["motor_temperature_degc"] is not None]
    time = sum(row["motion_time"] for row in known)
    heat = sum(row["motion_time"] * row["motor_temperature_degc"] for row in known)
    return heat / time if time else None


def _sealed(bag: FleetBag, name: str, row: Row, date: str, observed_time: float) -> BagRow:
    whole = {column: value for column, value in (row | {"name": name}).items() if column in SCHEMA}
    for table, columns in TABLES.items():
        whole[table] = [{one: part.get(one) for one in columns} for part in row.get(table, [])]
    return BagRow(
        RowKey(*(whole[field] for field in RowKey._fields)),
        date,
        row_bytes(whole),
        tuple(row.get("problems", ())),
        row.get("jobs_left_out", 0),
        observed_time,
        peak_memory(),
    )


def register_values(account: EnergyAccount) -> tuple[int, ...]:
    """Return the registers of an account as a history has them, by `COLUMNS`."""
    exact: dict[str, Any] = exact_columns(account)
    phases = (exact[f"phase_{unit}"][0, Phase.HOLD :].tolist() for unit in ("microjoule", "ns"))
    joints = (exact[f"joints.{name}"].sum() for name in OF_JOINTS)
    plain = (exact[name] for name in FROM_MESSAGE)
    values: tuple[Any, ...] = (*plain, *chain(*phases), *joints)
    return tuple(map(int, values))


def reading_of(account: EnergyAccount, model: RobotModel, minute_ns: int) -> Reading | None:
    """Return the registers as a monitor would publish them; None before the first sample.

    Args:
        minute_ns: UTC minute up to which all samples are counted; 0 for none. [ns]
    """
    start_ns, end_ns, exact = account.start_ns, account.end_ns, exact_columns(account)
    if start_ns is None or end_ns is None:
        return None
    of_joints = zip(*(exact[f"joints.{name}"][0].tolist() for name in JOINT_COLUMNS), strict=True)
    return Reading(
        start_ns, end_ns, minute_ns, model.model_id, int(exact["meter_location"]),
        register_values(account), dict(zip(model.joint_names, of_joints, strict=True)),
    )  # fmt: skip


def _history_job(number: int, job: dict[str, Any]) -> dict[str, Any]:
    """A job of a bag as the history has it."""
    sums = {name: job[name] or 0 for name in JOB_SUMS}
    own = {"id": number, "start": job["start_ns"], "stop": job["end_ns"], "name": job["name"]}
    return {**own, **sums, "peak_power": job["peak_power"]}
