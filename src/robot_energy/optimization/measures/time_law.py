"""Time laws: how fast each place of a path is passed, as a cone program."""

from __future__ import annotations

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.search import cheapest
from robot_energy.optimization.task import Task


def _plan(task: Task) -> CyclePlan | None:
    if not (task.table.candidates.law >= 0).any():
        return None
    return task.plan(cheapest(task.table, task.allowed, task.time, task.wait_power))


MEASURES.register(
    Measure(
        name="time_law",
        label="best time law along each path",
        line="how fast each place of a path is passed, within speed, acceleration, torque and jerk",
        changes="time law",
        plan=_plan,
    )
)
