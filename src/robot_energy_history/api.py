"""`history`: energy of robots over any span, by time and robot, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date, datetime
from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

import numpy as np

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import HistoryError
from robot_energy.timeline.time_series import Column, TimeSeries
from robot_energy_history.database import JOB_SUMS, reader
from robot_energy_history.queries import (
    RESOLUTIONS,
    Resolution,
    edges,
    events,
    jobs,
    learned_friction,
    not_resolved,
    robots_of,
    span_table,
    sums,
    table_of,
    zone_of,
)
from robot_energy_history.tariffs import day_begin, stored_tariffs
from robot_energy_history.use import ENERGIES, RESTS, Costs, costs

PRICED = (
    "cost", "co2_kg", "priced_microjoule",
    *(f"standby_{rest}_{unit}" for rest in RESTS for unit in ("microjoule", "cost")),
)  # fmt: skip
Instant = str | int | date | datetime


@documented
@dataclass(frozen=True)
class History(TimeSeries):
    """Energy over time: one row of each part of the time and robot, or joint."""

    not_resolved: Annotated[
        TimeSeries,
        "Spans that lie in no part, as while the recorder was off: what was used in them is known, "
        "not when. They are in no row of the table.",
    ] = field(kw_only=True)
    currency: Annotated[str, "Of the cost; empty without a tariff."] = ""


def history(
    folder: str | Path,
    start: Instant,
    stop: Instant,
    resolution: Resolution = "day",
    robots: Sequence[str] = (),
    timezone: str = "UTC",
    by_joint: bool = False,
    by_shift: bool = False,
) -> History:
    """Return what robots used, from the history that `energy_recorder` writes.

    Args:
        folder: Folder of the history.
        start: Begin: a date such as ``2026-03-29`` or a time, local to the zone, or in ns since
            1970.
        stop: End, likewise; a date is its beginning.
        resolution: ``minute``, which are kept for some weeks, ``quarter``, ``hour``, ``day``,
            ``week``, ``month``, ``year`` or ``all`` for one row of each robot.
        robots: Names of the robots; empty for all.
        timezone: Where days begin, such as ``Europe/Berlin``.
        by_joint: Whether each joint has a row; from quarter hours on.
        by_shift: Whether each shift of the tariffs has a row, ``shift`` being the time at which it
            begins; from quarter hours on. Rows have the energy from the grid and in standby alone.

    Returns:
        Columns ``robot`` (and ``joint``), ``stop_ns`` [ns], times in ns and energies in uJ as
        integers, ``flags``; with a tariff ``cost`` [currency], ``co2_kg`` and
        ``priced_microjoule``, the energy from the grid whose price is known, and of what is used
        in standby ``standby_night_microjoule``, ``standby_weekend_microjoule`` (a night at a
        weekend is weekend) and their ``standby_night_cost``, ``standby_weekend_cost``.

    Raises:
        HistoryError: If there is no history, or something that was asked for is not in it.
    """
    if (by_joint or by_shift) and resolution == "minute":
        raise HistoryError("minutes of joints or shifts", "a resolution of quarter or coarser")
    if by_joint and by_shift:
        raise HistoryError("joints by shift", "by_joint or by_shift")
    bounds = _bounds(start, stop, resolution, timezone)
    tariffs = stored_tariffs(folder)
    if by_shift and not any(one.shifts for one in tariffs):
        raise HistoryError(
            "shifts without a tariff that has some", "a tariff with shifts",
            "robot-energy history tariff --add FILE",
        )  # fmt: skip
    with reader(folder) as connection:
        known = robots_of(connection, robots)
        if by_joint:
            return _history(sums(connection, known, bounds, table="joint"))
        if resolution == "minute":
            spans = not_resolved(connection, known, bounds, minutes=True)
            return _history(sums(connection, known, bounds, minutes=True), spans)
        spans = not_resolved(connection, known, bounds)
        cost = costs(connection, known, bounds, tariffs, by_shift) if tariffs else {}
        if by_shift:
            return _by_shift(known, bounds, cost, spans, tariffs[-1].currency)
        found = sums(connection, known, bounds)
    if not tariffs:
        return _history(found, spans)
    priced = _priced(found, list(known), bounds, cost)
    return _history(found, spans, priced, tariffs[-1].currency)


def history_jobs(
    folder: str | Path,
    start: Instant,
    stop: Instant,
    resolution: Resolution = "all",
    robots: Sequence[str] = (),
    timezone: str = "UTC",
) -> TimeSeries:
    """Return the jobs that ended in each part of the time: parts, energy, energy per part.

    Arguments as in `history`.

    Returns:
        A row of each part of the time, robot and name: ``parts``, how many jobs ended,
        times in ns and energies in uJ as integers, ``microjoule_per_part``.

    Raises:
        HistoryError: As of `history`.
    """
    return job_sums(folder, _bounds(start, stop, resolution, timezone), robots)


def job_sums(
    folder: str | Path, bounds: Sequence[int], robots: Sequence[str],
    names: Sequence[str] = JOB_SUMS,
) -> TimeSeries:  # fmt: skip
    """Return what `history_jobs` does, between bounds [ns], of all that is summed or of some."""
    with reader(folder) as connection:
        found = jobs(connection, robots_of(connection, robots), bounds, names)
    used = names.index("predicted_import_microjoule") - len(names)
    kinds = {"robot": str, "stop_ns": int, "job": str, "parts": int, **dict.fromkeys(names, int)}
    rows = [(*one, one[used] / one[4]) for one in found]
    return table_of(rows, {**kinds, "microjoule_per_part": float})


def history_events(
    folder: str | Path,
    start: Instant,
    stop: Instant,
    robots: Sequence[str] = (),
    timezone: str = "UTC",
) -> TimeSeries:
    """Return what happened to robots and their registers: alarms, resets, restarts, meter changes.

    Arguments as in `history`.

    Returns:
        A row of each event, in order of time: ``robot``, ``kind`` and ``text``.

    Raises:
        HistoryError: As of `history`.
    """
    bounds = _bounds(start, stop, "all", timezone)
    with reader(folder) as connection:
        rows = events(connection, robots_of(connection, robots), bounds[0], bounds[1])
    return table_of(rows, {"robot": str, "kind": str, "text": str})


def history_friction(
    folder: str | Path,
    start: Instant,
    stop: Instant,
    resolution: Resolution = "month",
    robots: Sequence[str] = (),
    timezone: str = "UTC",
) -> TimeSeries:
    """Return what monitors have learned of the friction of each joint: wear over months.

    Arguments as in `history`; one ratio is kept of each UTC day, the newest.

    Returns:
        A row of each part of the time, robot, joint and model file: ``stop_ns`` [ns], ``robot``,
        ``joint``, ``model_id``, ``days`` with a ratio, and ``ratio``, the mean of measured friction
        over that of the model file, with ``least`` and ``greatest`` [-]. Ratios of two model files
        cannot be compared.

    Raises:
        HistoryError: As of `history`.
    """
    bounds = _bounds(start, stop, resolution, timezone)
    with reader(folder) as connection:
        rows = learned_friction(connection, robots_of(connection, robots), bounds)
    return table_of(
        rows,
        {"stop_ns": int, "robot": str, "joint": str, "model_id": str, "days": int,
         "ratio": float, "least": float, "greatest": float},
    )  # fmt: skip


def _bounds(start: Instant, stop: Instant, resolution: Resolution, timezone: str) -> list[int]:
    """Where parts of the time begin, and the end of the last. [ns]"""
    if resolution not in RESOLUTIONS:
        raise HistoryError(f"resolution '{resolution}'", ", ".join(RESOLUTIONS))
    zone = zone_of(timezone)
    begin, end = (stamp_of(one, zone) for one in (start, stop))
    if begin >= end:
        raise HistoryError(f"a time from {start} to {stop}", "a start before its stop")
    return edges(begin, end, resolution, zone)


def _by_shift(
    robots: dict[str, int],
    bounds: Sequence[int],
    found: dict[tuple[int, str], Costs],
    spans: TimeSeries,
    currency: str,
) -> History:
    names = (*ENERGIES, *PRICED)
    rows = [
        (bounds[part], robot, bounds[part + 1], shift, *(own[name][place] for name in names))
        for (part, shift), own in sorted(found.items())
        for place, robot in enumerate(robots)
        if any(own[name][place] for name in ENERGIES)
    ]
    kinds = {"robot": str, "stop_ns": int, "shift": str, **{name: _kind(name) for name in names}}
    return _history(table_of(rows, kinds), spans, currency=currency)


def _priced(
    table: TimeSeries, robots: list[str], bounds: Sequence[int], found: dict[tuple[int, str], Costs]
) -> dict[str, Column]:
    """Costs of the rows of a table, which are in order of time."""
    names, place = np.unique(table["robot"], return_inverse=True)
    place = np.array([robots.index(name) for name in names.tolist()], np.int64)[place]
    priced: dict[str, Column] = {name: np.zeros(len(table), _kind(name)) for name in PRICED}
    firsts = np.searchsorted(table.stamp_ns, bounds)
    for (part, _), own in found.items():
        rows = slice(firsts[part], firsts[part + 1])
        for name, values in priced.items():
            values[rows] = own[name][place[rows]]
    return priced


def _kind(name: str) -> type:
    return int if name.endswith("_microjoule") else float


def _history(
    table: TimeSeries,
    spans: TimeSeries | None = None,
    priced: dict[str, Column] | None = None,
    currency: str = "",
) -> History:
    units = {**table.units, "co2_kg": "kg"}
    for name in PRICED:
        units[name] = "uJ" if name.endswith("_microjoule") else units.get(name, currency)
    columns = {**table.columns, **(priced or {})}
    return History(
        table.stamp_ns,
        columns,
        units={name: unit for name, unit in units.items() if name in columns},
        not_resolved=span_table([]) if spans is None else spans,
        currency=currency,
    )


def stamp_of(instant: Instant, zone: ZoneInfo) -> int:
    """Return an instant, local to a zone unless it says its offset. [ns]"""
    if isinstance(instant, int):
        return instant
    if isinstance(instant, str):
        try:
            instant = datetime.fromisoformat(instant)
        except ValueError:
            raise HistoryError(
                f"time '{instant[:40]}'", "a date such as 2026-03-29, or 2026-03-29T06:00"
            ) from None
    if not isinstance(instant, datetime):
        return day_begin(instant, zone)
    local = instant if instant.tzinfo else instant.replace(tzinfo=zone)
    return round(local.timestamp() * 1e6) * 1000
