"""Robots on one supply or DC bus: every figure that terminal, JSON and pages show of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.errors import MotionError
from robot_energy.results.base import ModelUsed, Number, Result, Texts, model_used
from robot_energy.timeline.blocks import NANOSECOND, Float
from robot_energy_plan.motion.planned import PlannedMotion
from robot_energy_plan.optimization.deviations import FORM_FED_BACK
from robot_energy_plan.optimization.task import Task
from robot_energy_plan.prediction import START_NS, predict
from robot_energy_plan.shared_bus import (
    ROUNDING,
    BusExchange,
    BusRobot,
    Levelling,
    PlannedBus,
    level_starts,
    planned_exchange,
    planned_robot,
    samples_of,
    shared_cabinet,
)

FEW = 0.5  # of the recorded time, below which a gap makes the figures doubtful [-]


class SharedBusRobot(Result):
    """One of the robots, with a supply of its own."""

    name: Annotated[str, "Name of its program or recording."]
    model: Annotated[ModelUsed, "The model used."]
    energy: Annotated[float, "Energy from the grid with a supply of its own. [J]"]
    brake_energy: Annotated[float, "Energy into its own brake resistor. [J]"]
    peak_power: Annotated[float, "Greatest power from the grid. [W]"]
    start: Annotated[Number, "Start in the cycle, with the best starts; None for recordings. [s]"]


class SharedBusReport(Result, name="shared_bus"):
    """What several robots save on one DC bus."""

    recorded: Annotated[bool, "Whether the motions were recorded; else they are planned."]
    duration: Annotated[float, "Time that counts: a cycle, or what all recorded. [s]"]
    robots: Annotated[tuple[SharedBusRobot, ...], "Each with a supply of its own."]
    energy_apart: Annotated[float, "Energy from the grid, each with its own supply. [J]"]
    energy: Annotated[float, "Energy from the grid, all on one bus. [J]"]
    brake_energy_apart: Annotated[float, "Energy into all their resistors. [J]"]
    brake_energy: Annotated[float, "Energy into the resistor of the bus. [J]"]
    saved: Annotated[float, "Saved by the bus: the difference of the energies. [J]"]
    relative: Annotated[Number, "Saving over the energy with supplies of their own. [-]"]
    half: Annotated[float, "Half width of the 90 % band of what is saved. [J]"]
    claimed: Annotated[bool, "Whether the saving is larger than that."]
    peak_power_apart: Annotated[float, "Greatest power of all supplies together. [W]"]
    peak_power: Annotated[float, "Greatest power of the supply of the bus. [W]"]
    capacitor_energy: Annotated[float, "Energy that the capacitors of the bus take at most. [J]"]
    saved_any_start: Annotated[
        Number,
        "Mean saving for any starts in the cycle, without capacitors; None for recordings. [J]",
    ]
    saved_best: Annotated[Number, "Saving with the best starts found; None for recordings. [J]"]
    half_best: Annotated[Number, "Half width of the 90 % band of that. [J]"]
    peak_power_best: Annotated[Number, "Greatest power of the supply of the bus then. [W]"]
    problems: Annotated[Texts, "What makes the figures doubtful, one sentence each."]
    notes: Annotated[Texts, "What a reader should know, one sentence each."]


def shared_bus_report(
    robots: Sequence[BusRobot], found: BusExchange | PlannedBus, notes: Sequence[str] = ()
) -> SharedBusReport:
    """Return all figures."""
    planned = found if isinstance(found, PlannedBus) else None
    flows = found if isinstance(found, BusExchange) else found.together
    capacitor = shared_cabinet([robot.model.cabinet for robot in robots]).capacitor
    energy, brake = flows.grid_energy(flows.shared), flows.brake_energy(flows.shared)
    apart = [flows.grid_energy(one) for one in flows.own]
    braked = [flows.brake_energy(one) for one in flows.own]
    half = saving_half(robots, flows)
    starts = [None] * len(robots) if planned is None else planned.levelling.start.tolist()
    any_start = None
    if planned is not None:
        level = planned.levelling
        any_start = sum(apart) - energy + (level.together - level.any_start) * flows.duration
    problems = [text for robot in robots for text in robot.problems]
    span = float(flows.stamp_ns[-1] - flows.stamp_ns[0]) * 1e-9
    if flows.duration < FEW * span:
        problems.append(
            f"all robots are known over {flows.duration:.4g} s of {span:.4g} s: the rest is gaps"
        )
    return SharedBusReport(
        recorded=planned is None,
        duration=flows.duration,
        robots=tuple(
            SharedBusRobot(
                robot.name,
                model_used(robot.model),
                own,
                own_brake,
                flows.peak_power([balance]),
                start,
            )
            for robot, own, own_brake, balance, start in zip(
                robots, apart, braked, flows.own, starts, strict=True
            )
        ),
        energy_apart=sum(apart),
        energy=energy,
        brake_energy_apart=sum(braked),
        brake_energy=brake,
        saved=flows.saved,
        relative=flows.saved / sum(apart) if sum(apart) > 0 else None,
        half=half,
        claimed=flows.saved > half > 0,
        peak_power_apart=flows.peak_power(flows.own),
        peak_power=flows.peak_power([flows.shared]),
        capacitor_energy=0.0 if capacitor is None else capacitor.swing,
        saved_any_start=any_start,
        saved_best=None if planned is None else planned.best.saved,
        half_best=None if planned is None else saving_half(robots, planned.best),
        peak_power_best=None if planned is None else planned.best.peak_power([planned.best.shared]),
        problems=tuple(dict.fromkeys(problems)),
        notes=(
            *notes,
            *dict.fromkeys(text for robot in robots for text in robot.notes),
            "constant losses are those of all robots together: one rectifier instead of several "
            "would lose less, which is not counted",
            "nothing here was measured: the energy on one bus is that of the models",
        ),
    )


def saving_half(robots: Sequence[BusRobot], flows: BusExchange) -> float:
    """Return the half width of the 90 % band of what a bus saves. [J]

    Besides `relative_half`: where link voltages of several models are assumed, the bus stands at
    the higher rectified voltage and brakes at the lower chopper's, which leaves less room.
    """
    links = {
        robot.model.model_id: link
        for robot in robots
        if (link := robot.model.cabinet.capacitor) is not None
    }
    tags = {
        figure.tag
        for link in links.values()
        for figure in (link.nominal_voltage, link.chopper_voltage)
    }
    room = flows.for_want_of_room if len(links) > 1 and "assumed" in tags else 0.0
    return float(np.hypot(flows.saved * relative_half(robots), Z90 * room))


def relative_half(robots: Sequence[BusRobot]) -> float:
    """Return the half width of the 90 % band of a saving, over the saving.

    What the bus saves errs as what the resistors took without it, alike for robots of one model and
    independently for different ones: ``S / B sqrt(sum_k B_k^2)`` with the changes ``B_k`` of the
    braked energy B by the errors of the figures k.
    """
    braked = sum(robot.deviations.braked for robot in robots)
    if braked <= 0:
        return Z90 * FORM_FED_BACK
    columns: dict[str, Float] = {}
    for robot in robots:
        known = columns.get(robot.model.model_id, np.zeros(1))
        columns[robot.model.model_id] = known + robot.deviations.brake
    squares = sum(float((one**2).sum()) for one in columns.values())
    return Z90 * float(np.sqrt(squares)) / braked


class StartTime(Result):
    """When a robot on a common supply starts."""

    program: Annotated[str, "Program of the robot."]
    start: Annotated[float, "After the beginning of the common cycle. [s]"]


class CommonSupply(Result):
    """Power of a supply for several robots."""

    peak_power_together: Annotated[float, "Greatest power with all starts at once. [W]"]
    peak_power: Annotated[float, "Greatest power with the starts as chosen. [W]"]
    mean_power: Annotated[
        float, "Mean power; with separate supplies it is the same for any starts. [W]"
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
