"""Job intervals, and loads outside of the cabinet, as the page shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

from robot_energy.accounting.load_curve import Remark
from robot_energy.bag.cdr import Run
from robot_energy.foundation.shown_text import shown
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_report.page.alarms import PageFinding
from robot_energy_report.page.json_numbers import json_number

LOAD_POWERS = ("state", "remarks", "power", "model_power", "measured_power")
LOAD_ENERGIES = ("energy", "known_time", "missing_time", "missing_count", "outlet_energy")
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
    """Return the loads as plain values; None where unknown.

    Args:
        counted: Name and energies of each in the newest registers.
    """
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
