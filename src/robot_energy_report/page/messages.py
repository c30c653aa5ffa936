"""Serialised messages of the monitors -> plain columns and rows for the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from robot_energy.accounting.load_curve import Remark
from robot_energy.bag.cdr import Decoder, RawBatch, Run, stamp_ns
from robot_energy.foundation.shown_text import shown
from robot_energy.messages.fields import ENERGY_REGISTERS, FRAME, JOINT_FIELDS, RECORDING, STAMP
from robot_energy.messages.friction import JOINT_FRICTION
from robot_energy.messages.power import POWER_STATE
from robot_energy.timeline.blocks import NANOSECOND, Phase
from robot_energy.timeline.stamps import valid_stamps
from robot_energy_report.page.alarms import PageFinding
from robot_energy_report.page.json_numbers import json_number

LOAD_POWERS = ("state", "remarks", "power", "model_power", "measured_power")
LOAD_ENERGIES = ("energy", "known_time", "missing_time", "outlet_energy")
SENTENCES = {
    Remark.STATE_UNKNOWN: (
        "its state is not known",
        "let it publish the number of its state, or set the key state in the model file",
    ),
    Remark.METER_MISSING: (
        "no reading of its meter has come: its power is missing",
        "start the driver of the meter, or name its topic under auxiliary_meters",
    ),
    Remark.METER_STALE: (
        "the newest reading of its meter is too old",
        "check whether the driver of the meter still publishes",
    ),
    Remark.METER_REFUSED: (
        "the newest reading of its meter was refused",
        "check unit and scale of the meter, and its driver",
    ),
}
Load = dict[str, Any]
MAX_INTERVALS = 20  # shown, the newest first
FIGURES = (
    "predicted_import_energy", "measured_energy", "predicted_energy_at_meter", "coverage",
    "predicted_peak_power",
)  # fmt: skip
Fields = dict[str, Any]
"""Fields of a job interval as `interval_fields` names them."""


def newest_loads(run: Run) -> list[Load]:
    """Return name, state and powers of each load in the newest power state of a run."""
    names = run.names("auxiliary.name")
    states = cast("tuple[tuple[str, ...], ...]", run.columns["auxiliary.states"]) if names else ()
    found: list[Load] = []
    for place, (name, known) in enumerate(zip(names, states, strict=True)):
        row = {key: float(run.array(f"auxiliary.{key}")[-1, place]) for key in LOAD_POWERS}
        number = int(row.pop("state"))
        state = known[number] if 0 <= number < len(known) else None
        found.append({"name": name, "state": state, **row})
    return found


def load_rows(newest: Sequence[Load], counted: Sequence[Load], live: bool) -> list[Load]:
    """Return the loads, as they are now and as registers count them; None where unknown."""
    energies = {load["name"]: load for load in counted}
    powers = {load["name"]: load for load in newest}
    rows: list[Load] = []
    for name in dict.fromkeys([*powers, *energies]):
        now, energy = powers.get(name, {}) if live else {}, energies.get(name, {})
        rows.append(
            {
                "name": shown(name),
                "state": shown(now["state"]) if now.get("state") else None,
                **{key: json_number(now.get(key), 5) for key in ("power", "measured_power")},
                **{key: json_number(energy.get(key)) for key in LOAD_ENERGIES},
            }
        )
    return rows


def load_alarms(newest: Sequence[Load]) -> list[PageFinding]:
    """Return what is wrong with the power of loads."""
    return [
        PageFinding("WARN", shown(load["name"]), message, remedy)
        for load in newest
        if not math.isfinite(load["power"])
        for remark, (message, remedy) in SENTENCES.items()
        if remark in Remark(int(load["remarks"]))
    ]


def last_job(intervals: Sequence[Fields]) -> dict[str, Any] | None:
    """Return the last closed interval and the mean of those with its name; None without one."""
    closed = [one for one in intervals if not one["is_open"]]
    if not closed:
        return None
    last = closed[-1]
    same = [one["predicted_import_energy"] for one in closed if one["name"] == last["name"]]
    return {
        "name": shown(last["name"]),
        "energy": json_number(last["predicted_import_energy"]),
        "mean": json_number(math.fsum(same) / len(same)),
        "count": len(same),
    }


def job_rows(intervals: Sequence[Fields]) -> list[dict[str, Any]]:
    """Return the newest intervals as plain values, newest first; argument as in `last_job`."""
    return [
        {
            "id": int(one["id"]),
            "name": shown(one["name"]),
            "is_open": bool(one["is_open"]),
            "start": one["start_ns"] * NANOSECOND,
            "seconds": json_number(one["observed_time"] + one["gap_time"]),
            **{name: json_number(one[name]) for name in FIGURES},
        }
        for one in intervals[-MAX_INTERVALS:][::-1]
    ]


POWERS = (
    "predicted_grid_power",
    "measured_power",
    "predicted_power_at_meter",
    "predicted_power_lower",
    "predicted_power_upper",
)  # the channels of the history
TOTALS = ("loss_dc", "loss_grid", "brake_power", "capacitor_power", "returned_power")
STATE = ("coverage", "band")
JOINT_POWERS = ("rigid_power", "friction_power", "drive_loss")
JOINT_STATE = ("motor_temperature_degc", "motor_torque", "motor_velocity", "coulomb", "viscous")
ENERGIES = (
    "predicted_import_energy", "predicted_return_energy", "predicted_energy_band",
    "predicted_energy_learned", "measured_energy", "predicted_energy_at_meter", "brake_energy",
    "loss_dc_energy", "loss_grid_energy", "capacitor_energy",
)  # fmt: skip
OUTLET = ("outlet_energy", "outlet_time")
TIMES = ("observed_time", "gap_time", "comparison_time", "gap_count")
JOINT_ENERGIES = tuple(JOINT_FIELDS.values())
MAX_JOINTS = 100  # of a robot whose messages are taken


class PageReaders:
    """Decoders of the topics that the page shows."""

    def __init__(self) -> None:
        identity = (*STAMP, "model_id")
        self._power = Decoder(
            POWER_STATE,
            (
                *identity, "quality", "phase", "period", "meter_location", *POWERS, *TOTALS,
                *STATE, "joints.name", *(f"joints.{name}" for name in JOINT_POWERS + JOINT_STATE),
                "outlet_power", "auxiliary.name", "auxiliary.states",
                *(f"auxiliary.{name}" for name in LOAD_POWERS),
            ),
        )  # fmt: skip
        self._registers = Decoder(
            ENERGY_REGISTERS,
            (
                *(*identity, FRAME, "energy_start.sec", "energy_start.nanosec", "persisted"),
                *(*ENERGIES, *TIMES, *OUTLET, "phase_microjoule", "phase_ns"),
                *("joints.name", *(f"joints.{name}" for name in JOINT_ENERGIES)),
                "auxiliary.name", *(f"auxiliary.{name}" for name in LOAD_ENERGIES),
            ),
        )  # fmt: skip
        self._friction = Decoder(
            JOINT_FRICTION,
            (
                *STAMP, "joint_names", "temperature_source", "stale_after",
                "temperature_stamp.sec", "temperature_stamp.nanosec",
            ),
        )  # fmt: skip

    def power(self, batch: RawBatch) -> list[Run]:
        """Return the usable power states of a batch; those of one model and joint list a run."""
        return _usable(self._power, batch, "joints.name")

    def registers(self, batch: RawBatch) -> dict[str, Any] | None:
        """Return the fields of the newest registers, or None; batch as in `PageReaders.power`.

        Energies of the robot are NaN while no time was observed: 0 J would be a result.
        """
        runs = _usable(self._registers, batch, "joints.name")
        if not runs:
            return None
        run = runs[-1]
        found: dict[str, Any] = {
            "stamp_ns": int(stamp_ns(run)[-1]),
            "start_ns": int(stamp_ns(run, "energy_start")[-1]),
            "persisted": bool(run.array("persisted")[-1]),
            "model_id": run.columns["model_id"],
            "recording": run.columns[FRAME] == RECORDING,
            **{name: float(run.array(name)[-1]) for name in ENERGIES + TIMES + OUTLET},
            "phases": [run.array(name)[-1].tolist() for name in ("phase_ns", "phase_microjoule")],
            "joints": _newest_rows(run, "joints", JOINT_ENERGIES),
            "auxiliary": _newest_rows(run, "auxiliary", LOAD_ENERGIES),
        }
        if not found["observed_time"] > 0.0:
            found |= dict.fromkeys(ENERGIES, math.nan)
            for joint in found["joints"]:
                joint |= dict.fromkeys(JOINT_ENERGIES, math.nan)
        return found

    def friction(self, batch: RawBatch) -> dict[str, dict[str, Any]] | None:
        """Return the newest friction of each joint, or None; batch as in `PageReaders.power`."""
        runs = _usable(self._friction, batch, "joint_names")
        if not runs:
            return None
        run = runs[-1]
        names, source = run.names("joint_names"), run.array("temperature_source")
        if source.ndim != 2 or source.shape[1] != len(names):
            return None
        taken = stamp_ns(run, "temperature_stamp")[-1]
        return {
            name: {
                "source": int(source[-1, place]),
                "temperature_time": float(taken[place]) * NANOSECOND if taken[place] > 0 else None,
                "stale_after": float(run.array("stale_after")[-1]),
            }
            for place, name in enumerate(names)
        }


def phase_rows(registers: dict[str, Any]) -> list[dict[str, Any]]:
    """Return name, time [s], drawn energy [J] and mean power [W] of each phase that was met."""
    return [
        {
            "name": phase.name,
            "seconds": time_ns * NANOSECOND,
            "energy": microjoule / 1e6,
            "mean": json_number(microjoule * 1e3 / time_ns, 5),
        }
        for phase, time_ns, microjoule in zip(Phase, *registers["phases"], strict=True)
        if time_ns > 0
    ]


def net_energy(registers: dict[str, Any]) -> float:
    """Return the energy from the grid minus what was fed back. [J]"""
    return float(registers["predicted_import_energy"] - registers["predicted_return_energy"])


def _newest_rows(run: Run, entries: str, fields: Sequence[str]) -> list[dict[str, Any]]:
    newest = {field: run.array(f"{entries}.{field}")[-1] for field in fields}
    return [
        {"name": name, **{field: float(newest[field][place]) for field in fields}}
        for place, name in enumerate(run.names(f"{entries}.name"))
    ]


def _usable(decoder: Decoder, batch: RawBatch, names: str) -> list[Run]:
    """Runs with valid stamps and a bounded number of joints, in order of arrival."""
    kept: list[Run] = []
    for run in decoder.decode(batch).runs:
        joints = cast("tuple[str, ...]", run.columns[names])
        loads = cast("tuple[str, ...]", run.columns.get("auxiliary.name", ()))
        valid = valid_stamps(stamp_ns(run))
        if max(len(joints), len(loads)) > MAX_JOINTS or not valid.any():
            continue
        if valid.all():
            kept.append(run)
        else:
            columns = {
                path: column[valid] if isinstance(column, np.ndarray) else column
                for path, column in run.columns.items()
            }
            kept.append(Run(run.rows[valid], columns))
    return kept
