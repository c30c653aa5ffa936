"""All measures, each alone and all together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.errors import MotionError
from robot_energy.optimization.measures import MEASURES, Measure, best_states
from robot_energy.optimization.plan import Cost, CyclePlan, Saving, saving
from robot_energy.optimization.search import cheapest, front
from robot_energy.optimization.task import Task


@dataclass(frozen=True)
class Tried:
    """What one measure gives.

    Attributes:
        measure: The measure.
        plan: Its best plan; None where it does not apply.
        cost: What that costs.
        saving: Over the program as it is.
    """

    measure: Measure
    plan: CyclePlan | None
    cost: Cost | None
    saving: Saving | None


@dataclass(frozen=True)
class Optimum:
    """What was found.

    Attributes:
        task: With the candidates near the choice.
        base: Cost of the program as it is.
        tried: Each measure alone.
        plan: The choice: all measures that change the program, together.
        cost: What it costs.
        saving: Over the program as it is; of the program alone, without another supply.
        front: Plans without wait, from fast to slow, and what they cost.
    """

    task: Task
    base: Cost
    tried: tuple[Tried, ...]
    plan: CyclePlan
    cost: Cost
    saving: Saving
    front: list[tuple[CyclePlan, Cost]]


def optimise(task: Task, moved: Task | None = None) -> Optimum:
    """Return the choice, each measure alone and the trade-offs.

    Args:
        task: The program and what may be changed.
        moved: The same with the moves that take the place of its own in the choice.

    Raises:
        MotionError: If a move cannot be made within the limits.
    """
    base = task.table.cost(task.base)
    task = task.near(together(task))
    tried = tuple(_try(task, base, measure) for measure in MEASURES.values())
    if moved is not None:
        task = moved.near(together(moved))
    plan = together(task)
    cost = task.table.cost(plan)
    free = CyclePlan(task.base.row, task.needed, task.base.state)
    return Optimum(
        task, base, tried, plan, cost, saving(base, cost), front(task.table, task.allowed, free)
    )


def _try(task: Task, base: Cost, measure: Measure) -> Tried:
    plan = measure.plan(task)
    if plan is None:
        return Tried(measure, None, None, None)
    cost = measure.cost(task, plan)
    return Tried(measure, plan, cost, saving(base, cost))


def together(task: Task) -> CyclePlan:
    """Return the best plan of all measures that change the program.

    The wait is spent at one place in one state; for each state that place is known, and the moves
    are chosen against the power of that wait.

    Args:
        task: The program and what may be changed.

    Raises:
        MotionError: If a move cannot be made within the limits.
    """
    table = task.table
    if task.cycle_time is None:
        return best_states(task, task.plan(cheapest(table, task.allowed, task.time)))
    plans: list[CyclePlan] = []
    for state in (None, *table.states):
        at = table.held if state is None else table.braked
        place = int(np.argmin(at.energy))
        wake = 0.0 if state is None else state.wake_time
        power = float(at.energy[place]) * (1.0 if state is None else state.power)
        try:
            row = cheapest(table, task.allowed, task.time - wake, power)
        except MotionError:
            if state is None:
                raise
            continue  # too little time to wake up
        plans.append(best_states(task, task.plan(row, place, state)))
    return min(plans, key=lambda plan: table.cost(plan).energy)
