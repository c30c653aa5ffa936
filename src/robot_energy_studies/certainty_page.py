"""The certainty study as JSON, and what its templates name: numbers and drawings."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from robot_energy.results.base import json_value
from robot_energy_papers.drawings import reliability
from robot_energy_papers.pages import Piece
from robot_energy_studies.band_coverage import summary
from robot_energy_studies.certainty import Certainty, reliability_of

LABEL = "virtual rig, plants drawn at random; nothing here was measured on a robot"


def figures(result: Certainty) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
    return {
        "label": LABEL,
        "seed": result.seed,
        "intervals": json_value(result.coverages),
        "intervals_hard": json_value(result.hard_coverages),
        "bands": summary(result.bands) if result.bands else {},
        "bands_by_run": json_value(result.bands),
        "thermal": json_value(result.thermal),
        "wear": json_value(result.wear),
        "learning": [
            {
                "robot": row.robot,
                "with_torque": row.with_torque,
                "error_without": [minute.error for minute in row.off],
                "error_with": [minute.error for minute in row.applied],
            }
            for row in result.learning
        ],
    }


def context(result: Certainty) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    return {
        "result": result,
        "data": figures(result),
        "quick": result.scale.repetitions < 50,
        "hidden": [
            {
                "name": row.name,
                "warm": float(np.nanmax(row.warm_rms)),
                "early": float(np.nanmax(row.early_rms)),
                "energy_change": row.energy_change,
                "fallback_change": row.fallback_change,
                "covered": row.covered,
            }
            for row in result.thermal
        ],
    }


def pieces(result: Certainty) -> dict[str, Piece]:
    """Return the figures of the page."""
    found: dict[str, Piece] = {}
    for name, figures_of in (("within", result.intervals), ("hard", result.hard)):
        if curves := reliability_of(figures_of):
            found[name] = partial(reliability, curves)
    return found
