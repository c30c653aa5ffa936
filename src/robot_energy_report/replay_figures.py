"""Curves of a replay, thinned without losing energy: power, residual, energy (paper A, fig. 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np

from robot_energy.accounting.energy_curve import EnergyCurve, EnergyRows, add_compared
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ShapeError
from robot_energy.pipeline import Output
from robot_energy.replay.bag_replay import Replay
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import Compared
from robot_energy_report.canvas import COLOURS, LINES, SERIES, Axes, Target, canvas
from robot_energy_report.formats import EnergyFormat, typeset
from robot_energy_report.page.history import HistoryRing

MAX_POINTS = 2000
BREAK = 1.5  # in lengths of a point: a longer step in time breaks the curve

Role = Literal["measured", "predicted", "fixed"]


class Series(Described):
    """One curve."""

    label: str
    role: Role
    time: Annotated[Float, "Middle of each point; NaN breaks the curve, shape (K,). [s]"]
    power: Annotated[Float, "Mean of each point, shape (K,). [W]"]
    energy_time: Annotated[Float, "Ends of the points, shape (L,). [s]"]
    energy: Annotated[Float, "From the start, level where unknown, shape (L,). [J]"]
    energy_half: Annotated[float, "Half the 90 % band of the last energy. [J]"] = float("nan")


def compared_series(
    result: Replay, label: str = "predicted", role: Role = "predicted"
) -> tuple[Series, Series] | None:
    """Return measured and predicted power at the meter, over what both cover; None for nothing."""
    return _pair(result.compared_curve, result.account.registers.time.start_ns, label, role)


def series_of(
    compared: Sequence[Compared], start_ns: int, label: str = "predicted", role: Role = "predicted"
) -> tuple[Series, Series] | None:
    """Return measured and predicted power at the meter; None where nothing was compared."""
    curve = EnergyCurve(3)
    for part in compared:
        add_compared(curve, part)
    return _pair(curve, start_ns, label, role)


def _pair(
    curve: EnergyCurve | None, start_ns: int | None, label: str, role: Role
) -> tuple[Series, Series] | None:
    rows = None if curve is None else curve.rows()
    if rows is None or start_ns is None or not len(rows.stamp_ns):
        return None
    first = _series("measured", "measured", rows, start_ns, 0, 0)
    return first, _series(label, role, rows, start_ns, 1, 2)


def predicted_series(
    result: Replay, label: str = "predicted", role: Role = "predicted"
) -> Series | None:
    """Return the predicted power from the grid, for bags without a meter; None for nothing."""
    curve, start_ns = result.predicted_curve, result.account.registers.time.start_ns
    rows = None if curve is None else curve.rows()
    if rows is None or start_ns is None or not len(rows.stamp_ns):
        return None
    return _series(label, role, rows, start_ns, 0, 0)


def curves_of(results: Sequence[Replay], changes: Sequence[str | None]) -> list[Series]:
    """Return the curves of one or two replays of a bag, the measured one first."""
    curves: list[Series] = []
    for result, change in zip(results, changes, strict=True):
        label = "predicted, friction by temperature" if len(results) > 1 else "predicted"
        label, role = (f"predicted, {change}", "fixed") if change else (label, "predicted")
        pair = compared_series(result, label, role)
        if pair is not None:
            curves += [*pair[:1], _with_band(pair[1], result)][1 if curves else 0 :]
        elif (curve := predicted_series(result, label, role)) is not None:
            curves.append(_with_band(curve, result))
    return curves


def _with_band(curve: Series, result: Replay) -> Series:
    """The curve with the band of the replay's energy, by the share of it that is shown."""
    registers = result.account.registers
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    shown = abs(float(curve.energy[-1]) / net) if net else float("nan")
    return replace(curve, energy_half=result.account.energy_band.half * shown)


