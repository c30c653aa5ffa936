"""The studies of paper B as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.results.base import json_value
from robot_energy_identify.drives.drives import Way
from robot_energy_papers.accuracy import Accuracy
from robot_energy_papers.drive_study import WAY_NAMES, DriveTest
from robot_energy_papers.machines import MACHINES, Energies
from robot_energy_papers.paper_b import PaperB, Trained

MIN_SHAFT_SHARE = 0.01  # of the shafts' energy; below it a drive has no accuracy of its own
QUARTILES = (0.0, 0.25, 0.5, 0.75, 1.0)


def figures(result: PaperB) -> dict[str, Any]:
    """Return everything that was found, JSON-ready. Units: J, W, s, shares of 1."""
    return {
        "about": "virtual rig and models of machine classes: nothing was measured on a robot",
        "seed": result.seed,
        "quick": result.quick,
        "layers_simulated": result.scale.layers,
        "heights": list(result.scale.heights),
        "weighted_fit_on_validation": {
            name: _accuracy(found) for name, found in result.weighted.items()
        },
        "trained": {name: _trained(found) for name, found in result.trained.items()},
        "plants": {
            run: {str(seed): _test(test) for seed, test in plants.items()}
            for run, plants in result.plants.items()
        },
        "distributions": {run: distributions(found) for run, found in result.plants.items()},
        "machines": {
            key: {
                "layer": _energies(found.layer),
                "wall": _energies(found.wall),
                "rig_layer": _energies(found.rig),
                "electrical_at_heights": found.at_heights,
                "joint_ranges_at_heights": [one.tolist() for one in found.joint_ranges],
                "paper_relative_to_arm": MACHINES[key].paper,
            }
            for key, found in result.machines.items()
        },
        "sensitivity": json_value({"gantry_over_arm": result.gantry, "map_accuracy": result.maps}),
        "relative_to_arm": {stage: result.relative(stage) for stage in ("layer", "wall", "rig")},
    }


def moving(test: DriveTest) -> NDArray[np.bool_]:
    """Return which drives move enough in a run for an accuracy of their own, shape (n,)."""
    shaft = np.abs(test.joint_efficiency * test.energy)
    return np.asarray(shaft > MIN_SHAFT_SHARE * shaft.sum())


def _trained(found: Trained) -> dict[str, Any]:
    return {
        "mechanical": {
            run: {name: _accuracy(value) for name, value in test.accuracy.items()}
            for run, test in found.mechanical.items()
        },
        "drives": {run: _test(test) for run, test in found.tests.items()},
    }


def _test(test: DriveTest) -> dict[str, Any]:
    return {
        "measured_energy": float(test.energy.sum()),
        "joint_energy": test.energy.tolist(),
        "efficiency": test.efficiency,
        "joint_efficiency": test.joint_efficiency.tolist(),
        "outside_of_map": test.outside,
        "ways": {
            way: {
                "accuracy": found.accuracy,
                "joint_accuracy": [
                    value if known else None
                    for value, known in zip(found.joint.tolist(), moving(test), strict=True)
                ],
                "rms": found.rms,
                "energy": float(found.energy.sum()),
            }
            for way, found in test.ways.items()
        },
    }


def _accuracy(found: Accuracy) -> dict[str, Any]:
    return {
        "joint": found.joint.tolist(),
        "total_of_sums": found.total,
        "summed_power": found.summed,
        "mean_of_joints": found.mean,
    }


def _energies(found: Energies) -> dict[str, Any]:
    return {
        "duration": found.duration,
        **found.figures,
        "net": found.net.tolist(),
        "positive": found.positive.tolist(),
        "electrical": found.electrical.tolist(),
        "parts": found.parts,
        "cabinet": found.cabinet,
    }


def distributions(plants: Mapping[int, DriveTest]) -> dict[Way, dict[str, list[float]]]:
    """Return least value, quartiles and greatest value over plants, by way.

    Returns:
        Of ``accuracy`` [-] and ``rms`` [W].
    """
    return {
        way: {
            key: np.quantile(
                [getattr(test.ways[way], key) for test in plants.values()], QUARTILES
            ).tolist()
            for key in ("accuracy", "rms")
        }
        for way in WAY_NAMES
    }
