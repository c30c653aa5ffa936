"""Brakes, standby, hibernation: each rest in the state that costs least, its way back included."""

from __future__ import annotations

from dataclasses import replace

from robot_energy.optimization.measures.table import MEASURES, Measure
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.rest_states import RestState
from robot_energy.optimization.task import Task


def best_states(task: Task, plan: CyclePlan) -> CyclePlan:
    """Return a plan whose rests are spent in the cheapest state.

    Args:
        task: With the states that may be used.
        plan: Any.
    """

    def best(via: int, duration: float) -> RestState | None:
        ways = (None, *task.table.states)
        return min(ways, key=lambda state: task.table.rest_energy(via, duration, state))

    return replace(plan, state=tuple(best(*rest) for rest in enumerate(plan.rest.tolist())))


def _plan(task: Task) -> CyclePlan | None:
    return best_states(task, task.base) if task.table.states else None


MEASURES.register(
    Measure(
        name="rest_state",
        label="brakes, standby or hibernation at rest",
        line="each rest in the state that costs least, with the energy to wake up",
        changes="state of the drives at rest",
        plan=_plan,
    )
)
