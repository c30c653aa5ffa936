"""Advice from recordings: every figure that terminal, JSON and pages show of it."""

from typing import Annotated

from robot_energy.results.base import ModelUsed, Number, Result, Texts


class AdviceBasis(Result):
    """How recordings stand for a day and a year."""

    recordings: Annotated[int, "Number of recordings."]
    recorded_time: Annotated[float, "Predicted time of all robots together. [s]"]
    recorded_energy: Annotated[float, "Energy from the grid in that time. [J]"]
    hours_per_day: Annotated[Number, "Hours of such work a day, all robots; None: not known. [h]"]
    days_per_year: Annotated[Number, "Days of such work a year; None: not given nor recorded. [1]"]
    duty: Annotated[Number, "Share of the time outside of rests, of 1 s or more in bags. [-]"]
    price_per_kwh: Annotated[Number, "Price of a kWh; None if none was given. [currency/kWh]"]
    currency: Annotated[str, "Currency of the price."]
    co2_kg_per_kwh: Annotated[Number, "Emission factor; None if none was given. [kg/kWh]"]
    sentence: Annotated[str, "What the recordings are, and how they stand for a year."]


class Advice(Result):
    """One change, and what it would save."""

    name: Annotated[
        str,
        "``standby``, ``regenerative``, ``shared_bus``, ``warm_up``, ``speeds`` or "
        "``waiting_pose``.",
    ]
    label: Annotated[str, "The change in words."]
    energy: Annotated[float, "Saved in the recordings. [J]"]
    half: Annotated[float, "Half width of its 90 % band. [J]"]
    relative: Annotated[Number, "Saving over the energy of the recordings. [-]"]
    claimed: Annotated[bool, "Whether the saving is larger than its band."]
    energy_per_hour: Annotated[float, "Saved in an hour of such work. [J]"]
    half_per_hour: Annotated[float, "Half width of the 90 % band of that. [J]"]
    energy_per_year: Annotated[Number, "Saved in a year; None if hours or days are not known. [J]"]
    half_per_year: Annotated[Number, "Half width of the 90 % band of that. [J]"]
    cost_per_year: Annotated[Number, "Cost saved in a year; None without a price. [currency]"]
    co2_per_year: Annotated[Number, "Emission saved in a year; None without a factor. [kg]"]
    sure: Annotated[
        str,
        "``measured``: from the meter alone; ``predicted``: by the model; ``assumed``: with a "
        "figure that nobody has measured.",
    ]
    found: Annotated[str, "What the recordings show."]
    change: Annotated[str, "What to do."]
    command: Annotated[str, "The next command; empty where there is none."]
    overlaps: Annotated[Texts, "Advice that saves a part of the same energy: do not add them."]


class AdviceReport(Result, name="advice"):
    """What would save how much."""

    source: Annotated[Texts, "Recordings, or the dataset."]
    model: Annotated[ModelUsed, "The model with which the recordings were replayed."]
    basis: Annotated[AdviceBasis, "How the recordings stand for a year."]
    advice: Annotated[tuple[Advice, ...], "What is claimed, the largest saving first."]
    unproven: Annotated[tuple[Advice, ...], "Savings that are smaller than their own uncertainty."]
    without: Annotated[Texts, "What these recordings do not show, and why, one sentence each."]
    energy_per_hour: Annotated[float, "Saved in an hour by all claims that do not overlap. [J]"]
    half_per_hour: Annotated[
        float, "Half width of its 90 % band: the sum of all, as they rest on one model. [J]"
    ]
    energy_per_year: Annotated[Number, "The same in a year; None where that is not known. [J]"]
    half_per_year: Annotated[Number, "Half width of the 90 % band of that. [J]"]
    counted: Annotated[Texts, "Names of the advice in that sum."]
    notes: Annotated[Texts, "What a reader should know."]
    problems: Annotated[Texts, "What was wrong with the recordings."]
