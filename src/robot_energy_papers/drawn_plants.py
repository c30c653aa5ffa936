"""Paper A's experiment on plants that are drawn at random, with effects no model has a term for.

One plant shows that a method can work. How often it does, and how badly it fails, shows only on
many: their friction, losses and constants come from distributions of the rig, and every effect
of the rig is on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.errors import NotIdentifiableError
from robot_energy.rig import RigConfig, random_profile
from robot_energy_papers.soaked_rigs import Rigs, soaked_errors

SHARED = (
    "bodies, joint geometry and payload of the URDF",
    "gear ratios, wrist coupling and rotor inertias",
    "the form of the power chain: rigid torque plus friction, times motor speed, plus losses, a DC "
    "link, constant losses",
)
"""All that a drawn plant and a model have in common."""


@dataclass(frozen=True)
class PlantRow:
    """One plant.

    Attributes:
        plant_seed: Seed of its figures.
        errors: Error of the grid energy at each held-out temperature, by model; empty where
            identification refused. [-]
        refused: What identification found; empty where it went through.
    """

    plant_seed: int
    errors: dict[str, tuple[float, ...]]
    refused: str = ""


@dataclass(frozen=True)
class ErrorSpread:
    """Sizes of the errors of one model over all plants and temperatures. [-]

    Attributes:
        median: Half of the errors are at most so large.
        ninety: Nine of ten are.
        worst: The greatest, with its sign.
        least: The lowest error.
        greatest: The highest.
    """

    median: float
    ninety: float
    worst: float
    least: float
    greatest: float


def plant_row(plant_seed: int, rigs: Rigs, seed: int) -> PlantRow:
    """Do the experiment on one drawn plant, with every effect of the rig.

    Args:
        plant_seed: Seed of the plant's figures.
        rigs: Temperatures and length.
        seed: Seed of the study: of programs, meters and noise.

    Returns:
        What came out.

    Raises:
        RobotEnergyError: If the rig or its bags cannot be made.
    """
    profile = random_profile("kr16", plant_seed)
    try:
        return PlantRow(
            plant_seed, soaked_errors(profile, RigConfig.hard(), rigs, seed, beyond=True)
        )
    except NotIdentifiableError as error:
        return PlantRow(plant_seed, {}, error.found)


def error_spreads(rows: Sequence[PlantRow]) -> dict[str, ErrorSpread]:
    """Return the distribution of the errors of every model.

    Args:
        rows: One per plant.

    Returns:
        By model, of the plants that have it.
    """
    by_model: dict[str, list[float]] = {}
    for row in rows:
        for name, errors in row.errors.items():
            by_model.setdefault(name, []).extend(errors)
    return {
        name: ErrorSpread(
            float(np.median(np.abs(errors))),
            float(np.quantile(np.abs(errors), 0.9)),
            max(errors, key=abs),
            min(errors),
            max(errors),
        )
        for name, errors in by_model.items()
    }
