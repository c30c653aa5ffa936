"""A plan: how a cycle is run; and what it costs."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.optimization.candidates import Candidates
from robot_energy_plan.optimization.chain import Use
from robot_energy_plan.optimization.deviations import FORM_OF_HOLDING
from robot_energy_plan.optimization.rest_states import RestState, rest_cost


class CyclePlan(Described):
    """How one cycle is run."""

    row: Annotated[Int, "Candidate of each move, shape (K,)."]
    rest: Annotated[Float, "Rest before each move, shape (K,). [s]"]
    state: Annotated[tuple[RestState | None, ...], "How it is spent; None: the drives hold."]


class Cost(Described):
    """What one cycle needs, at the mean of the temperatures."""

    duration: Annotated[float, "[s]"]
    energy: Annotated[float, "From the grid. [J]"]
    peak: Annotated[float, "Greatest power from the grid. [W]"]
    brake: Annotated[float, "Into the brake resistor. [J]"]
    columns: Annotated[Float, "Change of the energy with the error of each figure, shape (K,). [J]"]
    by_temperature: Annotated[Float, "Energy at each temperature, shape (T,). [J]"]

    @property
    def half(self) -> float:
        """Half width of the 90 % band of the energy. [J]"""
        return Z90 * float(np.sqrt((self.columns**2).sum()))


class Saving(Described):
    """What a change saves, with its band."""

    energy: Annotated[float, "Per cycle, positive where it is less. [J]"]
    half: Annotated[float, "Half width of the 90 % band. [J]"]

    @property
    def claimed(self) -> bool:
        """Whether it is larger than its uncertainty."""
        return self.energy > self.half > 0


def saving(before: Cost, after: Cost) -> Saving:
    """Return what a change saves: both programs err by the same figures."""
    apart = before.columns - after.columns
    half = Z90 * float(np.sqrt((apart**2).sum()))
    return Saving(before.energy - after.energy, half)


class CostTable(Described):
    """Costs of all candidates and rests of a program."""

    candidates: Candidates
    use: Use
    held: Annotated[Use, "What a second of rest before each move needs while the drives hold."]
    braked: Use
    states: tuple[RestState, ...] = ()

    @property
    def moves(self) -> int:
        """Number of moves."""
        return len(self.held.duration)

    def rest_energy(self, via: int, duration: float, state: RestState | None) -> float:
        """Return the energy of a rest, infinite where it is too short for the state. [J]

        Args:
            duration: [s]
        """
        if state is None:
            return float(self.held.energy[via]) * duration
        cost = rest_cost(state, duration)
        return np.inf if cost is None else float(self.braked.energy[via]) * cost.held

    def cost(self, plan: CyclePlan) -> Cost:
        """Return what a plan costs."""
        moved = self.use[plan.row]
        energy = moved.by_temperature.sum(axis=0)
        brake = float(moved.brake.sum())
        columns = moved.columns.sum(axis=0)
        errors = np.zeros((len(self.states), 2))
        places = np.zeros(self.moves)
        peak = float(moved.peak.max())
        for via, (duration, state) in enumerate(zip(plan.rest.tolist(), plan.state, strict=True)):
            if duration <= 0:
                continue
            if state is None:
                at, share = self.held, duration
            else:
                spent = rest_cost(state, duration)
                if spent is None:
                    raise MotionError(
                        f"a rest of {duration:.4g} s is too short for {state.name}",
                        f"at least {state.wake_time:g} s",
                    )
                at, share = self.braked, spent.held
                errors[self.states.index(state)] += (
                    at.energy[via] * spent.power_error, at.energy[via] * spent.wake_error,
                )  # fmt: skip
            energy = energy + at.by_temperature[via] * share
            columns = columns + at.columns[via] * share
            places[via] = FORM_OF_HOLDING * at.energy[via] * share
            peak = max(peak, float(at.peak[via]))
        return Cost(
            duration=float(moved.duration.sum() + plan.rest.sum()),
            energy=float(energy.mean()),
            peak=peak,
            brake=brake,
            columns=np.concatenate([columns, errors.ravel(), places]),
            by_temperature=energy,
        )
