"""Waiting pose: the robot waits where it needs least to hold itself."""

from __future__ import annotations

import numpy as np

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.task import Task


def _plan(task: Task) -> CyclePlan | None:
    if not (task.base.rest > task.needed + 1e-9).any():
        return None
    return task.plan(task.base.row, int(np.argmin(task.table.held.energy)))


MEASURES.register(
    Measure(
        name="rest_pose",
        label="wait where holding costs least",
        line="the wait moves to the configuration of the program with the least power at rest",
        changes="place of the wait",
        plan=_plan,
    )
)
