"""The test on real cobots as JSON, and what its templates name."""

from __future__ import annotations

from typing import Any

from robot_energy.results.base import json_value
from robot_energy_papers.pages import Piece
from robot_energy_studies.ecbot import ECBOT_TEST, ECBOT_TRAIN, WITHOUT, TestedRobot

LABEL = "real recordings, each predicted by a fit that has not seen it"


def figures(result: tuple[TestedRobot, ...]) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
    return {
        "label": LABEL,
        "ecbot": {"train_rms": ECBOT_TRAIN, "test_rms": ECBOT_TEST, "robots": 4},
        "robots": [
            {
                **json_value(robot),
                "rms_over_mean": robot.of_mean,
                "rms_over_spread": robot.of_spread,
                "recordings": [
                    {
                        **json_value(one),
                        "energy_per_metre": one.energy_per_metre,
                        "body_work_share": one.body_work_share,
                    }
                    for one in robot.recordings
                ],
            }
            for robot in result
        ],
        "without_power": WITHOUT,
    }


def context(result: tuple[TestedRobot, ...]) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    return {
        "robots": result, "label": LABEL, "train": ECBOT_TRAIN, "test": ECBOT_TEST,
        "without": WITHOUT,
    }  # fmt: skip


def pieces(result: tuple[TestedRobot, ...]) -> dict[str, Piece]:
    """Return figures and parts by name: the page has tables alone."""
    del result
    return {}
