"""Figures of a replay over time: power, residual and energy (paper A, fig. 4); temperatures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.foundation.errors import ShapeError
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import Float
from robot_energy_report.canvas import COLOURS, LINES, SERIES, Axes, Target, canvas
from robot_energy_report.formats import EnergyFormat, typeset
from robot_energy_report.page.history import HistoryRing
from robot_energy_report.series import Series

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

    Args:
        path: File to write: PNG, SVG or PDF by its suffix. It is replaced whole.
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


def _power(axes: Axes, series: Sequence[Series], second: float, place: str) -> None:
    for curve in series:
        axes.plot(
            curve.time / second,
            curve.power,
            LINES[curve.role],
            color=COLOURS[curve.role],
            label=curve.label,
        )
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
            axes.plot(
                curve.time / second,
                curve.power - _at(measured, curve.time),
                LINES[curve.role],
                color=COLOURS[curve.role],
                linewidth=1.0,
            )
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
        axes.plot(
            curve.energy_time / second,
            curve.energy / scale.factor,
            LINES[curve.role],
            color=COLOURS[curve.role],
            label=label,
        )
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
        """Return times and means.

        Returns:
            Since the start, shape (W,) [s]; temperatures, NaN where unknown, and last the
            friction power of all joints, shape (W, n + 1) [degC, W].
        """
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
