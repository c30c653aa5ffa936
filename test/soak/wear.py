"""Wear that comes slowly, and alarms without wear: 1,000 simulated hours on drawn plants."""

from __future__ import annotations

import math

from figure import Figure

from robot_energy.rig import random_profile
from robot_energy_papers.wear_study import detection, false_alarms, recorded_days

MINUTES = (90.0, 4.0)
PLANTS = (3, 7, 11)
HOURS = 1000.0


def run(folder: str, quick: bool) -> list[Figure]:
    """Record days of drawn plants, simulate hours of them, and let one axis wear slowly."""
    plants, days = (PLANTS[:1], 1) if quick else (PLANTS, 2)
    hours = 50.0 if quick else HOURS / len(plants)
    count = sum(
        false_alarms(recorded_days(random_profile("kr16", seed), days, seed), hours)
        for seed in plants
    )
    figures = [
        Figure(
            f"false alarms in {len(plants) * hours:.0f} h, six axes",
            count,
            "at most 1 in 1,000 h",
            count <= 1,
        )
    ]
    if not quick:
        row = detection(random_profile("kr16", 3), 2, 0.0, 48.0, 48.0, 0.05 / 100, seed=5)
        found = not math.isnan(row.found)
        figures.append(
            Figure(
                "+5 % per 100 h of axis 3 found after [h]",
                round(row.found, 1) if found else "not found",
                "at most 24",
                found and row.found <= 24,
            )
        )
    return figures
