"""One picture of a cheaper program: what each measure saves, and the trade-offs."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.report.canvas import SERIES, Axes, Target, canvas, named_ticks
from robot_energy.results.optimization import OptimizationReport

KILO = 1e-3
BAR = 0.36  # inch per measure


def measures_and_front(report: OptimizationReport, path: Target) -> None:
    """Draw savings with their bands above energy over time.

    Args:
        report: What was found.
        path: File to write: PNG, SVG or PDF by its suffix; or a buffer.
    """
    bars = 0.9 + BAR * (1 + len(report.measures))
    with canvas(path, (8.0, bars + 3.2), "saving per cycle, and trade-offs") as figure:
        axes: Any = figure.subplots(2, 1, height_ratios=[bars, 3.2])
        _savings(axes[0], report)
        _front(figure, axes[1], report)


def _savings(axes: Axes, report: OptimizationReport) -> None:
    named = [("all that change the program", report.saving)]
    named += [(one.label, one.saving) for one in report.measures if one.saving is not None]
    place = np.arange(len(named))[::-1]
    energy = np.array([saving.energy for _, saving in named]) * KILO
    half = np.array([saving.half for _, saving in named]) * KILO
    colours = [SERIES[2] if saving.claimed else SERIES[6] for _, saving in named]
    axes.barh(place, energy, 0.6, color=colours)
    axes.errorbar(energy, place, xerr=half, fmt="none", ecolor="#16202b", capsize=3, linewidth=1.0)
    named_ticks(axes.yaxis, place, [name for name, _ in named])
    axes.axvline(0.0, color="#51606f", linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("saving per cycle [kJ], with its 90 % band; grey: not claimed")


def _front(figure: Any, axes: Axes, report: OptimizationReport) -> None:
    points = np.array([(p.duration, p.energy * KILO, p.peak_power) for p in report.front])
    shown = axes.scatter(points[:, 0], points[:, 1], c=points[:, 2], s=18, cmap="viridis")
    figure.colorbar(shown, ax=axes, label="peak power [W]")
    if report.cycle_time is None:
        for cycle, name, mark in ((report.before, "as it is", "s"), (report.after, "chosen", "D")):
            axes.plot(
                cycle.duration, cycle.energy * KILO, mark, color=SERIES[3], label=name,
                markerfacecolor="none" if mark == "s" else SERIES[3],
            )  # fmt: skip
        axes.legend(loc="best")
    axes.set_xlabel("time of a cycle without waits [s]")
    axes.set_ylabel("energy from the grid [kJ]")
