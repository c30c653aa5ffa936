"""Figures of a fleet: energy of the robots, friction over temperature and time, model error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from robot_energy.foundation.units import JOULE_PER_KWH, SECOND_NS
from robot_energy_fleet.results.fleet import FrictionCurve, ModelError, RobotEnergy
from robot_energy_report.canvas import (
    COLOURS,
    PART_COLOURS,
    SERIES,
    Target,
    canvas,
    named_ticks,
    panels,
)

PANELS = 2  # in a row: they must be read on a phone
MAX_BARS = 40  # robots that are drawn
MAX_LINES = 6  # robots to look at, in a panel


def energy_of_robots(robots: Sequence[RobotEnergy], path: Target) -> None:
    """Draw the energy of every robot, standby apart."""
    drawn = sorted(robots, key=lambda one: -one.grid_energy)[:MAX_BARS]
    drawn.sort(key=lambda one: one.robot, reverse=True)
    with canvas(path, (8.0, 1.2 + 0.22 * len(drawn))) as figure:
        axes: Any = figure.subplots()
        places = np.arange(len(drawn))
        standby = np.array([one.standby_energy for one in drawn]) / JOULE_PER_KWH
        whole = np.array([one.grid_energy for one in drawn]) / JOULE_PER_KWH
        work = np.maximum(whole - standby, 0.0)
        axes.barh(places, work, color=PART_COLOURS["motion"], label="other than standby")
        axes.barh(places, standby, left=work, color=PART_COLOURS["cabinet"], label="standby")
        named_ticks(axes.yaxis, places, [one.robot for one in drawn])
        axes.grid(False, axis="y")
        axes.set_xlabel("energy from the grid, as recorded [kWh]")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def friction_by_temperature(curves: Sequence[FrictionCurve], path: Target) -> None:
    """Draw friction against the model over the motor temperature, one panel for each joint."""

    def draw(axes: Any, curve: FrictionCurve) -> None:
        _drawn(axes, curve.degc, (curve.low, curve.middle, curve.high), curve.robots, curve.by_degc)

    _grid(curves, path, draw, "motor temperature [degC]")


def friction_by_week(curves: Sequence[FrictionCurve], path: Target) -> None:
    """Draw friction against the model over time, at equal temperature and speed.

    Arguments as in `friction_by_temperature`.
    """

    def draw(axes: Any, curve: FrictionCurve) -> None:
        dates = [datetime.fromtimestamp(one / SECOND_NS, UTC) for one in curve.weeks_ns]
        middle = (curve.week_low, curve.week_middle, curve.week_high)
        _drawn(axes, dates, middle, curve.robots, curve.by_week)
        ticks = dates[:: max(1, len(dates) // 3)]
        axes.set_xticks(ticks)
        axes.set_xticklabels([f"{one:%b %d}" for one in ticks])

    _grid(curves, path, draw, "week, its middle")


def error_by_temperature(errors: Sequence[ModelError], path: Target) -> None:
    """Draw the error of the model over the mean motor temperature of bags."""
    with canvas(path, (8.0, 2.6)) as figure:
        axes: Any = figure.subplots()
        degc = [0.5 * (one.low_degc + one.high_degc) for one in errors]
        middle, low, high = (
            100.0 * np.array(values)
            for values in zip(*((one.error, one.low, one.high) for one in errors), strict=True)
        )
        spread = np.maximum([middle - low, high - middle], 0.0)
        axes.errorbar(degc, middle, spread, fmt="o-", color=COLOURS["predicted"], capsize=3)
        axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
        axes.set_xlabel("mean motor temperature of a bag [degC]")
        axes.set_ylabel("predicted -\nmeasured [%]")


def _grid(
    curves: Sequence[FrictionCurve],
    path: Target,
    draw: Callable[[Any, FrictionCurve], None],
    label: str,
) -> None:
    names, labels = [curve.joint for curve in curves], (label, "friction / model")
    with panels(path, names, (2.8, 1.9), (0.5, 0.5), labels, PANELS) as (_, grid):
        for axes, curve in zip(grid, curves, strict=True):
            draw(axes, curve)
            axes.axhline(1.0, color="#9a9a9a", linewidth=0.8)
            if curve.robots:
                axes.legend(loc="best")


def _drawn(axes: Any, x: Any, middle: Any, robots: Sequence[str], lines: Any) -> None:
    low, median, high = (np.array(values, dtype=np.float64) for values in middle)
    axes.fill_between(x, low, high, color=COLOURS["predicted"], alpha=0.15, linewidth=0)
    axes.plot(x, median, color=COLOURS["predicted"])
    named = zip(robots[:MAX_LINES], lines[:MAX_LINES], strict=True)
    for colour, (robot, values) in enumerate(named, 1):
        known = np.array(values, dtype=np.float64)
        axes.plot(x, known, "o-", color=SERIES[colour % len(SERIES)], markersize=3, label=robot)
