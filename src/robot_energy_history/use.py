"""Energy at the price of the time of use, by shift, and standby at night and at weekends.

A time is cut at quarter hours, each of which has one price, one shift, and is night, weekend or
neither. Whole numbers are added up first and multiplied by their price once.
"""

from __future__ import annotations

import sqlite3
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Annotated, Any
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS
from robot_energy_history.differences import SLOT_NS
from robot_energy_history.rollup import MAX_DAYS, QUARTERS, REGULAR, Rolled, curves_of
from robot_energy_history.tariffs import (
    DAY_MINUTES,
    MICROJOULE_PER_KWH,
    QUARTER,
    Rest,
    Tariff,
    day_begin,
    minute_of,
    refuse_currencies,
)

DAYS_AT_ONCE = 31
RESTS: tuple[Rest, ...] = ("night", "weekend")
ENERGIES = ("predicted_import_microjoule", "standby_microjoule")
MONDAY = datetime(2024, 1, 1)


class QuarterUse(Described):
    """What holds in a quarter hour; None for what differs within a longer span."""

    price: Annotated[float | None, "Price; None if none is known. [currency/kWh]"] = None
    co2: Annotated[float | None, "Emission factor; None if none is known. [kg/kWh]"] = None
    shift: Annotated[str | None, "When its shift begins, local time; empty without shifts."] = ""
    rest: Annotated[Rest | None, "Whether it is ``night`` or ``weekend``; empty for neither."] = ""


Costs = dict[str, NDArray[Any]]
"""Columns of what robots used and paid in a part of the time, or a shift in it, an item of each
robot: energy from the grid, in standby, with a price [uJ], cost [currency], emission [kg]."""
Sums = dict[QuarterUse, NDArray[np.int64]]
"""Energy from the grid and in standby, a row of each robot. [uJ]"""


def costs(
    connection: sqlite3.Connection,
    robots: dict[str, int],
    bounds: Sequence[int],
    tariffs: Sequence[Tariff],
    by_shift: bool = False,
) -> dict[tuple[int, str], Costs]:
    """Return what robots used and paid, by the number of the part and the shift, if asked for.

    Parts are of quarter hours or coarser, tariffs in order of their begin.
    """
    refuse_currencies(tariffs)
    places = {number: place for place, number in enumerate(robots.values())}
    edges = np.array(bounds, dtype=np.int64)
    sums: dict[tuple[int, str], Sums] = {}

    def add(part: int, use: QuarterUse, energy: NDArray[np.int64]) -> None:
        own = sums.setdefault((part, use.shift or "" if by_shift else ""), {})
        key = QuarterUse(use.price, use.co2, "", use.rest)
        own[key] = own[key] + energy if key in own else energy

    calendar = _Calendar(tariffs)
    for start, energy in _curves(connection, places, bounds[0], bounds[-1]):
        begins = start + SLOT_NS * np.arange(energy.shape[1], dtype=np.int64)
        part = np.searchsorted(edges, begins, "right") - 1
        stops = edges[np.clip(part + 1, 0, len(edges) - 1)]
        inside = (part >= 0) & (part < len(edges) - 1) & (begins + SLOT_NS <= stops)
        key = np.where(inside, part * calendar.capacity + calendar.of(start, len(begins)), -1)
        firsts = np.flatnonzero(np.diff(key, prepend=key[0] - 1))
        added = np.add.reduceat(energy, firsts, axis=1)
        keys: list[int] = key[firsts].tolist()
        for place, one in enumerate(keys):
            if one >= 0:
                add(one // calendar.capacity, calendar.uses[one % calendar.capacity],
                    added[:, place])  # fmt: skip
    for robot, begin, stop, *used in connection.execute(
        "SELECT s.robot, s.start, s.stop, s.predicted_import_microjoule, s.standby_microjoule FROM "
        "some r CROSS JOIN slot15 s ON s.robot = r.id AND s.start >= ? AND s.start < ? WHERE "
        "s.flags & 1", (bounds[0], bounds[-1]),
    ):  # fmt: skip
        number = bisect_right(bounds, begin) - 1
        if stop <= bounds[number + 1]:
            energy = np.zeros((len(places), 2), np.int64)
            energy[places[robot]] = used
            add(number, calendar.of_span(begin, stop), energy)
    return {key: _priced(own, len(places)) for key, own in sums.items()}


def _priced(sums: Sums, robots: int) -> Costs:
    """Multiply sums by their prices and factors, each once."""
    found: Costs = {name: np.zeros(robots, np.int64) for name in (*ENERGIES, "priced_microjoule")}
    found |= {name: np.zeros(robots) for name in ("cost", "co2_kg")}
    for rest in RESTS:
        found |= {f"standby_{rest}_microjoule": np.zeros(robots, np.int64),
                  f"standby_{rest}_cost": np.zeros(robots)}  # fmt: skip
    shares: dict[tuple[str, float], NDArray[np.int64]] = {}

    def add(name: str, factor: float | None, energy: NDArray[np.int64]) -> None:
        if factor is not None:
            key = (name, factor)
            shares[key] = shares[key] + energy if key in shares else energy

    for use, energy in sums.items():
        imported, standby = energy.T
        for name, own in zip(ENERGIES, energy.T, strict=True):
            found[name] += own
        add("cost", use.price, imported)
        add("co2_kg", use.co2, imported)
        if use.price is not None:
            found["priced_microjoule"] += imported
        if use.rest:
            found[f"standby_{use.rest}_microjoule"] += standby
            add(f"standby_{use.rest}_cost", use.price, standby)
    for (name, factor), own in shares.items():
        found[name] += own / MICROJOULE_PER_KWH * factor
    return found


