"""Several robots on one supply: when each starts, and what the supply gives then."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.results.base import Result
from robot_energy.timeline.blocks import NANOSECOND, Float
from robot_energy_plan.motion.planned import PlannedMotion
from robot_energy_plan.optimization.levelling import Levelling, level_starts, samples_of
from robot_energy_plan.optimization.task import Task
from robot_energy_plan.prediction import START_NS, predict
from robot_energy_plan.results.shared_bus import shared_bus_report
from robot_energy_plan.shared_bus import ROUNDING, planned_exchange, planned_robot


class StartTime(Result):
    """When a robot on a common supply starts."""

    program: Annotated[str, "Program of the robot."]
    start: Annotated[float, "After the beginning of the common cycle. [s]"]


class CommonSupply(Result):
    """Power of a supply for several robots."""

    peak_power_together: Annotated[float, "Greatest power with all starts at once. [W]"]
    peak_power: Annotated[float, "Greatest power with the starts as chosen. [W]"]
    mean_power: Annotated[
        float,
        "Mean power with these starts; with separate supplies it is the same for any starts. [W]",
    ]


Robots = Sequence[tuple[str, PlannedMotion]]
"""Names and motions of robots of one model."""


def supply_figures(
    task: Task, robots: Robots, cycle_time: float, one_bus: bool = False
) -> dict[str, Any]:
    """Return ``starts``, ``supply`` and ``shared_bus`` of an `OptimizationReport`.

    Args:
        cycle_time: Of all. [s]
        one_bus: Whether all stand on one DC bus: the starts then need the least energy, else they
            have the least peak.
    """
    if one_bus:
        degc = task.chain.motor_temperature_degc.mean(axis=0)
        of_bus = [planned_robot(name, task.chain.model, one, degc) for name, one in robots]
        found = planned_exchange(of_bus, cycle_time)
        best, shared = found.best, shared_bus_report(of_bus, found)
        mean = best.grid_energy(best.shared) / best.duration
        return {
            "starts": _starts(robots, found.levelling),
            "supply": CommonSupply(shared.peak_power, best.peak_power([best.shared]), mean),
            "shared_bus": shared,
        }
    curves = [_power(task, name, one, cycle_time) for name, one in robots]
    level = level_starts(curves, cycle_time)
    return {
        "starts": _starts(robots, level),
        "supply": CommonSupply(level.together, level.least, level.mean),
    }


def _starts(robots: Robots, level: Levelling) -> tuple[StartTime, ...]:
    return tuple(
        StartTime(name, start)
        for (name, _), start in zip(robots, level.start.tolist(), strict=True)
    )


def _power(task: Task, name: str, motion: PlannedMotion, cycle_time: float) -> Float:
    """Mean power over short steps of one cycle, the wait with the power of the first rest."""
    if motion.duration > cycle_time + ROUNDING:
        raise MotionError(
            f"{name} takes {motion.duration:.4g} s", f"at most the cycle time, {cycle_time:g} s"
        )
    degc = task.chain.motor_temperature_degc.mean(axis=0)
    means = predict(task.chain.model, motion, degc, name).means
    if means is None:
        raise MotionError(f"{name} is too short", "a motion of some samples")
    power = means.predicted_power
    time = (means.stamp_ns - START_NS) * NANOSECOND - 0.5 * means.period
    count = samples_of(cycle_time)
    middle = (np.arange(count) + 0.5) * cycle_time / count
    return np.where(middle > motion.duration, power[0], np.interp(middle, time, power))
