"""Table of the measures: what can be changed to save energy. A new one is one file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robot_energy.kinds import Kind, Kinds
from robot_energy.optimization.plan import Cost, CyclePlan
from robot_energy.optimization.task import Task


def _cost(task: Task, plan: CyclePlan) -> Cost:
    return task.table.cost(plan)


@dataclass(frozen=True, kw_only=True)
class Measure(Kind):
    """One way to save.

    Attributes:
        changes: What is changed, for tables.
        plan: The best plan that this measure alone gives; None where it does not apply.
        cost: What a plan costs with it, where it changes the cell and not the program.
    """

    changes: str
    plan: Callable[[Task], CyclePlan | None]
    cost: Callable[[Task, CyclePlan], Cost] = _cost


def variant(name: str, label: str, line: str, changes: str) -> Measure:
    """Return a measure whose program was made before: the task has its cost under this name.

    Args:
        name: Of the measure.
        label: For tables.
        line: What it does, one line.
        changes: What is changed, for tables.
    """
    return Measure(
        name=name,
        label=label,
        line=line,
        changes=changes,
        plan=lambda task: task.base if name in task.variants else None,
        cost=lambda task, plan: task.variants[name],
    )


MEASURES: Kinds[Measure] = Kinds("measure")

register_measure = MEASURES.register
"""Add a measure of yours."""