def _series(
    label: str, role: Role, rows: EnergyRows, start_ns: int, power: int, energy: int
) -> Series:
    """Merge neighbours until few enough are left; points stand in their middle."""
    begin_ns, end_ns = rows.begin_ns - start_ns, rows.stamp_ns - start_ns
    every = -(-len(end_ns) // MAX_POINTS)
    firsts = np.arange(0, len(end_ns), every)
    lasts = np.minimum(firsts + every, len(end_ns)) - 1
    begin = _seconds(begin_ns[firsts])
    end = _seconds(end_ns[lasts])
    width = _seconds(np.add.reduceat(rows.duration_ns, firsts))
    joule = np.add.reduceat(rows.energy[:, power], firsts)
    total = np.cumsum(np.add.reduceat(rows.energy[:, energy], firsts))
    step = begin[1:] - end[:-1]
    cuts = np.flatnonzero((step > BREAK * np.median(width)) | (step < 0)) + 1
    return Series(
        label,
        role,
        np.insert(0.5 * (begin + end), cuts, np.nan),
        np.insert(joule / width, cuts, np.nan),
        np.asarray(np.insert(end, np.append(0, cuts), begin[np.append(0, cuts)]), np.float64),
        np.insert(total, np.append(0, cuts), np.append(0.0, total[cuts - 1])),
    )


def _seconds(time_ns: Int) -> Float:
    return np.asarray(time_ns * NANOSECOND, dtype=np.float64)


MINUTE = 60.0  # s
MAX_TIME_IN_SECONDS = 600.0  # s, from here on the axis counts minutes
MIN_SPAN = 10.0  # of the axis of temperatures [K]
MIN_WIDTH = 0.5  # of a mean; longer recordings have wider ones [s]


def power_and_energy(
    series: Sequence[Series], path: Target, title: str = "", place: str = "the grid"
) -> None:
    """Draw power, residual and energy over time, below each other.

    The residual, predicted minus measured, is drawn where a measured curve is among the
    series; without one there is no such panel. The 90 % band of a predicted energy stands at the
    end of its curve.
    """
    measured = [curve for curve in series if curve.role == "measured"]
    if not series or len(measured) > 1:
        raise ShapeError(
            f"{len(series)} curves, {len(measured)} of them measured",
            "at least one curve, and at most one measured",
        )
    rows = 3 if measured else 2
    heights = [3.0, 1.3, 2.2] if measured else [3.0, 2.2]
    with canvas(path, (8.0, 6.6 if measured else 5.4), title) as figure:
        axes: Any = figure.subplots(rows, 1, sharex=True, height_ratios=heights)
        longest = max(float(curve.energy_time.max()) for curve in series)
        unit, second = ("min", MINUTE) if longest > MAX_TIME_IN_SECONDS else ("s", 1.0)
        _power(axes[0], series, second, place)
        if measured:
            _residual(axes[1], measured[0], series, second)
        _energy(axes[-1], series, second, place)
        axes[-1].set_xlabel(f"time since the start of the recording [{unit}]")
        axes[-1].set_xlim(0.0, longest / second)
        figure.align_ylabels(axes)


def _style(curve: Series) -> dict[str, str]:
    return {"linestyle": LINES[curve.role], "color": COLOURS[curve.role]}


def _power(axes: Axes, series: Sequence[Series], second: float, place: str) -> None:
    for curve in series:
        axes.plot(curve.time / second, curve.power, **_style(curve), label=curve.label)
    finite = np.concatenate([curve.power[np.isfinite(curve.power)] for curve in series])
    if finite.min() >= 0:
        axes.set_ylim(bottom=0.0)
    axes.set_ylabel(f"power at {place} [W]")
    axes.margins(y=0.12)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(series))


def _residual(axes: Axes, measured: Series, series: Sequence[Series], second: float) -> None:
    axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    for curve in series:
        if curve.role != "measured":
            residual = curve.power - _at(measured, curve.time)
            axes.plot(curve.time / second, residual, **_style(curve), linewidth=1.0)
    axes.set_ylabel("predicted -\nmeasured [W]")


