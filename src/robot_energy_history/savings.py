"""What robots saved against the days of a baseline, from their history, as ISO 50006.

Baseline days give ``E = c0 + sum(c_j x_j)`` [kWh] by least squares, x_j being what explains energy,
such as parts. A saving over reported days is the sum of what they were expected to use less what
they did. Its variance over k days with the sum u of their rows [1, x] is
``s^2 g (k + u' (X'X)^-1 u)``: scatter of these days and of the coefficients. s^2 is the variance of
the residuals, ``g = (1 + r) / (1 - r)`` their likeness from day to day (r, lag one), as ASHRAE
guideline 14 has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described, documented
from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, HOUR_NS
from robot_energy.timeline.time_series import Column, TimeSeries
from robot_energy_history.api import History, Instant, history, history_events, history_jobs
from robot_energy_history.tariffs import MICROJOULE_PER_KWH

Float = NDArray[np.float64]
BAND, CLAIM = 0.90, 0.998  # shares of truths within the band, and within that of a claim [-]
MIN_DEGREES = 7  # days more than coefficients, so that the scatter is known
INDEPENDENT = 1e-4  # share of a column that the others must leave, so that it counts
MAX_LIKENESS = 0.9  # of residuals a day apart [-]


class EnergyBaseline(Described):
    """What explains the energy of a day, and how well."""

    names: Annotated[tuple[str, ...], "Explaining quantities; the first is the constant part."]
    values: Annotated[Float, "Coefficients. [kWh per unit]"]
    inverse: Annotated[Float, "``(X'X)^-1``, shape (P, P)."]
    deviation: Annotated[float, "Standard deviation of the residuals. [kWh]"]
    likeness: Annotated[float, "Correlation of residuals of days that follow each other. [-]"]
    cv_rmse: Annotated[float, "Deviation over mean energy. [-]"]
    days: Annotated[int, "How many were used."]
    ranges: Annotated[dict[str, tuple[float, float]], "Least and greatest value of each, by name."]
    left_out: Annotated[tuple[str, ...], "Quantities that are constant, or that others explain."]

    @property
    def growth(self) -> float:
        """By what factor likeness makes the variance of a sum larger. [-]"""
        return (1.0 + self.likeness) / (1.0 - self.likeness)

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the deviation. [-]"""
        return max(self.days / self.growth - len(self.names), 2.0)

    @property
    def std(self) -> Float:
        """Standard deviations of the coefficients, shape (P,). [kWh per unit]"""
        return np.sqrt(np.diag(self.inverse) * self.growth) * self.deviation

    def half_width(self, share: float) -> float:
        """Return how many deviations a band has on each side. [-]

        Args:
            share: Of the truths that lie within it. [-]
        """
        from scipy.special import stdtrit  # heavy to import

        return float(stdtrit(self.degrees, 0.5 + 0.5 * share))


class CumulatedSaving(Described):
    """What reported days have saved up to each of them (CUSUM), shape (N,) each."""

    expected: Annotated[Float, "What each day would have used. [kWh]"]
    saved: Annotated[Float, "Expected less used, added up. [kWh]"]
    band: Annotated[Float, "Half width of the 90 % band of ``saved``. [kWh]"]
    claimed: Annotated[bool, "Whether its 99.8 % band at the end lies above zero."]
    outside: Annotated[int, "Days with a quantity outside the range of the baseline."]


def fit_baseline(energy: Float, drivers: Mapping[str, Float]) -> EnergyBaseline:
    """Return the baseline of days.

    Args:
        energy: Of each day, shape (N,). [kWh]
        drivers: What explains it, by name, shape (N,) each. [its own unit]
    """
    kept, left_out = [np.ones_like(energy)], list[str]()
    names = ["constant"]
    for name, column in drivers.items():
        known = np.stack(kept, axis=1)
        rest = column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
        if np.linalg.norm(rest) > INDEPENDENT * np.linalg.norm(column):
            kept.append(column)
            names.append(name)
        else:
            left_out.append(name)
    rows = np.stack(kept, axis=1)
    least = rows.shape[1] + MIN_DEGREES
    if len(energy) < least or not np.mean(energy) > 0.0:
        raise HistoryError(
            f"a baseline of {len(energy)} days with {np.sum(energy):.3f} kWh",
            f"at least {least} days on which the robot used energy",
            "name a longer baseline, or fewer of what explains the energy (--drivers)",
        )
    scale: Float = np.linalg.norm(rows, axis=0)
    inverse: Float = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    values: Float = inverse @ (rows.T @ energy)
    residual: Float = energy - rows @ values
    square = float(residual @ residual)
    likeness = float(residual[1:] @ residual[:-1]) / square if square > 0.0 else 0.0
    deviation = np.sqrt(square / (len(energy) - rows.shape[1]))
    return EnergyBaseline(
        tuple(names), values, inverse, float(deviation), float(np.clip(likeness, 0, MAX_LIKENESS)),
        float(deviation / np.mean(energy)), len(energy),
        {name: (float(one.min()), float(one.max())) for name, one in drivers.items()},
        tuple(left_out),
    )  # fmt: skip


