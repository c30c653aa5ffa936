"""Speed and acceleration of each move, the program no slower than now."""

from __future__ import annotations

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.search import cheapest
from robot_energy.optimization.task import Task


def _plan(task: Task) -> CyclePlan:
    return task.plan(cheapest(task.table, task.plain, task.moving_time, task.wait_power))


MEASURES.register(
    Measure(
        name="move_overrides",
        label="speed and acceleration of each move",
        line="own shares of speed and acceleration for each move, no slower than now in all",
        changes="speed, acceleration",
        plan=_plan,
    )
)
