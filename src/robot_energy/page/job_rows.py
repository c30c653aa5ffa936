"""Job intervals as the page shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from robot_energy.blocks import NANOSECOND
from robot_energy.page.json_numbers import json_number
from robot_energy.shown_text import shown

MAX_INTERVALS = 20  # shown, the newest first
FIGURES = (
    "predicted_import_energy",
    "measured_energy",
    "predicted_energy_at_meter",
    "coverage",
    "predicted_peak_power",
)
Fields = dict[str, Any]
"""Fields of a job interval as `interval_fields` names them."""


def last_job(intervals: Sequence[Fields]) -> dict[str, Any] | None:
    """Return the last closed interval and the mean of those with its name; None without one.

    Args:
        intervals: Newest last.
    """
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
    """Return the newest intervals as plain values, the newest first.

    Args:
        intervals: Newest last.
    """
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
