"""Figure of identified friction: viscous coefficient over motor temperature (paper A, fig. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.foundation.errors import ShapeError
from robot_energy.physics.friction import viscous_law
from robot_energy_identify.friction.friction import FrictionFit
from robot_energy_report.canvas import COLOURS, Target, panels

MILLI = 1e3
BEYOND = 5.0  # K drawn outside the fitted range, where the edge is held
LAW_COLOURS = {"constant": COLOURS["fixed"], "exponential": COLOURS["predicted"]}
UNKNOWN_DEGC = (20.0, 60.0)  # drawn for a constant of an axis without temperatures
TABLE_COLOUR = "#009e73"


def friction_over_temperature(
    fits: Sequence[FrictionFit], path: Target, unit: str = "N m", title: str = ""
) -> None:
    """Draw points and laws of every axis."""
    if not fits:
        raise ShapeError("no axis to draw", "at least one")
    names = [f"{fit.name}: Coulomb {fit.coulomb:.3g} {unit}" for fit in fits]
    labels = "motor temperature [degC]", f"viscous [1e-3 {unit} s/rad]"
    with panels(path, names, (3.2, 2.6), (0.8, 0.6), labels, title=title) as (_, grid):
        for axes, fit in zip(grid, fits, strict=True):
            _axis(axes, fit)
        grid[0].legend(loc="best")


def _axis(axes: Any, fit: FrictionFit) -> None:
    low, high = fit.range_degc if np.isfinite(fit.range_degc).all() else UNKNOWN_DEGC
    degc = np.linspace(low - BEYOND, high + BEYOND, 200)
    for name, law in fit.laws.items():
        chosen = name == fit.chosen
        axes.plot(
            degc,
            MILLI * viscous_law(law).viscous(degc),
            "-" if chosen else ":",
            color=LAW_COLOURS.get(name, TABLE_COLOUR),
            label=f"{name}{', chosen' if chosen else ''}",
        )
    axes.errorbar(
        [point.motor_temperature_degc for point in fit.points],
        [MILLI * point.viscous for point in fit.points],
        [2 * MILLI * point.std if np.isfinite(point.std) else 0.0 for point in fit.points],
        fmt="o",
        color=COLOURS["measured"],
        markersize=4,
        capsize=2,
        linewidth=1,
        label="points, 2 std",
    )
    axes.margins(y=0.15)
    axes.set_ylim(bottom=0.0)
