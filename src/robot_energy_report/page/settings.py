"""What the page adds to the monitors' figures: prices, emissions, the length of a shift."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import pairwise
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import Field, field_validator, model_validator

from robot_energy.foundation.config_file import load
from robot_energy.foundation.errors import PageError
from robot_energy.foundation.time_zone import time_zone
from robot_energy.foundation.units import HOUR_NS, JOULE_PER_KWH, MINUTE_NS, SECOND_NS
from robot_energy.model.figure import ModelEntry

DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
MAX_PERIODS = 50
MAX_PRICE = 1e6  # [currency/kWh]; some currencies count in thousands

Price = Annotated[float, Field(ge=0.0, le=MAX_PRICE, allow_inf_nan=False)]
Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
Clock = Annotated[str, Field(pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]$|^24:00$")]
Short = Annotated[str, Field(min_length=1, max_length=8, pattern=r"^[^\x00-\x1f\x7f]+$")]


class PricePeriod(ModelEntry):
    """A time of the day with a price of its own.

    Attributes:
        days: Days of the week on which it begins.
        begin: Its first minute, local time.
        end: The minute at which it ends; before ``begin``: on the next day.
        price_per_kwh: Price. [currency/kWh]
    """

    days: tuple[Day, ...] = DAYS
    begin: Clock
    end: Clock
    price_per_kwh: Price

    def holds(self, local: datetime) -> bool:
        """Return whether the period holds at a local time."""
        minute = 60 * local.hour + local.minute
        begin, end = _minute(self.begin), _minute(self.end)
        today = DAYS[local.weekday()] in self.days
        if begin < end:
            return today and begin <= minute < end
        yesterday = DAYS[local.weekday() - 1] in self.days
        return (today and minute >= begin) or (yesterday and minute < end)


class PageSettings(ModelEntry):
    """Settings of the page; all have defaults.

    Attributes:
        currency: Shown behind costs.
        price_per_kwh: Price outside all periods; None shows no cost. [currency/kWh]
        time_of_use: Periods with prices of their own; the first that holds applies.
        timezone: Time zone of the periods, such as ``Europe/Berlin``.
        co2_kg_per_kwh: Emission factor of the supply; None shows no emission. [kg/kWh]
        co2_source: Where the factor comes from, shown with it.
        shift_hours: Length of the longest live history. [h]
    """

    currency: Short = "EUR"
    price_per_kwh: Price | None = None
    time_of_use: Annotated[tuple[PricePeriod, ...], Field(max_length=MAX_PERIODS)] = ()
    timezone: Annotated[str, Field(max_length=64)] = "UTC"
    co2_kg_per_kwh: Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] | None = None
    co2_source: Annotated[str, Field(max_length=200)] = ""
    shift_hours: Annotated[float, Field(ge=1.0, le=24.0, allow_inf_nan=False)] = 8.0

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, name: str) -> str:
        time_zone(name)
        return name

    @model_validator(mode="after")
    def _priced(self) -> PageSettings:
        if self.time_of_use and self.price_per_kwh is None:
            raise ValueError("time_of_use needs price_per_kwh, the price outside all periods")
        return self

    def price_at(self, stamp_ns: int) -> float | None:
        """Return the price at an instant; None without prices. [currency/kWh]

        Args:
            stamp_ns: The instant. [ns]
        """
        if self.price_per_kwh is None:
            return None
        local = datetime.fromtimestamp(stamp_ns / SECOND_NS, ZoneInfo(self.timezone))
        held = (one.price_per_kwh for one in self.time_of_use if one.holds(local))
        return next(held, self.price_per_kwh)

    def mean_price(self, start_ns: int, end_ns: int) -> float | None:
        """Return the mean over a time, each price by its share of it. [currency/kWh]

        Args:
            start_ns: Its begin. [ns]
            end_ns: Its end. [ns]

        Returns:
            None without prices.
        """
        if not self.time_of_use or end_ns <= start_ns:
            return self.price_at(start_ns)
        parts = list(pairwise(self.edges(start_ns, end_ns)))
        return sum(
            (self.price_at(first) or 0.0) * ((last - first) / (end_ns - start_ns))
            for first, last in parts
        )

    def edges(self, start_ns: int, end_ns: int) -> list[int]:
        """Return when prices may change: between two of these instants one price holds. [ns]

        Args:
            start_ns: The first of them. [ns]
            end_ns: The last of them. [ns]

        Returns:
            In time order; the begins of local hours are among them.
        """
        zone = ZoneInfo(self.timezone)
        clocks = [clock for one in self.time_of_use for clock in (one.begin, one.end)]
        minutes = {0, *(_minute(clock) % 60 for clock in clocks)}
        found = {start_ns, end_ns}
        for hour_ns in range(start_ns // HOUR_NS * HOUR_NS, end_ns, HOUR_NS):
            begin = datetime.fromtimestamp(hour_ns // SECOND_NS, UTC).astimezone(zone).minute
            found.update(hour_ns + (minute - begin) % 60 * MINUTE_NS for minute in minutes)
        return sorted(edge for edge in found if start_ns <= edge <= end_ns)


class CostCounter:
    """Cost of an energy register under a tariff.

    With one price, the cost of the whole register. With times of use, that of the energy
    counted since the first register message: when the energy before was used is not known.

    Attributes:
        since_ns: Beginning of the energy that is priced; None before the first. [ns]
        price: In force at the last register; None before the first. [currency/kWh]
    """

    def __init__(self, settings: PageSettings) -> None:
        self._settings = settings
        self._sum = 0.0
        self._last: tuple[int, int, float] | None = None  # start, stamp, energy
        self.since_ns: int | None = None
        self.price: float | None = None

    def add(self, start_ns: int, stamp_ns: int, energy: float) -> None:
        """Take a register.

        Args:
            start_ns: When it was last set to zero. [ns]
            stamp_ns: Up to when it has counted. [ns]
            energy: Its value. [J]
        """
        if self._settings.price_per_kwh is None or not energy >= 0.0:
            return
        if not self._settings.time_of_use:
            self._sum = energy / JOULE_PER_KWH * self._settings.price_per_kwh
            self.since_ns, self.price = start_ns, self._settings.price_per_kwh
            return
        if self._last is None or start_ns != self._last[0] or energy < self._last[2]:
            self._sum, self.since_ns = 0.0, stamp_ns
        else:
            _, before_ns, before = self._last
            price = self._settings.price_at((before_ns + stamp_ns) // 2) or 0.0
            self._sum += (energy - before) / JOULE_PER_KWH * price
        self.price = self._settings.price_at(stamp_ns)
        self._last = (start_ns, stamp_ns, energy)

    @property
    def cost(self) -> float | None:
        """Cost since `since_ns`; None before the first register. [currency]"""
        return None if self.since_ns is None else self._sum


def load_settings(path: str) -> PageSettings:
    """Read the settings of the page.

    Args:
        path: A YAML file; empty for the defaults.

    Returns:
        The settings.

    Raises:
        PageError: If the file cannot be read or used.
    """
    return load(path, PageSettings, PageError, "page settings") if path else PageSettings()


def _minute(clock: str) -> int:
    hour, minute = clock.split(":")
    return 60 * int(hour) + int(minute)
