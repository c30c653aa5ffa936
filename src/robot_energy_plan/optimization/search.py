"""Plans of a cycle, what they cost, which is the cheapest, and the front of all trade-offs.

One candidate of each move is chosen so that ``sum(E) - P sum(T)`` is least and ``sum(T)`` is at
most the time there is; ``P`` is the power of the wait that the moves shorten. This is a
multiple-choice knapsack, solved by dynamic programming over the time.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.optimization.chain import Candidates, Use
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


STEPS = 5000  # of the time that is left above that of the fastest choice
PRICES = 41  # of a second, along the front
PEAKS = 7  # limits of the peak, along the front
MAX_FRONT = 40  # points that are kept


def cheapest(
    table: CostTable, allowed: NDArray[np.bool_], time: float, wait_power: float = 0.0
) -> Int:
    """Return the row of the candidate of each move that together cost least, shape (K,).

    Args:
        allowed: Which of them may be used, shape (P,).
        time: For all moves together. [s]
        wait_power: Power of the wait that takes what is left of the time. [W]
    """
    rows = _efficient(table, allowed, wait_power)
    duration = table.use.duration
    ways = [rows[table.candidates.move[rows] == move] for move in range(table.moves)]
    fastest = float(sum(duration[one].min() for one in ways))
    if fastest > time * (1 + 1e-9) + 1e-9:
        raise MotionError(
            f"the moves need at least {fastest:.4g} s", f"at most {time:.4g} s", "allow more time"
        )
    price = table.use.energy - wait_power * duration
    best = np.array([one[np.argmin(price[one])] for one in ways])
    if duration[best].sum() <= time:
        return best
    # least[t]: cost of the moves so far within t steps of the time above that of the fastest
    step = max(time - fastest, 0.0) / STEPS + 1e-12
    least = np.zeros(STEPS + 1)
    taken = np.zeros((table.moves, STEPS + 1), dtype=np.int64)
    needs: list[Int] = []
    for move, one in enumerate(ways):
        extra = np.ceil((duration[one] - duration[one].min()) / step - 1e-6)
        needs.append(np.minimum(extra, STEPS + 1).astype(np.int64))
        cost = np.full((len(one), STEPS + 1), np.inf)
        for row, need in enumerate(needs[-1].tolist()):
            if need <= STEPS:
                cost[row, need:] = least[: STEPS + 1 - need] + price[one[row]]
        taken[move] = cost.argmin(axis=0)
        least = cost.min(axis=0)
    left, found = STEPS, np.empty(table.moves, dtype=np.int64)
    for move in range(table.moves - 1, -1, -1):
        row = int(taken[move, left])
        found[move] = ways[move][row]
        left -= int(needs[move][row])
    return found


def _efficient(table: CostTable, allowed: NDArray[np.bool_], wait_power: float) -> Int:
    kept: list[Int] = []
    for move in range(table.moves):
        rows = np.flatnonzero(allowed & (table.candidates.move == move))
        if not len(rows):
            raise MotionError(
                f"move {move + 1} cannot be made within the limits of torque and peak power",
                "a way to make it",
                "raise the peak limit, or check the torque limits of the URDF",
            )
        price = table.use.energy[rows] - wait_power * table.use.duration[rows]
        order = np.lexsort((price, table.use.duration[rows]))
        best = np.minimum.accumulate(price[order])
        first = np.concatenate([[True], price[order][1:] < best[:-1]])
        kept.append(rows[order[first]])
    return np.concatenate(kept)


def uniform(
    table: CostTable, allowed: NDArray[np.bool_], time: float, wait_power: float = 0.0
) -> Int | None:
    """Return the cheapest choice with the same shares for all moves; None if there is none.

    Arguments as in `cheapest`.
    """
    found = table.candidates
    best: tuple[float, Int] | None = None
    plain = found.law < 0
    for speed in np.unique(found.speed[plain]):
        for rise in np.unique(found.acceleration[plain]):
            rows = np.flatnonzero((found.acceleration == rise) & (found.speed <= speed))
            rows = rows[np.lexsort((found.speed[rows], found.move[rows]))]
            # of each move with these shares, or an equal one with less speed
            rows = rows[np.diff(found.move[rows], append=table.moves) > 0]
            if len(rows) < table.moves or not allowed[rows].all():
                continue
            moving = float(table.use.duration[rows].sum())
            if moving > time + 1e-9:
                continue
            energy = float(table.use.energy[rows].sum()) - wait_power * moving
            if best is None or energy < best[0]:
                best = energy, rows
    return None if best is None else best[1]


def front(
    table: CostTable, allowed: NDArray[np.bool_], plan: CyclePlan
) -> list[tuple[CyclePlan, Cost]]:
    """Return plans of which none is better in energy, time and peak at once, from fast to slow.

    For each of several limits of the peak, each of many prices of a second gives the choice that
    costs least: the corners of the convex hull.

    Args:
        allowed: Which of them may be used, shape (P,).
    """
    move, use = table.candidates.move, table.use
    lowest: float = max(use.peak[allowed & (move == k)].min() for k in range(table.moves))
    highest = float(use.peak[allowed].max())
    scale = float(use.energy[plan.row].sum() / max(use.duration[plan.row].sum(), 1e-9))
    prices = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, PRICES - 1)]) * scale
    found: dict[bytes, CyclePlan] = {}
    limits: list[float] = np.linspace(float(lowest), highest, PEAKS).tolist()
    for limit in limits:
        usable = np.flatnonzero(allowed & (use.peak <= limit * (1 + 1e-9)))
        cost = use.energy[usable, None] + prices * use.duration[usable, None]
        best = np.empty((table.moves, len(prices)), dtype=np.int64)
        for k in range(table.moves):
            mine = np.flatnonzero(move[usable] == k)
            best[k] = usable[mine[cost[mine].argmin(axis=0)]]
        for rows in best.T:
            found.setdefault(rows.tobytes(), CyclePlan(rows.copy(), plan.rest, plan.state))
    plans = [(one, table.cost(one)) for one in found.values()]
    points = np.array([(cost.energy, cost.duration, cost.peak) for _, cost in plans])
    # worse: another point is at most as great in all columns and less in one
    less = (points[:, None, :] <= points[None, :, :] * (1 + 1e-9)).all(axis=2)
    better = (points[:, None, :] < points[None, :, :] * (1 - 1e-6)).any(axis=2)
    worse = np.asarray((less & better).any(axis=0))
    kept = [plans[k] for k in np.flatnonzero(~worse)]
    kept.sort(key=lambda pair: pair[1].duration)
    if len(kept) > MAX_FRONT:
        shown: list[int] = np.unique(np.linspace(0, len(kept) - 1, MAX_FRONT).astype(int)).tolist()
        kept = [kept[k] for k in shown]
    return kept
