"""`history_savings`: what a robot saved against the days of a baseline, from its history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import HOUR_NS, SECOND_NS
from robot_energy.history.api import Instant, history, history_events, history_jobs
from robot_energy.history.baseline import EnergyBaseline, Float, compare, fit_baseline
from robot_energy.history.tariffs import MICROJOULE_PER_KWH
from robot_energy.timeline.time_series import Column, TimeSeries

DRIVERS = ("parts", "motion_hours", "on_hours")
MIN_COMPARED = 0.95  # of a day that counts as metered [-]
Further = Mapping[str, Mapping[date, float]]


@dataclass(frozen=True)
class EnergySavings(TimeSeries):
    """What each reported day used, would have used, and has saved up to its end.

    Attributes:
        baseline: What explains energy, and how well.
        saved: Over all reported days; negative where more was used. [kWh]
        band: Half width of its 90 % band. [kWh]
        expected: Energy that these days would have used. [kWh]
        claimed: Whether a saving is certain: one in a thousand times there is none.
        notes: What to know of it, a sentence each.
    """

    baseline: EnergyBaseline = field(kw_only=True)
    saved: float = 0.0
    band: float = 0.0
    expected: float = 0.0
    claimed: bool = False
    notes: tuple[str, ...] = ()


def history_savings(
    folder: str | Path,
    robot: str,
    baseline: tuple[Instant, Instant],
    reported: tuple[Instant, Instant],
    drivers: Sequence[str] = ("parts",),
    timezone: str = "UTC",
    further: Further | None = None,
    measured: bool = False,
) -> EnergySavings:
    """Return what a robot saved against a baseline of earlier days, with its band (ISO 50006).

    Name what explains energy and is not changed by what saves it: parts, if motions became cheaper;
    not the hours of motion, if these became fewer. What explains energy and is not named, as the
    ambient temperature, looks like a saving.

    Args:
        folder: Folder of the history.
        robot: Its name.
        baseline: First day of the baseline, and the day after its last; whole days.
        reported: The same of the days that are compared with it.
        drivers: What explains the energy of a day: ``parts`` (jobs that ended), ``motion_hours``,
            ``on_hours``.
        timezone: Where days begin.
        further: More of that, by name and day, such as the ambient temperature. Days without a
            value are left out.
        measured: Whether the energy is that of the meter, of days that it covers, or that of the
            model, which knows no change of the robot that is not in its figures.

    Returns:
        A row of each reported day: ``energy``, ``expected``, ``saved`` up to its end (CUSUM) and
        ``band`` [kWh], and what explains its energy.

    Raises:
        HistoryError: If something that was asked for is not in the history, or there are too few
            days.
    """
    if unknown := [name for name in drivers if name not in DRIVERS]:
        raise HistoryError(f"a driver '{unknown[0]}'", ", ".join(DRIVERS))
    more, notes = further or {}, list[str]()
    _, before, explained, left = _days(folder, robot, baseline, drivers, timezone, more, measured)
    model = fit_baseline(before, explained)
    stamps, energy, own, missing = _days(folder, robot, reported, drivers, timezone, more, measured)
    if not len(energy):
        raise HistoryError("no reported day with all that explains its energy", "one day or more")
    found = compare(model, energy, own)
    if left or missing:
        notes.append(
            f"{left} days of the baseline and {missing} reported days are left out: not all of "
            "their energy, or of what explains it, is known"
        )
    if model.left_out:
        notes.append(f"{', '.join(model.left_out)} is constant or explained by the others")
    if found.outside:
        notes.append(f"{found.outside} reported days lie outside of what the baseline has seen")
    known = history_events(folder, baseline[0], reported[1], [robot], timezone)
    if changed := {"model", "meter"} & set(known["kind"].tolist()):
        notes.append(f"the {' and the '.join(sorted(changed))} changed meanwhile")
    columns: dict[str, Column] = {
        "energy": energy, "expected": found.expected, "saved": found.saved, "band": found.band,
        **own,
    }  # fmt: skip
    return EnergySavings(
        stamps,
        columns,
        units=dict.fromkeys(("energy", "expected", "saved", "band"), "kWh"),
        baseline=model,
        saved=float(found.saved[-1]),
        band=float(found.band[-1]),
        expected=float(found.expected.sum()),
        claimed=found.claimed,
        notes=tuple(notes),
    )


def _days(
    folder: str | Path, robot: str, span: tuple[Instant, Instant], drivers: Sequence[str],
    timezone: str, further: Further, measured: bool,
) -> tuple[np.ndarray, Float, dict[str, Float], int]:  # fmt: skip
    """Begin, energy [kWh] and what explains it, of days that are known; how many are not."""
    days = history(folder, *span, "day", [robot], timezone)
    ended = history_jobs(folder, *span, "day", [robot], timezone)
    starts, stops, on = days.stamp_ns, days["stop_ns"], days["observed_ns"]
    use = on > 0
    for begin, end in zip(days.not_resolved.stamp_ns, days.not_resolved["stop_ns"], strict=True):
        use &= (stops <= begin) | (starts >= end)
    if measured:
        use &= days["compared_ns"] >= MIN_COMPARED * on
    parts = np.zeros(len(days))
    for start, count in zip(ended.stamp_ns, ended["parts"], strict=True):
        parts[starts == start] += count
    known = {
        "parts": parts,
        "motion_hours": days["motion_ns"] / HOUR_NS,
        "on_hours": on / HOUR_NS,
    }
    explained = {name: known[name] for name in drivers}
    zone = ZoneInfo(timezone)
    for name, values in further.items():
        local = (datetime.fromtimestamp(one // SECOND_NS, UTC).astimezone(zone) for one in starts)
        explained[name] = np.array([values.get(one.date(), np.nan) for one in local], dtype=float)
        use &= np.isfinite(explained[name])
    energy = days["measured_microjoule" if measured else "predicted_import_microjoule"]
    return (
        starts[use],
        energy[use] / MICROJOULE_PER_KWH,
        {name: column[use] for name, column in explained.items()},
        int(len(use) - use.sum()),
    )
