"""Cheaper programs: every figure that terminal, JSON and pages show of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robot_energy.results.base import Number, Result
from robot_energy.results.model import ModelUsed


@dataclass(frozen=True)
class CycleFigures(Result):
    """What one cycle needs.

    Attributes:
        duration: With all rests. [s]
        energy: From the grid. [J]
        half: Half width of its 90 % band. [J]
        mean_power: [W]
        peak_power: Greatest power from the grid. [W]
        brake_energy: Into the brake resistor. [J]
    """

    duration: float
    energy: float
    half: float
    mean_power: float
    peak_power: float
    brake_energy: float


@dataclass(frozen=True)
class SavingFigures(Result):
    """What a change saves per cycle.

    Attributes:
        energy: Positive where it is less. [J]
        relative: Over the energy as it is. [-]
        half: Half width of the 90 % band of the saving. [J]
        claimed: Whether it is larger than that.
    """

    energy: float
    relative: Number
    half: float
    claimed: bool


@dataclass(frozen=True)
class MeasureResult(Result):
    """One measure alone.

    Attributes:
        name: Of the measure.
        label: In words.
        changes: What is changed.
        cycle: With it; None where it does not apply.
        saving: Over the program as it is; None where it does not apply.
        verdict: What is claimed, in one sentence.
    """

    name: str
    label: str
    changes: str
    cycle: CycleFigures | None
    saving: SavingFigures | None
    verdict: str


@dataclass(frozen=True)
class MoveChange(Result):
    """One move as it is, and as chosen.

    Attributes:
        move: From where to where.
        speed_before: Share of the speed limits. [-]
        speed: As chosen; None for a time law of its own. [-]
        acceleration_before: Share of the acceleration limits. [-]
        acceleration: As chosen. [-]
        duration_before: [s]
        duration: As chosen. [s]
        energy_before: [J]
        energy: As chosen. [J]
    """

    move: str
    speed_before: float
    speed: Number
    acceleration_before: float
    acceleration: Number
    duration_before: float
    duration: float
    energy_before: float
    energy: float


@dataclass(frozen=True)
class RestChange(Result):
    """One rest as chosen.

    Attributes:
        before: The move that follows it.
        duration: [s]
        state: How it is spent.
        power: While the drives hold. [W]
    """

    before: str
    duration: float
    state: str
    power: float


@dataclass(frozen=True)
class FrontPoint(Result):
    """A program of which no other is better in energy, time and peak power at once.

    Attributes:
        duration: [s]
        energy: [J]
        peak_power: [W]
    """

    duration: float
    energy: float
    peak_power: float


@dataclass(frozen=True)
class TemperatureFigures(Result):
    """The program at one temperature.

    Attributes:
        motor_temperature_degc: Of all motors, their mean. [degC]
        energy_before: As it is. [J]
        energy: As chosen for all temperatures. [J]
        best_energy: As it would be chosen for this one. [J]
        best_duration: Time of the moves then. [s]
    """

    motor_temperature_degc: float
    energy_before: float
    energy: float
    best_energy: float
    best_duration: float


@dataclass(frozen=True)
class BreakEven(Result):
    """From which rest on a state pays.

    Attributes:
        state: Its name.
        shortest_rest: Rest from which it costs less than drives that hold; None: never. [s]
        wake_time: [s]
        source: Where its figures come from.
    """

    state: str
    shortest_rest: Number
    wake_time: float
    source: str


@dataclass(frozen=True)
class StartTime(Result):
    """When a robot on a common supply starts.

    Attributes:
        program: Of the robot.
        start: After the beginning of the common cycle. [s]
    """

    program: str
    start: float


@dataclass(frozen=True)
class CommonSupply(Result):
    """Power of a supply for several robots.

    Attributes:
        peak_power_together: Greatest, with all starts at once. [W]
        peak_power: Greatest, with the starts as chosen. [W]
        mean_power: Whatever the starts. [W]
    """

    peak_power_together: float
    peak_power: float
    mean_power: float


@dataclass(frozen=True)
class OptimizationReport(Result):
    """A program, and how it needs less energy for the same work.

    Attributes:
        program: Its name.
        model: The model used.
        cycle_time: Time of one cycle that was given; None: the next one begins at once. [s]
        peak_limit: Of the power from the grid that was given. [W]
        before: The program as it is.
        after: As chosen: all measures that change the program, together.
        saving: Of the choice.
        measures: Each measure alone.
        moves: Move by move.
        rests: Rest by rest.
        front: Trade-offs of energy, time and peak power, without waits, from fast to slow.
        temperatures: At each temperature that was asked for.
        break_even: States at rest.
        starts: Of this robot, as chosen, and of the others on its supply; empty without others.
        supply: Power of that supply; None without others.
        checked_energy: Of the choice by the prediction of live operation. [J]
        how_to_try: What to do on the robot, in this order.
        problems: What makes the figures doubtful, one sentence each.
        notes: What a reader should know, one sentence each.
    """

    NAME: ClassVar[str] = "optimization"

    program: str
    model: ModelUsed
    cycle_time: Number
    peak_limit: Number
    before: CycleFigures
    after: CycleFigures
    saving: SavingFigures
    measures: tuple[MeasureResult, ...]
    moves: tuple[MoveChange, ...]
    rests: tuple[RestChange, ...]
    front: tuple[FrontPoint, ...]
    temperatures: tuple[TemperatureFigures, ...]
    break_even: tuple[BreakEven, ...]
    starts: tuple[StartTime, ...]
    supply: CommonSupply | None
    checked_energy: float
    how_to_try: tuple[str, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]
