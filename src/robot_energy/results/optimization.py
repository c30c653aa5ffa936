"""Cheaper programs: every figure that terminal, JSON and pages show of them."""

from typing import Annotated

from robot_energy.results.base import Number, Result, Texts
from robot_energy.results.model import ModelUsed


class CycleFigures(Result):
    """What one cycle needs."""

    duration: Annotated[float, "With all rests. [s]"]
    energy: Annotated[float, "From the grid. [J]"]
    half: Annotated[float, "Half width of its 90 % band. [J]"]
    mean_power: Annotated[float, "[W]"]
    peak_power: Annotated[float, "Greatest power from the grid. [W]"]
    brake_energy: Annotated[float, "Into the brake resistor. [J]"]


class SavingFigures(Result):
    """What a change saves per cycle."""

    energy: Annotated[float, "Positive where it is less. [J]"]
    relative: Annotated[Number, "Over the energy as it is. [-]"]
    half: Annotated[float, "Half width of the 90 % band of the saving. [J]"]
    claimed: Annotated[bool, "Whether it is larger than that."]


class MeasureResult(Result):
    """One measure alone."""

    name: Annotated[str, "Of the measure."]
    label: Annotated[str, "In words."]
    changes: Annotated[str, "What is changed."]
    cycle: Annotated[CycleFigures | None, "With it; None where it does not apply."]
    saving: Annotated[
        SavingFigures | None, "Over the program as it is; None where it does not apply."
    ]
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

    motor_temperature_degc: Annotated[float, "Of all motors, their mean. [degC]"]
    energy_before: Annotated[float, "As it is. [J]"]
    energy: Annotated[float, "As chosen for all temperatures. [J]"]
    best_energy: Annotated[float, "As it would be chosen for this one. [J]"]
    best_duration: Annotated[float, "Time of the moves then. [s]"]


class BreakEven(Result):
    """From which rest on a state pays."""

    state: Annotated[str, "Its name."]
    shortest_rest: Annotated[
        Number, "Rest from which it costs less than drives that hold; None: never. [s]"
    ]
    wake_time: Annotated[float, "[s]"]
    source: Annotated[str, "Where its figures come from."]


class StartTime(Result):
    """When a robot on a common supply starts."""

    program: Annotated[str, "Of the robot."]
    start: Annotated[float, "After the beginning of the common cycle. [s]"]


class CommonSupply(Result):
    """Power of a supply for several robots."""

    peak_power_together: Annotated[float, "Greatest, with all starts at once. [W]"]
    peak_power: Annotated[float, "Greatest, with the starts as chosen. [W]"]
    mean_power: Annotated[float, "Whatever the starts. [W]"]


class OptimizationReport(Result, name="optimization"):
    """A program, and how it needs less energy for the same work."""

    program: Annotated[str, "Its name."]
    model: Annotated[ModelUsed, "The model used."]
    cycle_time: Annotated[
        Number, "Time of one cycle that was given; None: the next one begins at once. [s]"
    ]
    peak_limit: Annotated[Number, "Of the power from the grid that was given. [W]"]
    before: Annotated[CycleFigures, "The program as it is."]
    after: Annotated[CycleFigures, "As chosen: all measures that change the program, together."]
    saving: Annotated[SavingFigures, "Of the choice."]
    measures: Annotated[tuple[MeasureResult, ...], "Each measure alone."]
    moves: Annotated[tuple[MoveChange, ...], "Move by move."]
    rests: Annotated[tuple[RestChange, ...], "Rest by rest."]
    front: Annotated[
        tuple[FrontPoint, ...],
        "Trade-offs of energy, time and peak power, without waits, from fast to slow.",
    ]
    temperatures: Annotated[
        tuple[TemperatureFigures, ...], "At each temperature that was asked for."
    ]
    break_even: Annotated[tuple[BreakEven, ...], "States at rest."]
    starts: Annotated[
        tuple[StartTime, ...],
        "Of this robot, as chosen, and of the others on its supply; empty without others.",
    ]
    supply: Annotated[CommonSupply | None, "Power of that supply; None without others."]
    checked_energy: Annotated[float, "Of the choice by the prediction of live operation. [J]"]
    how_to_try: Annotated[Texts, "What to do on the robot, in this order."]
    problems: Annotated[Texts, "What makes the figures doubtful, one sentence each."]
    notes: Annotated[Texts, "What a reader should know, one sentence each."]
