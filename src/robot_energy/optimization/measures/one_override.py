"""One override for all moves: the same shares of speed and acceleration throughout."""

from __future__ import annotations

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.search import uniform
from robot_energy.optimization.task import Task


def _plan(task: Task) -> CyclePlan | None:
    row = uniform(task.table, task.plain, task.moving_time, task.wait_power)
    return None if row is None else task.plan(row)


MEASURES.register(
    Measure(
        name="one_override",
        label="one speed and acceleration for all moves",
        line="the same shares of speed and acceleration for all moves, no slower than now",
        changes="speed, acceleration",
        plan=_plan,
    )
)
