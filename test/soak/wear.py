"""Wear in the plant itself, and alarms without wear, on drawn plants over simulated days."""

from __future__ import annotations

import math
from statistics import median

from figure import Figure

from robot_energy_rig import random_profile
from wear_study import simulated, worn_in_plant

MINUTES = (15.0, 2.0)
PLANTS = (3, 7, 11)
DAYS = 42  # 1,008 h of each plant
WORN = (1, 4)
RISE = 0.0005  # in an hour of motion


def run(folder: str, quick: bool) -> list[Figure]:
    """Simulate days without wear, and let two axes of each plant wear at once or slowly."""
    plants, days = (PLANTS[:1], 12) if quick else (PLANTS, DAYS)
    rows = [simulated(random_profile("kr16", seed), seed, days) for seed in plants]
    hours, count = sum(row.hours for row in rows), sum(len(row.alarms) for row in rows)
    figures = [
        Figure(
            f"false alarms in {hours:.0f} h, six axes",
            count,
            "at most 1 in 1,000 h",
            count <= max(1.0, hours / 1000.0),
        )
    ]
    if quick:
        return figures
    for name, rise, limit in (
        ("+15 %", lambda _: 0.15, 1.0),
        ("+5 % per 100 h", lambda passed: RISE * passed, 24.0),
    ):
        worn = [
            worn_in_plant(random_profile("kr16", seed), seed, DAYS, WORN, rise) for seed in plants
        ]
        hours_found = [
            math.inf if math.isnan(hour) else hour for row in worn for hour in row.worn.values()
        ]
        right = all(set(row.named) == set(WORN) for row in worn)
        for which, shown in (("median", median(hours_found)), ("last", max(hours_found))):
            figures.append(
                Figure(
                    f"{name} in the plant, {which} of {len(hours_found)}: hours of its motion",
                    round(shown, 1) if math.isfinite(shown) else "not found",
                    f"at most {limit:.0f}",
                    shown <= limit,
                )
            )
        figures.append(Figure(f"{name}: right axes named", str(right), "True", right))
    return figures
