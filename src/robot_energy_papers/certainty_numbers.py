"""The figures of the certainty study as plain numbers: for JSON, and for the page."""

from __future__ import annotations

from typing import Any

from robot_energy.results.base import json_value
from robot_energy_papers.band_coverage import summary
from robot_energy_papers.certainty import Certainty, LearningResult

LABEL = "virtual rig, plants drawn at random; nothing here was measured on a robot"


def figures(result: Certainty) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1.

    Args:
        result: The study.
    """
    return {
        "label": LABEL,
        "seed": result.seed,
        "intervals": [json_value(row) for row in result.coverages],
        "intervals_hard": [json_value(row) for row in result.hard_coverages],
        "bands": summary(result.bands) if result.bands else {},
        "bands_by_run": [json_value(row) for row in result.bands],
        "thermal": [json_value(row) for row in result.thermal],
        "wear": [json_value(row) for row in result.wear],
        "learning": [_learning(row) for row in result.learning],
    }


def _learning(row: LearningResult) -> dict[str, Any]:
    return {
        "robot": row.robot,
        "with_torque": row.with_torque,
        "error_without": [minute.error for minute in row.off],
        "error_with": [minute.error for minute in row.applied],
    }
