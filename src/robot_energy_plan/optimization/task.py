"""The task: a program, what it costs as it is, and what may be changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.optimization.chain import (
    ACCELERATIONS,
    SPEEDS,
    TORQUE_SHARE,
    Candidates,
    Moves,
    PowerChain,
    Use,
    grid,
)
from robot_energy_plan.optimization.rest_states import RestState
from robot_energy_plan.optimization.search import CostTable, CyclePlan

NEAR = np.array([0.85, 0.92, 1.0, 1.08, 1.16])  # shares around a choice, over its own [-]
PERCENT = 100.0  # shares are whole per cent, as robot languages take them


@dataclass(kw_only=True)
class ProgramMoves:
    """What a program does."""

    moves: Moves
    base: Annotated[Candidates, "How the moves are made now, in their order."]
    needed: Annotated[Float, "Rest before each move, shape (K,). [s]"]
    joint_position: Annotated[Float, "Where, shape (K, n). [rad] or [m]"]
    speeds: Annotated[Float, "Shares of speed that are tried, shape (S,). [-]"] = field(
        default_factory=SPEEDS.copy
    )
    accelerations: Annotated[Float, "Shares of acceleration that are tried, shape (A,). [-]"] = (
        field(default_factory=ACCELERATIONS.copy)
    )


class Task(Described):
    """What is to be made cheaper."""

    chain: PowerChain
    moves: Moves
    table: CostTable
    base: CyclePlan
    allowed: Annotated[NDArray[np.bool_], "Candidates within torque and peak power, shape (P,)."]
    needed: Annotated[Float, "Rest before each move that the work needs, shape (K,). [s]"]
    cycle_time: Annotated[float | None, "Of one cycle; None: the next one begins at once. [s]"]
    peak_limit: Annotated[float, "Of the power from the grid. [W]"]
    regeneration: Annotated[
        float | None, "Share that a supply would return which is to be judged; None: not asked. [-]"
    ] = None

    @property
    def moving_time(self) -> float:
        """Time that the moves take as they are. [s]"""
        return float(self.table.use.duration[self.base.row].sum())

    @property
    def time(self) -> float:
        """Time that the moves may take: the cycle without its rests, or as long as now. [s]"""
        if self.cycle_time is None:
            return self.moving_time
        return self.cycle_time - float(self.needed.sum())

    @property
    def wait_power(self) -> float:
        """Power of the wait for the end of the cycle; 0 where the next one begins at once. [W]"""
        return 0.0 if self.cycle_time is None else float(self.table.held.energy[0])

    def plan(self, row: Int, wait_at: int = 0, wait_in: RestState | None = None) -> CyclePlan:
        """Return a plan with the rests that the work needs, and a wait until the cycle is over.

        Args:
            row: Candidate of each move, shape (K,).
        """
        rest, state = self.needed.copy(), list(self.base.state)
        if self.cycle_time is not None:
            moving = float(self.table.use.duration[row].sum())
            wait = self.cycle_time - moving - float(self.needed.sum())
            if wait > 1e-6:
                rest[wait_at] += wait
                state[wait_at] = wait_in
        return CyclePlan(row, rest, tuple(state))

    @property
    def plain(self) -> NDArray[np.bool_]:
        """Allowed candidates without a time law, shape (P,)."""
        return self.allowed & (self.table.candidates.law < 0)

    def near(self, plan: CyclePlan) -> Task:
        """Return the task with further candidates close to those of a plan."""
        table = self.table
        chosen = table.candidates[plan.row[table.candidates.law[plan.row] < 0]]
        if not len(chosen):
            return self
        place, fast, rise = (
            axis.ravel()
            for axis in np.meshgrid(
                np.arange(len(chosen)), np.arange(len(NEAR)), np.arange(len(NEAR)), indexing="ij"
            )
        )  # fmt: skip
        speed, acceleration = (
            np.clip(np.round(PERCENT * share[place] * NEAR[step]), 1, PERCENT) / PERCENT
            for share, step in ((chosen.speed, fast), (chosen.acceleration, rise))
        )
        more = Candidates(chosen.move[place], speed, acceleration)
        use = self.chain.moves(self.moves, more)
        wider = replace(
            table,
            candidates=Candidates.concatenate([table.candidates, more]),
            use=Use.concatenate([table.use, use]),
        )
        fit = (use.torque_use <= TORQUE_SHARE) & (use.peak <= self.peak_limit)
        return replace(self, table=wider, allowed=np.concatenate([self.allowed, fit]))


def make_task(
    chain: PowerChain,
    work: ProgramMoves,
    *,
    cycle_time: float | None = None,
    free_rests: bool = False,
    states: Sequence[RestState] = (),
    peak_limit: float = np.inf,
    regeneration: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Task:
    """Return the task, with what every candidate costs.

    Args:
        cycle_time: Of one cycle; None: the next one begins at once. [s]
        free_rests: Whether the work needs none of its rests.
        peak_limit: Of the power from the grid. [W]
        regeneration: Share that a supply would return which is to be judged. [-]
        progress: Called with the share done, 0 to 1.
    """
    moves, base, joint_position = work.moves, work.base, work.joint_position
    needed = np.zeros_like(work.needed) if free_rests else work.needed
    tried = grid(moves, work.speeds, work.accelerations)
    every = Candidates.concatenate([base, tried, *filter(None, [moves.laws])])
    use = chain.moves(moves, every, progress)
    table = CostTable(
        every,
        use,
        chain.rests(joint_position),
        chain.rests(joint_position, holding=False),
        tuple(states),
    )
    allowed = (use.torque_use <= TORQUE_SHARE) & (use.peak <= peak_limit)
    rows = np.arange(len(base))
    allowed[rows] = use.peak[rows] <= peak_limit  # what runs now may go on
    as_it_is = CyclePlan(rows, needed, (None,) * len(base))
    period = float(use.duration[rows].sum() + needed.sum())
    if cycle_time is not None and cycle_time < period - 1e-6:
        raise MotionError(
            f"the cycle time is {cycle_time:.4g} s but the program needs {period:.4g} s",
            "a cycle time that the program keeps",
            "leave the cycle time out: faster moves are looked for as well",
        )
    task = Task(
        chain, moves, table, as_it_is, allowed, needed, cycle_time, peak_limit, regeneration
    )  # fmt: skip
    return replace(task, base=task.plan(rows))