def compare(
    baseline: EnergyBaseline, energy: Float, drivers: Mapping[str, Float]
) -> CumulatedSaving:
    """Return what reported days have saved.

    Args:
        energy: Of each day, shape (N,). [kWh]
        drivers: Of each day, as those of the baseline, shape (N,) each. [its own unit]
    """
    columns = [np.ones_like(energy), *(drivers[name] for name in baseline.names[1:])]
    rows = np.stack(columns, axis=1)
    expected = rows @ baseline.values
    saved = np.cumsum(expected - energy)
    sums = np.cumsum(rows, axis=0)
    spread = np.einsum("ki,ij,kj->k", sums, baseline.inverse, sums)
    count = np.arange(1, len(energy) + 1)
    deviation = baseline.deviation * np.sqrt(baseline.growth * (count + spread))
    outside = np.zeros(len(energy), dtype=bool)
    for name, (least, most) in baseline.ranges.items():
        outside |= (drivers[name] < least) | (drivers[name] > most)
    claimed = len(saved) > 0 and saved[-1] > baseline.half_width(CLAIM) * deviation[-1]
    return CumulatedSaving(
        expected, saved, baseline.half_width(BAND) * deviation, bool(claimed), int(outside.sum())
    )


DRIVERS = ("parts", "motion_hours", "on_hours")
MIN_COMPARED = 0.95  # of a day that counts as metered [-]
Further = Mapping[str, Mapping[date, float]]


class PartTrend(Described):
    """A straight line through the energy per part of each reported day."""

    mean: Annotated[float, "Energy of all these days over their parts. [kWh]"]
    change: Annotated[float, "From the first to the last of these days, over `mean`. [-]"]
    band: Annotated[float, "Half width of the 90 % band of ``change``. [-]"]


