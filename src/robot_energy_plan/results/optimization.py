"""Cheaper programs: every figure that terminal, JSON and pages show of them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.results.base import ModelUsed, Number, Result, Texts, model_used
from robot_energy_plan.optimization.measures import Optimum, Tried, together
from robot_energy_plan.optimization.program_form import ProgramForm
from robot_energy_plan.optimization.rest_states import break_even
from robot_energy_plan.optimization.search import Cost, CostTable, Saving
from robot_energy_plan.optimization.task import Task
from robot_energy_plan.prediction import predict
from robot_energy_plan.results.shared_bus import CommonSupply, SharedBusReport, StartTime

NOT_CLAIMED = "not claimed: smaller than its uncertainty"
NOTHING = "changes nothing here"
COSTS = "needs more energy here"
DOES_NOT_APPLY = "does not apply"
MIN_CHANGE = 1e-6  # of the energy, that is more than rounding [-]
MAX_DIFFERENCE = 0.01  # between the two ways to predict the choice [-]
MIN_CYCLES = 20  # of each program, in a test on the robot


class CycleFigures(Result):
    """What one cycle needs."""

    duration: Annotated[float, "Time of a cycle with all rests. [s]"]
    energy: Annotated[float, "Energy from the grid. [J]"]
    half: Annotated[float, "Half width of its 90 % band. [J]"]
    mean_power: Annotated[float, "[W]"]
    peak_power: Annotated[float, "Greatest power from the grid. [W]"]
    brake_energy: Annotated[float, "Energy into the brake resistor. [J]"]


class SavingFigures(Result):
    """What a change saves per cycle."""

    energy: Annotated[float, "Energy saved; negative where more is needed. [J]"]
    relative: Annotated[Number, "Saving over the energy of the program as it is. [-]"]
    half: Annotated[float, "Half width of the 90 % band of the saving. [J]"]
    claimed: Annotated[bool, "Whether the saving is larger than that."]


class MeasureResult(Result):
    """One measure alone."""

    name: Annotated[str, "Name of the measure."]
    label: Annotated[str, "The measure in words."]
    changes: Annotated[str, "What is changed."]
    cycle: Annotated[CycleFigures | None, "A cycle with the measure; None where it does not apply."]
    saving: Annotated[SavingFigures | None, "Over the program as it is; None: does not apply."]
    verdict: Annotated[str, "What is claimed, in one sentence."]


class MoveChange(Result):
    """One move as it is, and as chosen."""

    move: Annotated[str, "From where to where."]
    speed_before: Annotated[float, "Share of the speed limits. [-]"]
    speed: Annotated[Number, "As chosen; None for a time law of its own. [-]"]
    acceleration_before: Annotated[float, "Share of the acceleration limits. [-]"]
    acceleration: Annotated[Number, "As chosen. [-]"]
    duration_before: Annotated[float, "[s]"]
    duration: Annotated[float, "As chosen. [s]"]
    energy_before: Annotated[float, "[J]"]
    energy: Annotated[float, "As chosen. [J]"]


class RestChange(Result):
    """One rest as chosen."""

    before: Annotated[str, "The move that follows it."]
    duration: Annotated[float, "[s]"]
    state: Annotated[str, "How it is spent."]
    power: Annotated[float, "While the drives hold. [W]"]


class FrontPoint(Result):
    """A program of which no other is better in energy, time and peak power at once."""

    duration: Annotated[float, "[s]"]
    energy: Annotated[float, "[J]"]
    peak_power: Annotated[float, "[W]"]


class TemperatureFigures(Result):
    """The program at one temperature."""

    motor_temperature_degc: Annotated[float, "Mean temperature of all motors. [degC]"]
    energy_before: Annotated[float, "As it is. [J]"]
    energy: Annotated[float, "As chosen for all temperatures. [J]"]
    best_energy: Annotated[float, "As it would be chosen for this one. [J]"]
    best_duration: Annotated[float, "Time of the moves then. [s]"]


class BreakEven(Result):
    """From which rest on a state pays."""

    state: Annotated[str, "Its name."]
    shortest_rest: Annotated[Number, "From which it costs less than to hold; None: never. [s]"]
    wake_time: Annotated[float, "[s]"]
    source: Annotated[str, "Where its figures come from."]


class OptimizationReport(Result, name="optimization"):
    """A program, and how it needs less energy for the same work."""

    program: Annotated[str, "Its name."]
    model: Annotated[ModelUsed, "The model used."]
    cycle_time: Annotated[Number, "Time of one cycle, as given; None: the next begins at once. [s]"]
    peak_limit: Annotated[Number, "Limit of the power from the grid that was given. [W]"]
    cycles_per_year: Annotated[Number, "Cycles in a year that were given; None: not known."]
    before: Annotated[CycleFigures, "The program as it is."]
    after: Annotated[CycleFigures, "As chosen: all measures that change the program, together."]
    saving: Annotated[SavingFigures, "Saving of the choice."]
    measures: Annotated[tuple[MeasureResult, ...], "Each measure alone."]
    moves: Annotated[tuple[MoveChange, ...], "Move by move."]
    rests: Annotated[tuple[RestChange, ...], "Rest by rest."]
    front: Annotated[
        tuple[FrontPoint, ...],
        "Trade-offs of energy, time and peak power, without waits, from fast to slow.",
    ]
    temperatures: Annotated[tuple[TemperatureFigures, ...], "At each temperature asked for."]
    break_even: Annotated[tuple[BreakEven, ...], "States at rest."]
    starts: Annotated[tuple[StartTime, ...], "Of this robot and others on its supply, if any."]
    supply: Annotated[CommonSupply | None, "Power of that supply; None without others."]
    shared_bus: Annotated[SharedBusReport | None, "The supply where it is one DC bus; else None."]
    checked_energy: Annotated[float, "Energy of the choice, as live operation predicts it. [J]"]
    how_to_try: Annotated[Texts, "What to do on the robot, in this order."]
    problems: Annotated[Texts, "What makes the figures doubtful, one sentence each."]
    notes: Annotated[Texts, "What a reader should know, one sentence each."]


def optimization_report(
    found: Optimum,
    form: ProgramForm,
    program: str,
    notes: Sequence[str] = (),
    cycles_per_year: float | None = None,
) -> OptimizationReport:
    """Return all figures, after a prediction of the choice by the stages of live operation.

    Args:
        cycles_per_year: As given; None: not known. [1]
    """
    task, model = found.task, found.task.chain.model
    degc = task.chain.motor_temperature_degc
    motion = form.motion(task, found.plan)
    held = replace(found.plan, state=(None,) * len(found.plan.state))  # what a prediction can do
    checked, broken = 0.0, list[str]()
    for row in degc:
        prediction = predict(model, motion, row, program)
        registers = prediction.account.registers
        checked += registers.cabinet("grid_import") - registers.cabinet("grid_return")
        broken = prediction.limits.sentences()
        if broken and form.recorded:  # the robot has made this motion
            given = form.motion(task, task.base)
            broken = prediction.limits.sentences(predict(model, given, row, program).limits)
    checked /= len(degc)
    expected = task.table.cost(held).energy
    problems = list(broken)
    if abs(checked / expected - 1.0) > MAX_DIFFERENCE:
        problems.append(
            f"the prediction of live operation gives {checked:.5g} J where {expected:.5g} J were "
            "expected: trust the figures less"
        )
    return OptimizationReport(
        program=program,
        model=model_used(model),
        cycle_time=task.cycle_time,
        peak_limit=task.peak_limit if math.isfinite(task.peak_limit) else None,
        cycles_per_year=cycles_per_year,
        before=_cycle(found.base),
        after=_cycle(found.cost),
        saving=_saving(found.saving, found.base),
        measures=tuple(_measure(one, found.base) for one in found.tried),
        moves=_moves(found, form),
        rests=_rests(found, form),
        front=tuple(FrontPoint(c.duration, c.energy, c.peak) for _, c in found.front),
        temperatures=_temperatures(found),
        break_even=_break_even(task),
        starts=(),
        supply=None,
        shared_bus=None,
        checked_energy=checked,
        how_to_try=_how_to_try(found),
        problems=tuple(problems),
        notes=(*form.notes, *notes, *_notes(found)),
    )


def _cycle(cost: Cost) -> CycleFigures:
    return CycleFigures(
        duration=cost.duration,
        energy=cost.energy,
        half=cost.half,
        mean_power=cost.energy / cost.duration,
        peak_power=cost.peak,
        brake_energy=cost.brake,
    )


def _saving(saved: Saving, base: Cost) -> SavingFigures:
    return SavingFigures(saved.energy, saved.energy / base.energy, saved.half, saved.claimed)


def _measure(one: Tried, base: Cost) -> MeasureResult:
    measure = one.measure
    cycle = None if one.cost is None else _cycle(one.cost)
    saved = None if one.saving is None else _saving(one.saving, base)
    return MeasureResult(
        measure.name, measure.label, measure.changes, cycle, saved, _verdict(saved)
    )


def _verdict(saved: SavingFigures | None) -> str:
    if saved is None or saved.relative is None:
        return DOES_NOT_APPLY
    if saved.claimed:
        return f"saves {100 * saved.relative:.1f} %"
    if abs(saved.relative) < MIN_CHANGE:
        return NOTHING
    return COSTS if saved.energy < -saved.half else NOT_CLAIMED


def _moves(found: Optimum, form: ProgramForm) -> tuple[MoveChange, ...]:
    table = found.task.table
    rows: list[MoveChange] = []
    for label, was, now in zip(
        form.labels, found.task.base.row.tolist(), found.plan.row.tolist(), strict=True
    ):
        ways, use = table.candidates, table.use
        rows.append(
            MoveChange(
                label,
                *(float(of[k]) for of in (ways.speed, ways.acceleration) for k in (was, now)),
                *(float(of[k]) for of in (use.duration, use.energy) for k in (was, now)),
            )
        )
    return tuple(rows)


def _rests(found: Optimum, form: ProgramForm) -> tuple[RestChange, ...]:
    held = found.task.table.held.energy.tolist()
    return tuple(
        RestChange(label, duration, "drives hold" if state is None else state.name, power)
        for label, duration, state, power in zip(
            form.labels, found.plan.rest.tolist(), found.plan.state, held, strict=True
        )
        if duration > 0
    )


def _temperatures(found: Optimum) -> tuple[TemperatureFigures, ...]:
    rows: list[TemperatureFigures] = []
    for index, degc in enumerate(found.task.chain.motor_temperature_degc.mean(axis=1).tolist()):
        own = _at(found.task, index)
        best = own.table.cost(together(own))
        rows.append(
            TemperatureFigures(
                degc,
                float(found.base.by_temperature[index]),
                float(found.cost.by_temperature[index]),
                best.energy,
                best.duration,
            )
        )
    return tuple(rows)


def _at(task: Task, index: int) -> Task:
    """The same task at one of its temperatures."""
    table = task.table
    use, held, braked = (
        replace(
            one,
            energy=one.by_temperature[:, index],
            by_temperature=one.by_temperature[:, [index]],
        )
        for one in (table.use, table.held, table.braked)
    )
    return replace(task, table=CostTable(table.candidates, use, held, braked, table.states))


def _break_even(task: Task) -> tuple[BreakEven, ...]:
    braked = float(task.table.braked.energy.mean())
    share = float(task.table.held.energy.mean()) / braked if braked > 0 else 1.0
    return tuple(
        BreakEven(state.name, break_even(state, share), state.wake_time, state.source)
        for state in task.table.states
    )


def _how_to_try(found: Optimum) -> tuple[str, ...]:
    steps = ["run the program as it is until the motors have the temperature stated here"]
    if (found.plan.row != found.task.base.row).any():
        steps.append(
            "set speed and acceleration of each move as listed; `--out` writes the program"
        )
    if any(found.plan.state):
        steps.append("switch the drives at rest as listed")
    steps.append(
        "measure both programs in the order as it is, as chosen, as chosen, as it is, at least "
        f"{MIN_CYCLES} cycles each, at the same motor temperature"
    )
    steps.append("compare energy per cycle at the meter, not mean power")
    return tuple(steps)


def _notes(found: Optimum) -> list[str]:
    notes = ["nothing here was measured: all figures are predictions of the model"]
    if DRIVE_MODELS[found.task.chain.model.drive].lossless:
        notes.append("the model has no drive losses: in it, holding against gravity costs nothing")
    if any("assumed" in state.source for state in found.task.table.states):
        notes.append(
            "power and wake-up of brakes, standby and hibernation are assumed: measure them and "
            "give them with --rest-states"
        )
    return notes
