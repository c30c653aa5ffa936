"""Table of the measures: what can be changed to save energy, each alone and all together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy.model.figure import PositiveFigure
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.rest_states import RestState
from robot_energy_plan.optimization.search import (
    Cost,
    CyclePlan,
    Saving,
    cheapest,
    front,
    saving,
    uniform,
)
from robot_energy_plan.optimization.task import Task


@dataclass(frozen=True, kw_only=True)
class Measure(Kind):
    """One way to save.

    Attributes:
        plan: The best plan that this measure alone gives; None where it does not apply.
        cost: What a plan costs with it, where it changes the cell and not the program.
    """

    changes: str
    plan: Callable[[Task], CyclePlan | None]
    cost: Callable[[Task, CyclePlan], Cost] = lambda task, plan: task.table.cost(plan)


def best_states(task: Task, plan: CyclePlan) -> CyclePlan:
    """Return a plan whose rests are spent in the cheapest state, its way back included."""

    def best(via: int, duration: float) -> RestState | None:
        ways = (None, *task.table.states)
        return min(ways, key=lambda state: task.table.rest_energy(via, duration, state))

    return replace(plan, state=tuple(best(*rest) for rest in enumerate(plan.rest.tolist())))


def _one_override(task: Task) -> CyclePlan | None:
    row = uniform(task.table, task.plain, task.moving_time, task.wait_power)
    return None if row is None else task.plan(row)


def _cheapest(task: Task, allowed: NDArray[np.bool_], time: float) -> CyclePlan:
    return task.plan(cheapest(task.table, allowed, time, task.wait_power))


def _with_supply(task: Task, plan: CyclePlan) -> Cost:
    if task.regeneration is None:
        return task.table.cost(plan)
    model = task.chain.model
    share = PositiveFigure(
        value=task.regeneration, tag="assumed", source="a regenerative supply under evaluation"
    )
    supply = model.cabinet.model_copy(update={"regeneration_efficiency": share})
    chain = PowerChain(model.changed(cabinet=supply), task.chain.motor_temperature_degc)
    chosen = task.table.candidates[plan.row]
    table = replace(task.table, candidates=chosen, use=chain.moves(task.moves, chosen))
    return table.cost(CyclePlan(np.arange(len(chosen)), plan.rest, plan.state))


MEASURES: Kinds[Measure] = Kinds(
    "measure",
    Measure(
        name="move_overrides",
        label="speed and acceleration of each move",
        line="separate shares of speed and acceleration for each move, in all no slower than now",
        changes="speed, acceleration",
        plan=lambda task: _cheapest(task, task.plain, task.moving_time),
    ),
    Measure(
        name="one_override",
        label="one speed and acceleration for all moves",
        line="the same shares of speed and acceleration for all moves, no slower than now",
        changes="speed, acceleration",
        plan=_one_override,
    ),
    Measure(
        name="regenerative",
        label="a regenerative supply",
        line="braking energy goes back to the grid instead of into a resistor",
        changes="supply of the cell",
        plan=lambda task: None if task.regeneration is None else task.base,
        cost=_with_supply,
    ),
    Measure(
        name="rest_pose",
        label="wait where holding costs least",
        line="the wait moves to the configuration of the program with the least power at rest",
        changes="place of the wait",
        plan=lambda task: (
            task.plan(task.base.row, int(np.argmin(task.table.held.energy)))
            if (task.base.rest > task.needed + 1e-9).any()
            else None
        ),
    ),
    Measure(
        name="rest_state",
        label="brakes, standby or hibernation at rest",
        line="each rest in the state that costs least, with the energy to wake up",
        changes="state of the drives at rest",
        plan=lambda task: best_states(task, task.base) if task.table.states else None,
    ),
    Measure(
        name="slack",
        label="slower moves instead of waiting",
        line="separate shares for each move, within the cycle time",
        changes="speed, acceleration, wait",
        plan=lambda task: (
            None if task.cycle_time is None else _cheapest(task, task.plain, task.time)
        ),
    ),
    Measure(
        name="time_law",
        label="best time law along each path",
        line="speed along each path, within the limits of speed, acceleration, torque and jerk",
        changes="time law",
        plan=lambda task: (
            _cheapest(task, task.allowed, task.time)
            if (task.table.candidates.law >= 0).any()
            else None
        ),
    ),
)

register_measure = MEASURES.register
"""Add a measure of yours."""


class Tried(Described):
    """What one measure gives."""

    measure: Measure
    plan: Annotated[CyclePlan | None, "Its best plan; None where it does not apply."]
    cost: Cost | None
    saving: Saving | None

    @classmethod
    def of(cls, task: Task, base: Cost, measure: Measure) -> Tried:
        """Return what one measure gives of a task."""
        if (plan := measure.plan(task)) is None:
            return cls(measure, None, None, None)
        cost = measure.cost(task, plan)
        return cls(measure, plan, cost, saving(base, cost))


class Optimum(Described):
    """What was found."""

    task: Task
    base: Cost
    tried: tuple[Tried, ...]
    plan: Annotated[CyclePlan, "The choice: all measures that change the program, together."]
    cost: Cost
    saving: Annotated[Saving, "Over the program as it is, without another supply."]
    front: Annotated[list[tuple[CyclePlan, Cost]], "Plans without wait, fast to slow; their cost."]


def optimise(task: Task) -> Optimum:
    """Return the choice, each measure alone and the trade-offs."""
    base = task.table.cost(task.base)
    task = task.near(together(task))
    tried = tuple(Tried.of(task, base, measure) for measure in MEASURES.values())
    plan = together(task)
    cost = task.table.cost(plan)
    free = CyclePlan(task.base.row, task.needed, task.base.state)
    return Optimum(
        task, base, tried, plan, cost, saving(base, cost), front(task.table, task.allowed, free)
    )


def together(task: Task) -> CyclePlan:
    """Return the best plan of all measures that change the program.

    The wait is spent at one place in one state; for each state that place is known, and the moves
    are chosen against the power of that wait.
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
