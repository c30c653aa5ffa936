"""Several motions of one robot compared: the errors that they share cancel in the differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from robot_energy.accounting.record import Calibrated
from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError, RobotEnergyError
from robot_energy.model import RobotModel
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.deviations import DeviationSums
from robot_energy_plan.prediction import MAX_SAMPLES, planned_samples, predict

Candidate = Callable[[], JointTrajectory]
"""Makes a motion, or raises what is wrong with it."""


class ComparedMotion(Described):
    """What one candidate needs."""

    feasible: Annotated[bool, "Whether it was predicted and keeps the limits."]
    message: str
    duration: Annotated[float, "With the wait up to the cycle time. [s]"] = np.nan
    energy: Annotated[float, "From the grid, import minus return; NaN: unknown. [J]"] = np.nan
    half: Annotated[float, "Half width of its 90 % band. [J]"] = np.nan
    peak: Annotated[float, "Greatest power from the grid. [W]"] = np.nan
    columns: Annotated[
        Float, "Change of the energy with the error of each figure, shape (K,). [J]"
    ] = field(default_factory=lambda: np.full(1, np.nan))

    def more_than(self, other: ComparedMotion) -> tuple[float, float]:
        """Return what it needs more than another, and half the width of the 90 % band of that."""
        if np.isnan(self.energy + other.energy):
            return np.nan, np.nan
        apart = self.columns - other.columns
        return self.energy - other.energy, Z90 * float(np.sqrt((apart**2).sum()))


@dataclass(frozen=True)
class MotionComparison:
    """All candidates."""

    candidates: tuple[ComparedMotion, ...]
    order: tuple[int, ...]

    @property
    def cheapest(self) -> int | None:
        """Index of the cheapest feasible candidate; None if there is none."""
        return self.order[0] if self.order else None

    @property
    def advantage(self) -> tuple[float, float]:
        """What the second cheapest needs more [J], and half the width of its 90 % band [J]."""
        if len(self.order) < 2:
            return np.nan, np.nan
        return self.candidates[self.order[1]].more_than(self.candidates[self.order[0]])


def compare_motions(
    model: RobotModel,
    motions: Sequence[Candidate],
    motor_temperature_degc: Float,
    *,
    cycle_time: float = 0.0,
    peak_limit: float = np.inf,
    calibration: Calibrated | None = None,
    max_samples: int = MAX_SAMPLES,
) -> MotionComparison:
    """Return what several motions need, and which needs least energy.

    Args:
        motions: Each gives a motion, or raises what is wrong with it; the others are compared
            all the same.
        motor_temperature_degc: Held throughout, shape (n,). [degC]
        cycle_time: Until which a robot waits at the end of its motion; 0: it does not. [s]
        peak_limit: Of the power from the grid. [W]
        calibration: What a meter has shown of the bands of this model.
    """
    if not motions:
        raise MotionError("no trajectory was given", "one at least")
    if not 0 <= cycle_time < np.inf or not peak_limit > 0:
        raise MotionError(
            f"cycle time {cycle_time} s, peak limit {peak_limit} W", "a time >= 0, a limit > 0"
        )
    chain = PowerChain(model, motor_temperature_degc[None, :])
    found: list[ComparedMotion] = []
    for motion in motions:
        try:
            given = motion()
            max_samples -= planned_samples(given.planned(), 1)
            if max_samples < 0:
                raise MotionError(
                    "all trajectories together have too many samples", "fewer or shorter ones"
                )
            one = _compared(chain, given, cycle_time, peak_limit, calibration)
        except RobotEnergyError as error:
            one = ComparedMotion(False, str(error))
        found.append(one)
    order = [number for number, one in enumerate(found) if one.feasible]
    order.sort(key=lambda number: found[number].energy)
    return MotionComparison(tuple(found), tuple(order))


def _compared(
    chain: PowerChain,
    motion: JointTrajectory,
    cycle_time: float,
    peak_limit: float,
    calibration: Calibrated | None,
) -> ComparedMotion:
    model, sums = chain.model, DeviationSums(chain.model)
    degc = chain.motor_temperature_degc[0]
    result = predict(model, motion.planned(), degc, on_output=sums.take)
    account = result.account
    if calibration is not None:
        account.calibration.restore(calibration)
    energy = account.registers.cabinet("grid_import") - account.registers.cabinet("grid_return")
    half, columns, duration, peak = (
        account.energy_band.half, sums.energy, result.duration, account.counts.peak_power
    )  # fmt: skip
    wrong = result.limits.sentences()
    if cycle_time > 0:
        wait = cycle_time - duration
        if wait < -1e-9:
            wrong.append(f"it lasts {duration:.4g} s, more than the cycle time {cycle_time:g} s")
        wait = max(wait, 0.0)
        end = motion.sample(np.array([motion.duration])).joint_position
        names = list(motion.joint_names)
        held = chain.rests(end[:, [names.index(name) for name in model.joint_names]])
        energy += float(held.energy[0]) * wait
        columns = columns + held.columns[0] * wait
        half += Z90 * float(np.sqrt((held.columns[0] ** 2).sum())) * wait
        duration, peak = duration + wait, max(peak, float(held.peak[0]))
    if peak > peak_limit:
        wrong.append(f"its peak power is {peak:.0f} W, more than {peak_limit:g} W")
    said = f"{energy:.6g} J +- {half:.3g} J from the grid in {duration:.6g} s"
    return ComparedMotion(
        not wrong, "; ".join([*wrong, said]), duration, energy, half, peak, columns
    )
