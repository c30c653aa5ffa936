"""Condition of a robot over many recordings in the order of time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from robot_energy.foundation.errors import BagError
from robot_energy.replay.api import ReplayOptions, run_replay
from robot_energy.replay.inputs import ModelName, model_of
from robot_energy.results.condition import ConditionReport, condition_report


def condition_over(
    bags: Sequence[str | Path], model: ModelName, **options: Unpack[ReplayOptions]
) -> ConditionReport:
    """Return what recordings of one robot teach, each going on from the one before.

    Args:
        bags: MCAP files or rosbag2 folders, oldest first.
        model: A model, its file, or the name of a shipped one.
        **options: What is read and how: see `ReplayOptions`.

    Raises:
        BagError: If there is none, or one cannot be read.
        RobotEnergyError: If the model or an option cannot be used.
    """
    if not bags:
        raise BagError("no recording was given", "one or more, oldest first")
    used, learner = model_of(model), None
    for bag in bags:
        learner = run_replay(bag, used, **options).pipeline.condition
        options["learned"] = learner.state()
    assert learner is not None
    return condition_report(learner, used)
