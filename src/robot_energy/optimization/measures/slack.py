"""Slack: time in which the robot would wait is used for slower moves, where that pays."""

from __future__ import annotations

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.search import cheapest
from robot_energy.optimization.task import Task


def _plan(task: Task) -> CyclePlan | None:
    if task.cycle_time is None:
        return None
    return task.plan(cheapest(task.table, task.plain, task.time, task.wait_power))


MEASURES.register(
    Measure(
        name="slack",
        label="slower moves instead of waiting",
        line="own shares for each move, within the cycle time",
        changes="speed, acceleration, wait",
        plan=_plan,
    )
)
