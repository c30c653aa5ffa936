"""Order of independent moves: the program as it is, its configurations in another order."""

from __future__ import annotations

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import Cost, CyclePlan
from robot_energy.optimization.task import Task

NAME = "order"


def _plan(task: Task) -> CyclePlan | None:
    return task.base if task.variants.get(NAME) is not None else None


def _cost(task: Task, plan: CyclePlan) -> Cost:
    return task.variants[NAME]


MEASURES.register(
    Measure(
        name=NAME,
        label="order of independent moves",
        line="configurations in the order that costs least, each with its rest",
        changes="order",
        plan=_plan,
        cost=_cost,
    )
)
