"""A supply that returns braking energy to the grid, or a DC bus that several robots share."""

from __future__ import annotations

import numpy as np

from robot_energy.model.figure import PositiveFigure
from robot_energy.optimization.chain import PowerChain
from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import Cost, CostTable, CyclePlan
from robot_energy.optimization.task import Task


def _plan(task: Task) -> CyclePlan | None:
    return None if task.regeneration is None else task.base


def _cost(task: Task, plan: CyclePlan) -> Cost:
    if task.regeneration is None:
        return task.table.cost(plan)
    model = task.model()
    share = PositiveFigure(
        value=task.regeneration, tag="assumed", source="a regenerative supply under judgement"
    )
    supply = model.cabinet.model_copy(update={"regeneration_efficiency": share})
    chain = PowerChain(model.changed(cabinet=supply), task.chain.motor_temperature_degc)
    chosen = task.table.candidates[plan.row]
    table = CostTable(
        chosen, chain.moves(task.moves, chosen), task.table.held, task.table.braked,
        task.table.states, task.table.elsewhere,
    )  # fmt: skip
    return table.cost(CyclePlan(np.arange(len(chosen)), plan.rest, plan.state))


MEASURES.register(
    Measure(
        name="regenerative",
        label="a regenerative supply",
        line="braking energy goes back to the grid instead of into a resistor",
        changes="supply of the cell",
        plan=_plan,
        cost=_cost,
    )
)
