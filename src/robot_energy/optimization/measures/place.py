"""Place of the workpiece: the program as it is, with the work shifted in a box."""

from __future__ import annotations

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import Cost, CyclePlan
from robot_energy.optimization.task import Task

NAME = "place"


def _plan(task: Task) -> CyclePlan | None:
    return task.base if task.variants.get(NAME) is not None else None


def _cost(task: Task, plan: CyclePlan) -> Cost:
    return task.variants[NAME]


MEASURES.register(
    Measure(
        name=NAME,
        label="place of the workpiece",
        line="the workpiece, or the base, shifted in a box, by inverse kinematics",
        changes="place of workpiece or base",
        plan=_plan,
        cost=_cost,
    )
)