def _curves(
    connection: sqlite3.Connection, places: dict[int, int], start_ns: int, stop_ns: int
) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield begin, and energy from the grid and in standby by robot and quarter hour. [ns], [uJ]"""
    until = Rolled.of(connection).until_ns
    ranges = [
        connection.execute(
            f"SELECT min((SELECT start FROM {table} s WHERE s.robot = r.id AND s.start >= ? "
            f"ORDER BY start LIMIT 1)), max((SELECT start FROM {table} s WHERE s.robot = r.id "
            "AND s.start < ? ORDER BY start DESC LIMIT 1)) FROM some r",
            (start_ns // DAY_NS * DAY_NS, stop_ns),
        ).fetchone()
        for table in ("slot1440", "slot15")
    ]
    known = [one for one in ranges if one[0] is not None and one[1] is not None]
    if not known:
        return
    day = min(one[0] for one in known) // DAY_NS * DAY_NS
    last = max(one[1] for one in known)
    while day <= last:
        days = min(DAYS_AT_ONCE, (last - day) // DAY_NS + 1)
        end = day + days * DAY_NS
        rows = connection.execute(
            "SELECT s.id, s.energy FROM some r CROSS JOIN curve s ON s.id >= r.id * ? + ? AND "
            "s.id < r.id * ? + ?", (MAX_DAYS, day // DAY_NS, MAX_DAYS, end // DAY_NS),
        ).fetchall()  # fmt: skip
        at = [
            places[number // MAX_DAYS] * days + number % MAX_DAYS - day // DAY_NS
            for number, _ in rows
        ]
        energy = curves_of([blob for _, blob in rows])
        if at != list(range(len(places) * days)):  # days that are not rolled up, or have nothing
            whole = np.zeros((len(places) * days, QUARTERS, 2), np.int64)
            whole[at] = energy
            energy = whole
        energy = energy.reshape(len(places), days * QUARTERS, 2)
        for robot, start, *used in connection.execute(
            "SELECT s.robot, s.start, s.predicted_import_microjoule, s.standby_microjoule FROM "
            "some r CROSS JOIN slot15 s ON s.robot = r.id AND s.start >= ? AND s.start < ? WHERE "
            + REGULAR.format(length=SLOT_NS), (max(day, until), end),
        ):  # fmt: skip
            energy[places[robot], (start - day) // SLOT_NS] += used
        yield day, energy
        day = end


@dataclass
class _Calendar:
    """Which use holds in each quarter hour."""

    tariffs: Sequence[Tariff]
    uses: list[QuarterUse] = field(default_factory=lambda: [QuarterUse()])
    capacity: int = 2**20
    _numbers: dict[QuarterUse, int] = field(default_factory=lambda: {QuarterUse(): 0})
    _weekdays: dict[tuple[int, int], NDArray[np.int64]] = field(
        default_factory=dict[tuple[int, int], NDArray[np.int64]]
    )

    def of(self, start_ns: int, count: int) -> NDArray[np.int64]:
        """Return numbers of uses of quarter hours from a time on; 0 before the first tariff."""
        found, stop_ns = np.zeros(count, np.int64), start_ns + count * SLOT_NS
        ends = [one.begin_ns for one in self.tariffs[1:]] + [stop_ns]
        for number, (tariff, until) in enumerate(zip(self.tariffs, ends, strict=True)):
            zone = ZoneInfo(tariff.timezone)
            begin, end = max(start_ns, tariff.begin_ns), min(stop_ns, until)
            if begin >= end:
                continue
            day = local_time(begin, zone).date()
            first = day_begin(day, zone)
            while first < end:
                day += timedelta(days=1)
                following = day_begin(day, zone)
                own = self._day(number, tariff, first, following, zone)
                at = (first - start_ns) // SLOT_NS
                low = max(0, -(-(begin - start_ns) // SLOT_NS))
                high = min(count, (end - start_ns) // SLOT_NS, at + len(own))
                if max(low, at) < high:
                    found[max(low, at) : high] = own[max(low, at) - at : high - at]
                first = following
        return found

    def of_span(self, start_ns: int, stop_ns: int) -> QuarterUse:
        """Return what holds all the time of a span."""
        first = start_ns // SLOT_NS * SLOT_NS
        numbers: list[int] = np.unique(self.of(first, -(-(stop_ns - first) // SLOT_NS))).tolist()
        held = [self.uses[number] for number in numbers]
        same = {
            name: values.pop() if len(values := {getattr(use, name) for use in held}) == 1 else None
            for name in ("price", "co2", "shift", "rest")
        }
        return QuarterUse(**same)

    def _day(
        self, number: int, tariff: Tariff, first: int, following: int, zone: ZoneInfo
    ) -> NDArray[np.int64]:
        local = local_time(first, zone)
        if following - first != DAY_NS:
            clocks = (local_time(begin, zone) for begin in range(first, following, SLOT_NS))
            return np.array([self._number(tariff, clock) for clock in clocks], np.int64)
        key = number, local.weekday()
        if key not in self._weekdays:
            found = self._weekdays[key] = np.zeros(DAY_MINUTES // QUARTER, np.int64)
            midnight = MONDAY + timedelta(days=local.weekday())
            edges = sorted({0, DAY_MINUTES, *map(minute_of, tariff.clocks)})
            for begin, end in pairwise(edges):
                use = self._number(tariff, midnight + timedelta(minutes=begin))
                found[begin // QUARTER : end // QUARTER] = use
        return self._weekdays[key]

    def _number(self, tariff: Tariff, local: datetime) -> int:
        use = QuarterUse(
            tariff.price_of(local), tariff.co2_kg_per_kwh, tariff.shift_of(local),
            tariff.rest_of(local),
        )  # fmt: skip
        if use not in self._numbers:
            self._numbers[use] = len(self.uses)
            self.uses.append(use)
        return self._numbers[use]