@documented
@dataclass(frozen=True)
class EnergySavings(TimeSeries):
    """What each reported day used, would have used, and has saved up to its end."""

    baseline: Annotated[EnergyBaseline, "What explains energy, and how well."] = field(kw_only=True)
    trend: Annotated[PartTrend | None, "Of the energy per part; None with too few days."] = None
    saved: Annotated[float, "Over all reported days; negative where more was used. [kWh]"] = 0.0
    band: Annotated[float, "Half width of its 90 % band. [kWh]"] = 0.0
    expected: Annotated[float, "Energy that these days would have used. [kWh]"] = 0.0
    claimed: Annotated[
        bool, "Whether a saving is certain: one time in a thousand there is none."
    ] = False
    notes: Annotated[tuple[str, ...], "What to know of it, a sentence each."] = ()


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
        ``band`` [kWh], ``parts``, and what explains its energy.

    Raises:
        HistoryError: If something that was asked for is not in the history, or there are too few
            days.
    """
    found, failed = savings_by_robot(
        folder, baseline, reported, drivers, [robot], timezone, further, measured
    )
    if robot in failed:
        raise failed[robot]
    return found[robot]


def savings_by_robot(
    folder: str | Path,
    baseline: tuple[Instant, Instant],
    reported: tuple[Instant, Instant],
    drivers: Sequence[str] = ("parts",),
    robots: Sequence[str] = (),
    timezone: str = "UTC",
    further: Further | None = None,
    measured: bool = False,
) -> tuple[dict[str, EnergySavings], dict[str, HistoryError]]:
    """Return what each robot saved as `history_savings` does, and why it is not known of others."""
    if unknown := [name for name in drivers if name not in DRIVERS]:
        raise HistoryError(f"a driver '{unknown[0]}'", ", ".join(DRIVERS))
    wish = _Wish(tuple(drivers), further or {}, measured, ZoneInfo(timezone))
    before, after = (
        (
            history(folder, *span, "day", robots, timezone),
            history_jobs(folder, *span, "day", robots, timezone),
        )
        for span in (baseline, reported)
    )
    if np.intersect1d(before[0].stamp_ns, after[0].stamp_ns).size:
        raise HistoryError(
            "reported days that are in the baseline as well",
            "days before or after it, as the same days save nothing against themselves",
        )
    events = history_events(folder, baseline[0], reported[1], robots, timezone)
    known = (*before[0]["robot"].tolist(), *after[0]["robot"].tolist())
    found: dict[str, EnergySavings] = {}
    failed: dict[str, HistoryError] = {}
    for robot in dict.fromkeys((*robots, *sorted(known))):
        kinds = set(events["kind"][events["robot"] == robot].tolist())
        try:
            found[robot] = _savings(_days(*before, robot, wish), _days(*after, robot, wish), kinds)
        except HistoryError as error:
            failed[robot] = error
    return found, failed


@dataclass(frozen=True)
class _Wish:
    """What explains energy, more of it by day, whose energy, and where days begin."""

    drivers: tuple[str, ...]
    further: Further
    measured: bool
    zone: ZoneInfo


class _Days(Described):
    stamps: Annotated[NDArray[np.int64], "Begin of each. [ns]"]
    energy: Annotated[Float, "Of each. [kWh]"]
    parts: Annotated[Float, "Jobs that ended in each."]
    explained: Annotated[dict[str, Float], "What explains the energy, by name."]
    left_out: Annotated[int, "How many days are not known."]


def _savings(before: _Days, after: _Days, changed: set[str]) -> EnergySavings:
    """Compare days with a baseline; changes of the robot meanwhile are noted."""
    model, notes = fit_baseline(before.energy, before.explained), list[str]()
    if not len(after.energy):
        raise HistoryError("no reported day with all that explains its energy", "one day or more")
    found = compare(model, after.energy, after.explained)
    if before.left_out or after.left_out:
        notes.append(
            f"{before.left_out} days of the baseline and {after.left_out} reported days are left "
            "out: not all of their energy, or of what explains it, is known"
        )
    if model.left_out:
        notes.append(f"{', '.join(model.left_out)} is constant or explained by the others")
    if found.outside:
        notes.append(f"reported days outside of what the baseline has seen: {found.outside}")
    if changed := {"model", "meter"} & changed:
        notes.append(f"the {' and the '.join(sorted(changed))} changed meanwhile")
    columns: dict[str, Column] = {
        "energy": after.energy, "expected": found.expected, "saved": found.saved,
        "band": found.band, "parts": after.parts, **after.explained,
    }  # fmt: skip
    return EnergySavings(
        after.stamps,
        columns,
        units=dict.fromkeys(("energy", "expected", "saved", "band"), "kWh"),
        baseline=model,
        trend=_trend(after),
        saved=float(found.saved[-1]),
        band=float(found.band[-1]),
        expected=float(found.expected.sum()),
        claimed=found.claimed,
        notes=tuple(notes),
    )


def _trend(days: _Days) -> PartTrend | None:
    """The straight line through the energy per part of days on which jobs ended."""
    use = days.parts > 0
    since = (days.stamps - days.stamps[0]) / DAY_NS
    try:
        line = fit_baseline(days.energy[use] / days.parts[use], {"days": since[use]})
    except HistoryError:
        return None
    mean, length = float(days.energy[use].sum() / days.parts[use].sum()), float(np.ptp(since[use]))
    scale = length / mean
    return PartTrend(
        mean, float(line.values[1]) * scale, line.half_width(BAND) * float(line.std[1]) * scale
    )


def _days(days: History, ended: TimeSeries, robot: str, wish: _Wish) -> _Days:
    own, spans = days["robot"] == robot, days.not_resolved
    starts, stops, on = (column[own] for column in (days.stamp_ns, days["stop_ns"],
                                                    days["observed_ns"]))  # fmt: skip
    use = on > 0
    of_robot = spans["robot"] == robot
    for begin, end in zip(spans.stamp_ns[of_robot], spans["stop_ns"][of_robot], strict=True):
        use &= (stops <= begin) | (starts >= end)
    if wish.measured:
        use &= days["compared_ns"][own] >= MIN_COMPARED * on
    parts = np.zeros(len(starts))
    jobs = ended["robot"] == robot
    for start, count in zip(ended.stamp_ns[jobs], ended["parts"][jobs], strict=True):
        parts[starts == start] += count
    known = {
        "parts": parts,
        "motion_hours": days["motion_ns"][own] / HOUR_NS,
        "on_hours": on / HOUR_NS,
    }
    explained = {name: known[name] for name in wish.drivers}
    for name, values in wish.further.items():
        local = (local_time(one, wish.zone) for one in starts)
        explained[name] = np.array([values.get(one.date(), np.nan) for one in local], dtype=float)
        use &= np.isfinite(explained[name])
    energy = days["measured_microjoule" if wish.measured else "predicted_import_microjoule"][own]
    return _Days(
        starts[use],
        energy[use] / MICROJOULE_PER_KWH,
        parts[use],
        {name: column[use] for name, column in explained.items()},
        int(len(use) - use.sum()),
    )
