"""The studies of paper B as plain figures, for JSON and for tables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy_papers.accuracy import Accuracy
from robot_energy_papers.drive_study import DriveTest
from robot_energy_papers.machines import MACHINES, Energies
from robot_energy_papers.paper_b import PaperB, Trained

Figures = dict[str, Any]
MIN_SHAFT_SHARE = 0.01  # of the shafts' energy; below it a drive has no accuracy of its own


def figures(result: PaperB) -> Figures:
    """Return everything that was found, JSON-ready. Units: J, W, s, shares of 1.

    Args:
        result: The studies.
    """
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
        "plants": {str(seed): _test(test) for seed, test in result.plants.items()},
        "machines": {
            key: {
                "layer": _energies(found.layer),
                "wall": _energies(found.wall),
                "rig_layer": _energies(found.rig),
                "electrical_at_heights": found.at_heights,
                "paper_relative_to_arm": MACHINES[key].paper,
            }
            for key, found in result.machines.items()
        },
        "sensitivity": {
            "gantry_over_arm": {name: table.to_dict() for name, table in result.gantry.items()},
            "map_accuracy": {name: table.to_dict() for name, table in result.maps.items()},
        },
        "relative_to_arm": {stage: result.relative(stage) for stage in ("layer", "wall", "rig")},
    }


def moving(test: DriveTest) -> NDArray[np.bool_]:
    """Return which drives move enough in a run for an accuracy of their own, shape (n,).

    Args:
        test: The run.
    """
    shaft = np.abs(test.joint_efficiency * test.energy)
    return np.asarray(shaft > MIN_SHAFT_SHARE * shaft.sum())


def _trained(found: Trained) -> Figures:
    return {
        "mechanical": {
            run: {name: _accuracy(value) for name, value in test.accuracy.items()}
            for run, test in found.mechanical.items()
        },
        "drives": {run: _test(test) for run, test in found.tests.items()},
    }


def _test(test: DriveTest) -> Figures:
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


def _accuracy(found: Accuracy) -> Figures:
    return {
        "joint": found.joint.tolist(),
        "total_of_sums": found.total,
        "summed_power": found.summed,
        "mean_of_joints": found.mean,
    }


def _energies(found: Energies) -> Figures:
    return {
        "duration": found.duration,
        **found.figures,
        "net": found.net.tolist(),
        "positive": found.positive.tolist(),
        "electrical": found.electrical.tolist(),
        "parts": found.parts,
        "cabinet": found.cabinet,
    }
