"""Figures of the studies of paper B: power of joints, of drives, and of whole machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.report.canvas import COLOURS, SERIES, Target, canvas, named_ticks, panels

WIDE = 9.0  # inch
GREY = "#9a9a9a"
MOST_POINTS = 1500  # of a curve, about
SHOWN = 0.995  # quantile of the values up to which an axis reaches: corners have high peaks


@dataclass(frozen=True)
class FigureLine:
    """One curve.

    Attributes:
        label: In the legend.
        time: Shape (N,). [s]
        values: One column per panel, shape (N, K).
        colour: Of the line.
        width: Of the line; a wide one below a thin one shows where they part. [pt]
    """

    label: str
    time: Float
    values: Float
    colour: str
    width: float = 1.0

    def points(self, column: int) -> tuple[Float, Float]:
        """Times and values of one column, thinned to what a figure can show, shape (M,) each."""
        rows = slice(None, None, max(1, len(self.time) // MOST_POINTS))
        return self.time[rows], self.values[rows, column]


def measured_and(lines: Sequence[tuple[str, Float, str, float]], time: Float) -> list[FigureLine]:
    """Return curves with a column for the sum over the joints.

    Args:
        lines: Label, values of the joints (N, n), colour and width of each.
        time: Shape (N,). [s]
    """
    return [
        FigureLine(label, time, np.column_stack([values, values.sum(axis=1)]), colour, width)
        for label, values, colour, width in lines
    ]


def joint_panels(
    lines: Sequence[FigureLine],
    names: Sequence[str],
    unit: str,
    path: Target,
    title: str = "",
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw curves over time, one panel per column.

    Args:
        lines: Curves.
        names: Of the panels.
        unit: Of the values, for the axis.
        path: File to write.
        title: Above the figure.
        limits: Of the vertical axis; None fits the curves.

    Raises:
        ReportError: If the file cannot be written.
    """
    with canvas(path, (WIDE, 2.5 * -(-len(names) // 2) + 0.5), title) as figure:
        grid = panels(figure, len(names), 2)
        for column, (panel, name) in enumerate(zip(grid.flat, names, strict=False)):
            for line in lines:
                panel.plot(
                    *line.points(column), color=line.colour, label=line.label,
                    linewidth=line.width,
                )  # fmt: skip
            panel.set_title(name, fontsize=9, loc="left")
            panel.set_ylabel(unit)
            if limits is not None:
                panel.set_ylim(*limits)
        for panel in grid[-1]:
            panel.set_xlabel("time [s]")
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)


def bars(
    groups: Sequence[str],
    series: Mapping[str, Sequence[float]],
    unit: str,
    path: Target,
    title: str = "",
    reference: Sequence[float | None] | None = None,
    reference_label: str = "paper B",
) -> None:
    """Draw grouped bars with their values, and figures of a paper as marks.

    Args:
        groups: Names of the groups.
        series: Values by name, one per group.
        unit: For the axis.
        path: File to write.
        title: Above the figure.
        reference: A mark per group, None where there is none.
        reference_label: What the marks are.

    Raises:
        ReportError: If the file cannot be written.
    """
    place = np.arange(len(groups), dtype=np.float64)
    width = 0.8 / len(series)
    with canvas(path, (WIDE, 3.6), title) as figure:
        axes = figure.subplots()
        for index, (name, values) in enumerate(series.items()):
            at = place + (index - 0.5 * (len(series) - 1)) * width
            shown = axes.bar(at, values, 0.92 * width, label=name, color=SERIES[index])
            for text in axes.bar_label(shown, fmt="%.0f", fontsize=7, padding=1):
                text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.4})
                text.set_zorder(5)
        if reference is not None:
            marked = [k for k, value in enumerate(reference) if value is not None]
            for number, k in enumerate(marked):
                value = float(reference[k] or 0.0)
                axes.hlines(
                    value, k - 0.42, k + 0.42, color=COLOURS["measured"], linewidth=1.6,
                    label=reference_label if number == 0 else None, linestyle=(0, (4, 2)),
                )  # fmt: skip
        axes.axhline(0.0, color=COLOURS["measured"], linewidth=0.8)
        named_ticks(axes.xaxis, place, groups)
        axes.set_ylabel(unit)
        axes.grid(axis="x", visible=False)
        figure.legend(loc="outside lower center", ncols=4)


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
        groups: Names, from top to bottom.
        parts: Values by name, one per group, >= 0.
        marks: Values by name, one per group.
        unit: For the axis.
        path: File to write.
        title: Above the figure.

    Raises:
        ReportError: If the file cannot be written.
    """
    place = np.arange(len(groups), dtype=np.float64)[::-1]
    with canvas(path, (WIDE, 0.62 * len(groups) + 1.5), title) as figure:
        axes = figure.subplots()
        left = np.zeros(len(groups))
        for index, (name, values) in enumerate(parts.items()):
            axes.barh(place, values, 0.55, left=left, label=name, color=SERIES[index])
            left = left + np.asarray(values)
        for y, total in zip(place, left, strict=True):
            axes.text(total, y, f" {total:.0f}", va="center", fontsize=8)
        for (name, values), shape in zip(marks.items(), "dox", strict=False):
            axes.plot(
                values, place, shape, color=COLOURS["measured"], label=name, markersize=5,
                markerfacecolor="white",
            )  # fmt: skip
        named_ticks(axes.yaxis, place, groups)
        axes.set_xlabel(unit)
        axes.grid(axis="y", visible=False)
        figure.legend(loc="outside lower center", ncols=4)


def powers_over_time(
    panels_: Mapping[str, Sequence[FigureLine]], unit: str, path: Target, title: str = ""
) -> None:
    """Draw one panel below the other, each with its own curves.

    Args:
        panels_: Curves by the name of their panel.
        unit: For the axes.
        path: File to write.
        title: Above the figure.

    Raises:
        ReportError: If the file cannot be written.
    """
    with canvas(path, (WIDE, 2.2 * len(panels_) + 0.6), title) as figure:
        grid = figure.subplots(len(panels_), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, lines) in zip(grid, panels_.items(), strict=True):
            for line in lines:
                axes.plot(*line.points(0), color=line.colour, label=line.label,
                          linewidth=line.width)  # fmt: skip
            values = np.concatenate([line.values[:, 0] for line in lines])
            low, high = np.quantile(values, [1.0 - SHOWN, SHOWN])
            axes.set_ylim(min(0.0, 1.1 * float(low)), 1.1 * float(high))
            axes.set_title(name, fontsize=9, loc="left")
            axes.set_ylabel(unit)
        grid[-1].set_xlabel("time [s]")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
