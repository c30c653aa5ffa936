"""Wear that comes slowly, and alarms without wear: 1,000 simulated hours on drawn plants."""

from __future__ import annotations

import math
from statistics import median

from figure import Figure

from robot_energy.rig import random_profile
from robot_energy_papers.wear_study import SlowWearRow, false_alarms, recorded_days, slow_wear

MINUTES = (90.0, 4.0)
PLANTS = (3, 7, 11)
HOURS = 1000.0
RISE, HOURS_OF_RISE = 0.05, 100.0
DAY = 24.0  # h


def run(folder: str, quick: bool) -> list[Figure]:
    """Record days of drawn plants, simulate hours of them, and let each axis wear slowly."""
    plants, days = (PLANTS[:1], 1) if quick else (PLANTS, 2)
    hours = 50.0 if quick else HOURS / len(plants)
    recorded = [recorded_days(random_profile("kr16", seed), days, seed) for seed in plants]
    count = sum(false_alarms(days, hours) for days in recorded)
    figures = [
        Figure(
            f"false alarms in {len(plants) * hours:.0f} h, six axes",
            count,
            "at most 1 in 1,000 h",
            count <= 1,
        )
    ]
    if not quick:
        rows = [
            slow_wear(days, joint, RISE / HOURS_OF_RISE) for days in recorded for joint in range(6)
        ]
        for row in rows:
            print(_text(row), flush=True)
        found = [math.inf if math.isnan(row.motion) else row.motion for row in rows]
        for name, shown in (("median", median(found)), ("last", max(found))):
            for limit in (DAY, HOURS_OF_RISE + DAY):
                figures.append(
                    Figure(
                        f"+5 % per 100 h of one axis, {name} of {len(rows)}: hours of its motion",
                        round(shown) if math.isfinite(shown) else "not found",
                        f"at most {limit:.0f}",
                        shown <= limit,
                    )
                )
    return figures


def _text(row: SlowWearRow) -> str:
    return (
        f"A{row.joint + 1}: found after {row.found:.0f} h, {row.motion:.0f} h of motion; rise then "
        f"{row.true:+.1%}, stated {row.size:+.1%} +- {row.std:.1%}"
    )