def _at(measured: Series, time: Float) -> Float:
    """Measured power at the points of another curve, NaN off its own pieces. [W]"""
    if np.array_equal(measured.time, time, equal_nan=True):
        return measured.power
    known = np.isfinite(measured.time)
    return np.interp(time, measured.time[known], measured.power[known], left=np.nan, right=np.nan)


def _energy(axes: Axes, series: Sequence[Series], second: float, place: str) -> None:
    scale = EnergyFormat(max(abs(float(curve.energy[-1])) for curve in series))
    for curve in series:
        label = f"{curve.label}: {scale.joule(float(curve.energy[-1]))} {scale.unit}"
        if np.isfinite(curve.energy_half):
            half = f"+- {scale.joule(curve.energy_half)} {scale.unit}"
            label += typeset(f" {half} (90 % band)")
            axes.errorbar(
                curve.energy_time[-1] / second,
                curve.energy[-1] / scale.factor,
                curve.energy_half / scale.factor,
                color=COLOURS[curve.role],
                capsize=4.0,
                clip_on=False,
            )
        energy = curve.energy / scale.factor
        axes.plot(curve.energy_time / second, energy, **_style(curve), label=label)
    axes.legend(loc="upper left")
    axes.set_ylabel(f"energy at {place} [{scale.unit}]")
    if all(float(curve.energy.min()) >= 0 for curve in series):
        axes.set_ylim(bottom=0.0)


class TemperatureHistory:
    """Means of motor temperatures and friction power over a whole recording, in bounded memory."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        self.joint_names = tuple(joint_names)
        self._ring = HistoryRing(MIN_WIDTH, len(self.joint_names) + 1, whole=True)

    def take(self, output: Output) -> None:
        """Take what one step of the pipeline gave."""
        power = output.power
        if power is not None and len(power):
            friction = power.friction_power.sum(axis=1, keepdims=True)
            values = np.hstack([power.motor_temperature_degc, friction])
            self._ring.add(power.stamp_ns, values, np.ones(len(power)))

    def means(self) -> tuple[Float, Float]:
        """Return times [s], shape (W,); temperatures and last friction power, shape (W, n + 1)."""
        table = self._ring.table()
        number = np.asarray(table["number"], dtype=np.float64)
        means = np.array(table["mean"], dtype=np.float64).T
        return (number - number[:1] + 0.5) * table["width"], means


def temperature_and_friction(history: TemperatureHistory, path: Target) -> None:
    """Draw the temperature of every motor, and below it the friction power of all joints."""
    time, means = history.means()
    degc, friction = means[:, :-1], means[:, -1]
    known = np.isfinite(degc).any(axis=0)
    with canvas(path, (8.0, 4.4 if known.any() else 2.6)) as figure:
        grid: Any = figure.subplots(2 if known.any() else 1, 1, sharex=True, squeeze=False)[:, 0]
        if known.any():
            for joint in np.flatnonzero(known).tolist():
                colour = SERIES[joint % len(SERIES)]
                label = history.joint_names[joint]
                grid[0].plot(time, degc[:, joint], color=colour, label=label)
            middle = 0.5 * (float(np.nanmin(degc)) + float(np.nanmax(degc)))
            low, high = grid[0].get_ylim()  # whole degrees of a sensor are not a course
            grid[0].set_ylim(min(low, middle - MIN_SPAN / 2), max(high, middle + MIN_SPAN / 2))
            grid[0].set_ylabel("motor temperature [degC]")
            grid[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        grid[-1].plot(time, friction, color=COLOURS["predicted"])
        grid[-1].set_ylim(bottom=0.0)
        grid[-1].margins(x=0.0)
        grid[-1].set_ylabel("friction power [W]")
        grid[-1].set_xlabel("time since the start of the recording [s]")
