"""Drawings of the studies: energy over temperature, power over time, and energies of machines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float
from robot_energy_report.canvas import COLOURS, SERIES, Axes, Target, canvas, named_ticks, panels

PERCENT = 100.0
KILO = 1e-3
BAND = 0.05  # paper A: what remains of the deviation
WIDE = 9.0  # inch
GREY = "#9a9a9a"
MAX_POINTS = 1500  # of a curve, about
SHOWN = 0.995  # quantile of the values up to which an axis reaches: corners have high peaks

Role = Literal["predicted", "fixed", "other", "more"]
LOOKS: dict[Role, dict[str, Any]] = {
    "predicted": {"color": COLOURS["predicted"], "linestyle": "-"},
    "fixed": {"color": COLOURS["fixed"], "linestyle": "--"},
    "other": {"color": COLOURS["fixed"], "linestyle": ":"},
    "more": {"color": SERIES[2], "linestyle": "-."},
}


class ModelEnergyCurve(Described):
    """Energy of one model over robot temperature."""

    label: str
    role: Role
    energy: Annotated[Float, "Relative to the measured energy at the reference, shape (K,). [-]"]
    error: Annotated[Float, "Relative to the measured energy of the same set, shape (K,). [-]"]


class EnergyStudy(Described):
    """Measured and predicted energy of the same motions over robot temperature."""

    robot_degc: Annotated[Float, "Temperature of each set, shape (K,). [degC]"]
    measured: Annotated[Float, "Relative to the reference, shape (K,). [-]"]
    cooling: Annotated[Sequence[bool], "Which sets were recorded while it cooled, shape (K,)."]
    curves: Sequence[ModelEnergyCurve]
    reference_degc: Annotated[float, "Where the measured energy is 1. [degC]"]


def energy_over_temperature(
    study: EnergyStudy, path: Target, title: str = "", deviation: bool = False
) -> None:
    """Draw measured and predicted energy (paper A, fig. 7a), and the deviation (fig. 7b)."""
    with canvas(path, (8.0, 7.0) if deviation else (6.4, 4.2), title) as figure:
        axes: Any = figure.subplots(2 if deviation else 1, 1, sharex=True, squeeze=False)[:, 0]
        _energies(axes[0], study)
        below = "robot temperature, mean of the motors [degC]"
        if deviation:
            axes[1].axhspan(-PERCENT * BAND, PERCENT * BAND, color="#ececec", zorder=0)
            axes[1].axhline(0.0, color=GREY, linewidth=0.8)
            for curve in study.curves:
                _curve(axes[1], study, curve, PERCENT * curve.error)
            axes[1].set_ylabel("predicted minus measured [%]")
            figure.align_ylabels(axes)
            below += "; grey: +-5 %"
        axes[-1].set_xlabel(below)


def shaft_power_over_temperature(
    curves: Mapping[str, tuple[Float, Float]], path: Target, name: str, title: str = ""
) -> None:
    """Draw measured shaft power of one axis at several temperatures (paper A, fig. 5).

    Args:
        curves: Time [s] and power [W] of the same motions, shape (N,) each, by label, coldest
            first.
    """
    colours = (SERIES[0], SERIES[2], SERIES[1], SERIES[3])
    with canvas(path, (8.0, 3.4), title) as figure:
        axes: Any = figure.subplots()
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for (label, (time, power)), colour in zip(curves.items(), colours, strict=False):
            axes.plot(time, KILO * power, color=colour, label=label, linewidth=1.1)
        axes.set_xlabel("time since the start of the set [s]")
        axes.set_ylabel(f"shaft power of {name} [kW]")
        axes.margins(x=0)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(curves))


def _energies(axes: Axes, study: EnergyStudy) -> None:
    for curve in study.curves:
        _curve(axes, study, curve, curve.energy, curve.label)
    cooling = np.asarray(study.cooling, dtype=np.bool_)
    for rows, fill, label in (
        (~cooling, COLOURS["measured"], "measured"),
        (cooling, "white", "measured, cooling down"),
    ):
        if rows.any():
            axes.plot(
                study.robot_degc[rows],
                study.measured[rows],
                "o",
                color=COLOURS["measured"],
                markerfacecolor=fill,
                markersize=4.5,
                label=label,
            )
    axes.set_ylabel(f"grid energy / measured at {study.reference_degc:g} degC")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _curve(
    axes: Axes, study: EnergyStudy, curve: ModelEnergyCurve, values: Float, label: str = ""
) -> None:
    """A line through the sets of heating up; points alone for those of cooling down."""
    cooling = np.asarray(study.cooling, dtype=np.bool_)
    order = np.argsort(study.robot_degc[~cooling])
    look = LOOKS[curve.role]
    axes.plot(
        study.robot_degc[~cooling][order], values[~cooling][order], label=label or None, **look
    )
    if cooling.any():
        axes.plot(
            study.robot_degc[cooling], values[cooling], "o", color=look["color"],
            markerfacecolor="white", markersize=3.5,
        )  # fmt: skip


class FigureLine(Described):
    """One curve over time."""

    label: str
    time: Annotated[Float, "Shape (N,) [s], or what else the figure is drawn over. [m]"]
    values: Annotated[Float, "Shape (N,), in the unit of the figure."]
    colour: str
    width: Annotated[float, "A wide line below a thin one shows where they part. [pt]"] = 1.0


def by_column(names: Sequence[str], lines: Sequence[FigureLine]) -> dict[str, list[FigureLine]]:
    """Return the panels of curves whose values have one column per panel.

    Args:
        lines: Curves with values of shape (N, K).
    """
    return {
        name: [replace(line, values=line.values[:, column]) for line in lines]
        for column, name in enumerate(names)
    }


def over_time(
    curves: Mapping[str, Sequence[FigureLine]],
    unit: str,
    path: Target,
    title: str = "",
    columns: int = 2,
    limits: tuple[float, float] | None = None,
    cut: bool = False,
    along: str = "time [s]",
) -> None:
    """Draw curves over time in panels.

    Args:
        limits: Limits of the vertical axes, in the unit of the values [-]; None fits the curves.
    """
    labels = (along, unit)
    with panels(path, [*curves], (0.0, 2.5), (WIDE, 0.5), labels, columns, title) as (figure, grid):
        for panel, lines in zip(grid, curves.values(), strict=True):
            for line in lines:
                rows = slice(None, None, max(1, len(line.time) // MAX_POINTS))
                panel.plot(
                    line.time[rows], line.values[rows], color=line.colour, label=line.label,
                    linewidth=line.width,
                )  # fmt: skip
            if cut:
                values = np.concatenate([line.values for line in lines])
                low, high = np.quantile(values, [1.0 - SHOWN, SHOWN])
                panel.set_ylim(min(0.0, 1.1 * float(low)), 1.1 * float(high))
            elif limits is not None:
                panel.set_ylim(*limits)
            panel.set_ylabel(unit)
        _legend(figure, grid)


def reliability(curves: Mapping[str, tuple[Float, Float]], path: Target) -> None:
    """Draw how often stated intervals held the truth over how often they should.

    Args:
        curves: Nominal share and observed share, shape (N,) each, by the name of their panel. [-]
    """
    labels = "stated [%]", "holds the truth [%]"
    with panels(path, [*curves], (0.0, 3.0), (WIDE, 0.5), labels, 2) as (figure, grid):
        for panel, (nominal, observed) in zip(grid, curves.values(), strict=True):
            panel.plot([0.0, PERCENT], [0.0, PERCENT], color=GREY, linewidth=0.8, label="right")
            panel.plot(
                PERCENT * nominal, PERCENT * observed, color=COLOURS["predicted"], label="observed"
            )
            panel.set_ylabel(labels[1])
            panel.set_xlim(0.0, PERCENT)
            panel.set_ylim(0.0, PERCENT)
        _legend(figure, grid)


def bars(
    groups: Sequence[str],
    series: Mapping[str, Sequence[float]],
    unit: str,
    path: Target,
    title: str = "",
    reference: Sequence[float | None] = (),
) -> None:
    """Draw grouped bars with their values, and figures of a paper as marks.

    Args:
        series: Values by name, one per group, in the unit of the axis. [-]
        reference: Figure of paper B per group in the same unit [-], None where there is none.
    """
    place = np.arange(len(groups), dtype=np.float64)
    width = 0.8 / len(series)
    with canvas(path, (WIDE, 3.6), title) as figure:
        axes = figure.subplots()
        for index, (name, values) in enumerate(series.items()):
            at = place + (index - 0.5 * (len(series) - 1)) * width
            colour = COLOURS.get(name, SERIES[index])
            shown = axes.bar(at, values, 0.92 * width, label=name, color=colour)
            for text in axes.bar_label(shown, fmt="%.0f", fontsize=7, padding=1):
                text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.4})
                text.set_zorder(5)
        for k, value in enumerate(reference):
            if value is not None:
                axes.hlines(
                    value, k - 0.42, k + 0.42, color=COLOURS["measured"], linewidth=1.6,
                    label="paper B", linestyle=(0, (4, 2)),
                )  # fmt: skip
        axes.axhline(0.0, color=COLOURS["measured"], linewidth=0.8)
        named_ticks(axes.xaxis, place, groups)
        axes.set_ylabel(unit)
        axes.grid(axis="x", visible=False)
        _legend(figure, [axes])


def stacked(
    groups: Sequence[str],
    parts: Mapping[str, Sequence[float]],
    marks: Mapping[str, Sequence[float]],
    unit: str,
    path: Target,
    title: str = "",
) -> None:
    """Draw stacked horizontal bars, and other figures of the same groups as marks.

    Args:
        parts: Values by name, one per group, >= 0, in the unit of the axis. [-]
        marks: Values by name, one per group, in the same unit. [-]
    """
    place = np.arange(len(groups), dtype=np.float64)[::-1]
    with canvas(path, (WIDE, 0.62 * len(groups) + 1.5), title) as figure:
        axes = figure.subplots()
        left = np.zeros(len(groups))
        for index, (name, values) in enumerate(parts.items()):
            axes.barh(place, values, 0.55, left=left, label=name, color=SERIES[index])
            left = left + np.asarray(values)
        ends = np.vstack([left, *marks.values()]).max(axis=0)  # no text on a mark beyond the bar
        for y, end, total in zip(place, ends, left, strict=True):
            axes.annotate(f"{total:.0f}", (end, y), (6.0, 0.0), textcoords="offset points",
                          va="center", fontsize=8)  # fmt: skip
        for (name, values), shape in zip(marks.items(), "dox", strict=False):
            axes.plot(
                values, place, shape, color=COLOURS["measured"], label=name, markersize=5,
                markerfacecolor="white",
            )  # fmt: skip
        named_ticks(axes.yaxis, place, groups)
        axes.set_xlabel(unit)
        axes.grid(axis="y", visible=False)
        _legend(figure, [axes])


def _legend(figure: Any, axes: Iterable[Axes]) -> None:
    handles: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4)
