"""Advice from recordings: every figure that terminal, JSON and pages show of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robot_energy.results.base import Number, Result
from robot_energy.results.model import ModelUsed


@dataclass(frozen=True)
class AdviceBasis(Result):
    """How recordings stand for a day and a year.

    Attributes:
        recordings: How many.
        recorded_time: Predicted, of all robots together. [s]
        recorded_energy: From the grid in that time. [J]
        hours_per_day: Of such work by all robots together. [h]
        days_per_year: With such work. [1]
        duty: Share of the recorded time outside of rests; in bags these last 1 s or more. [-]
        price_per_kwh: None without one. [currency/kWh]
        currency: Of the price.
        co2_kg_per_kwh: None without one. [kg/kWh]
        sentence: What the figures rest on.
    """

    recordings: int
    recorded_time: float
    recorded_energy: float
    hours_per_day: float
    days_per_year: float
    duty: Number
    price_per_kwh: Number
    currency: str
    co2_kg_per_kwh: Number
    sentence: str


@dataclass(frozen=True)
class Advice(Result):
    """One change, and what it would save.

    Attributes:
        name: ``standby``, ``regenerative``, ``warm_up``, ``speeds`` or ``waiting_pose``.
        label: In words.
        energy: Saved in the recordings. [J]
        half: Half width of its 90 % band. [J]
        relative: Over the energy of the recordings. [-]
        claimed: Whether it is larger than its band.
        energy_per_hour: Saved in an hour of such work. [J]
        energy_per_day: [J]
        energy_per_year: [J]
        half_per_year: Half width of the 90 % band of that. [J]
        cost_per_year: At the price; None without one. [currency]
        co2_per_year: None without a factor. [kg]
        sure: ``measured``: from the meter alone; ``predicted``: by the model; ``assumed``: with a
            figure that nobody has measured.
        found: What the recordings show.
        change: What to do.
        command: The next command; empty where there is none.
        overlaps: Advice that saves a part of the same energy: do not add them.
    """

    name: str
    label: str
    energy: float
    half: float
    relative: Number
    claimed: bool
    energy_per_hour: float
    energy_per_day: float
    energy_per_year: float
    half_per_year: float
    cost_per_year: Number
    co2_per_year: Number
    sure: str
    found: str
    change: str
    command: str
    overlaps: tuple[str, ...]


@dataclass(frozen=True)
class AdviceReport(Result):
    """What would save how much.

    Attributes:
        source: Recordings, or the dataset.
        model: With which they were replayed.
        basis: How they stand for a year.
        advice: What is claimed, the largest saving first.
        unproven: What was looked at and is smaller than its own uncertainty.
        without: What these recordings say nothing of, and why, one sentence each.
        energy_per_year: Of all that is claimed and does not overlap. [J]
        counted: Names of the advice in that sum.
        notes: What a reader should know.
        problems: What was wrong with the recordings.
    """

    NAME: ClassVar[str] = "advice"

    source: tuple[str, ...]
    model: ModelUsed
    basis: AdviceBasis
    advice: tuple[Advice, ...]
    unproven: tuple[Advice, ...]
    without: tuple[str, ...]
    energy_per_year: float
    counted: tuple[str, ...]
    notes: tuple[str, ...]
    problems: tuple[str, ...]
