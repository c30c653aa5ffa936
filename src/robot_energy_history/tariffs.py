"""Tariffs: prices by time of use, emissions and shifts, and from which day on each holds."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Sequence
from datetime import date, datetime
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import Field, field_validator, model_validator

from robot_energy.foundation.config_file import load
from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time, time_zone
from robot_energy.foundation.units import HOUR_NS, JOULE_PER_KWH, MINUTE_NS, SECOND_NS
from robot_energy.model.figure import ModelEntry
from robot_energy.store.slots import open_unlinked, read_regular

DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
MAX_PERIODS = 50
MAX_TARIFFS = 500
MAX_PRICE = 1e6  # [currency/kWh]; some currencies count in thousands
QUARTER = 15  # a slot of the history, at which prices and shifts may change [min]
DAY_MINUTES = 1440
FILE = "tariffs.jsonl"
MAX_BYTES = 8 * 2**20
MICROJOULE_PER_KWH = JOULE_PER_KWH * 1e6

Price = Annotated[float, Field(ge=0.0, le=MAX_PRICE, allow_inf_nan=False)]
Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
Rest = Literal["", "night", "weekend"]
Clock = Annotated[str, Field(pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]$|^24:00$")]
Short = Annotated[str, Field(min_length=1, max_length=8, pattern=r"^[^\x00-\x1f\x7f]+$")]


class PricePeriod(ModelEntry):
    """A time of the day with a price of its own."""

    days: Annotated[tuple[Day, ...], "Days of the week on which it begins."] = DAYS
    begin: Annotated[Clock, "Its first minute, local time."]
    end: Annotated[Clock, "The minute at which it ends; before ``begin``: on the next day."]
    price_per_kwh: Annotated[Price, "Price. [currency/kWh]"]

    def holds(self, local: datetime) -> bool:
        """Return whether the period holds at a local time."""
        minute = 60 * local.hour + local.minute
        begin, end = minute_of(self.begin), minute_of(self.end)
        today = DAYS[local.weekday()] in self.days
        if begin < end:
            return today and begin <= minute < end
        yesterday = DAYS[local.weekday() - 1] in self.days
        return (today and minute >= begin) or (yesterday and minute < end)


class Prices(ModelEntry):
    """What energy costs and emits."""

    currency: Annotated[Short, "Shown behind costs."] = "EUR"
    price_per_kwh: Annotated[
        Price | None, "Price outside all periods; None shows no cost. [currency/kWh]"
    ] = None
    time_of_use: Annotated[
        tuple[PricePeriod, ...],
        Field(max_length=MAX_PERIODS),
        "Periods with prices of their own; the first that holds applies.",
    ] = ()
    timezone: Annotated[
        str, Field(max_length=64), "Time zone of the periods, such as ``Europe/Berlin``."
    ] = "UTC"
    co2_kg_per_kwh: Annotated[
        Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] | None,
        "Emission factor of the supply; None shows no emission. [kg/kWh]",
    ] = None
    co2_source: Annotated[
        str, Field(max_length=200), "Where the factor comes from, shown with it."
    ] = ""

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, name: str) -> str:
        time_zone(name)
        return name

    @model_validator(mode="after")
    def _priced(self) -> Self:
        if self.time_of_use and self.price_per_kwh is None:
            raise ValueError("time_of_use needs price_per_kwh, the price outside all periods")
        return self

    def price_at(self, stamp_ns: int) -> float | None:
        """Return the price at an instant; None without prices. [currency/kWh]"""
        if self.price_per_kwh is None:
            return None
        return self.price_of(local_time(stamp_ns, ZoneInfo(self.timezone)))

    def price_of(self, local: datetime) -> float | None:
        """Return the price at a local time; None without prices. [currency/kWh]"""
        held = (one.price_per_kwh for one in self.time_of_use if one.holds(local))
        return next(held, self.price_per_kwh)

    def mean_price(self, start_ns: int, end_ns: int) -> float | None:
        """Return the mean over a time, each price by its share; None without. [currency/kWh]"""
        if not self.time_of_use or end_ns <= start_ns:
            return self.price_at(start_ns)
        parts = list(pairwise(self.edges(start_ns, end_ns)))
        return sum(
            (self.price_at(first) or 0.0) * ((last - first) / (end_ns - start_ns))
            for first, last in parts
        )

    def edges(self, start_ns: int, end_ns: int) -> list[int]:
        """Return in order when prices may change, the begins of local hours among them. [ns]"""
        zone = ZoneInfo(self.timezone)
        clocks = [clock for one in self.time_of_use for clock in (one.begin, one.end)]
        minutes = {0, *(minute_of(clock) % 60 for clock in clocks)}
        found = {start_ns, end_ns}
        for hour_ns in range(start_ns // HOUR_NS * HOUR_NS, end_ns, HOUR_NS):
            begin = local_time(hour_ns, zone).minute
            found.update(hour_ns + (minute - begin) % 60 * MINUTE_NS for minute in minutes)
        return sorted(edge for edge in found if start_ns <= edge <= end_ns)


class Night(ModelEntry):
    """The time that is night, on every day."""

    begin: Annotated[Clock, "When it begins, local time."] = "22:00"
    end: Annotated[Clock, "When it ends; before ``begin``: on the next day."] = "06:00"


class Tariff(Prices):
    """Prices that hold from a day on, until the next tariff begins."""

    begin: Annotated[
        date, Field(ge=date(1970, 1, 2), le=date(2200, 1, 1)), "First day, in the time zone."
    ]
    shifts: Annotated[
        tuple[Clock, ...], Field(max_length=12), "When shifts begin, local time."
    ] = ()
    night: Annotated[Night, "The time that is night."] = Night()
    weekend: Annotated[tuple[Day, ...], "Days without work, from midnight to midnight."] = (
        "sat",
        "sun",
    )

    @model_validator(mode="after")
    def _at_quarters(self) -> Self:
        odd = [clock for clock in self.clocks if minute_of(clock) % QUARTER]
        if odd:
            raise ValueError(
                f"{odd[0]} is not a quarter of an hour; the history knows what was used in each "
                "quarter, not within it"
            )
        return self

    @property
    def clocks(self) -> list[str]:
        """Local times at which prices, shifts or nights begin and end."""
        periods = (self.night, *self.time_of_use)
        return [*self.shifts, *(clock for one in periods for clock in (one.begin, one.end))]

    @property
    def begin_ns(self) -> int:
        """When it begins. [ns]"""
        return day_begin(self.begin, ZoneInfo(self.timezone))

    def shift_of(self, local: datetime) -> str:
        """Return when the shift of a local time begins; empty without shifts."""
        rising, minute = sorted(self.shifts, key=minute_of), 60 * local.hour + local.minute
        begun = [clock for clock in rising if minute_of(clock) <= minute]
        return (begun or rising or [""])[-1]

    def rest_of(self, local: datetime) -> Rest:
        """Return whether a local time is weekend or else night, in which nobody works."""
        if DAYS[local.weekday()] in self.weekend:
            return "weekend"
        begin, end = minute_of(self.night.begin), minute_of(self.night.end)
        since = (60 * local.hour + local.minute - begin) % DAY_MINUTES
        return "night" if since < (end - begin) % DAY_MINUTES else ""


class TariffFile(ModelEntry):
    """A file of tariffs."""

    tariffs: Annotated[tuple[Tariff, ...], Field(min_length=1, max_length=MAX_TARIFFS)]


@cache
def minute_of(clock: str) -> int:
    """Return the minute of the day of a time such as 06:30."""
    hour, minute = clock.split(":")
    return 60 * int(hour) + int(minute)


def day_begin(day: date, zone: ZoneInfo) -> int:
    """Return when a local day begins, also where summer time begins at midnight. [ns]"""
    return int(datetime(day.year, day.month, day.day, tzinfo=zone).timestamp()) * SECOND_NS


def load_tariffs(path: str) -> tuple[Tariff, ...]:
    """Return the tariffs of a file."""
    return load(path, TariffFile, HistoryError, "tariff file").tariffs


def add_tariffs(folder: Path, tariffs: Sequence[Tariff], now_ns: int) -> None:
    """Add tariffs to a history, also while a recorder writes it.

    One with the same begin holds from now on, and the earlier one is kept.
    """
    path = folder / FILE
    refuse_currencies(_holding([*stored_tariffs(folder), *tariffs]))
    lines = "".join(f"{now_ns} {one.model_dump_json()}\n" for one in tariffs).encode()
    try:
        file = open_unlinked(path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
            content = read_regular(path, MAX_BYTES) or b""
            whole = content.rfind(b"\n") + 1  # a line that a crash cut off is dropped
            if whole + len(lines) > MAX_BYTES:
                raise HistoryError(f"{path} would have over {MAX_BYTES} bytes", "fewer tariffs")
            os.ftruncate(file, whole)
            os.pwrite(file, lines, whole)
            os.fsync(file)
        finally:
            os.close(file)
    except OSError as error:
        raise HistoryError(f"{path} cannot be written ({error})", "a folder of yours") from error


def stored_tariffs(folder: str | Path) -> list[Tariff]:
    """Return the tariffs of a history that hold, in order of their begin."""
    path = Path(folder).expanduser() / FILE
    try:
        content = read_regular(path, MAX_BYTES) or b""
        lines = content[: content.rfind(b"\n") + 1].splitlines()
        found = [Tariff.model_validate_json(line.partition(b" ")[2]) for line in lines]
    except PermissionError as error:
        raise HistoryError(f"{path} cannot be read", "access rights to it") from error
    except (OSError, ValueError) as error:
        raise HistoryError(
            f"{path} cannot be read ({' '.join(str(error).split())})",
            "tariffs of this release, one a line",
            "move it away, and add the tariffs again",
        ) from error
    return _holding(found)


def refuse_currencies(tariffs: Sequence[Tariff]) -> None:
    """Refuse prices in two currencies, whose costs would be added up."""
    currencies = sorted({one.currency for one in tariffs if one.price_per_kwh is not None})
    if len(currencies) > 1:
        raise HistoryError(
            f"prices in {' and '.join(currencies)}, whose costs would be added up",
            "one currency in a history",
            "add the earlier tariffs again, with the same begin, in the new currency",
        )


def _holding(tariffs: Sequence[Tariff]) -> list[Tariff]:
    """Return the newest of each begin, in order of their begins."""
    newest = {one.begin_ns: one for one in tariffs}
    return [newest[begin] for begin in sorted(newest)]
