"""Figure of the errors of several predictions, by recording or by joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_energy.errors import ShapeError
from robot_energy.report.canvas import COLOURS, Target, canvas, named_ticks
from robot_energy.report.series import Role

Bars = tuple[str, Role, Sequence[float]]  # label, role, and an error for each name [-]


def error_bars(
    names: Sequence[str],
    bars: Sequence[Bars],
    path: Target,
    label: str = "predicted minus measured energy [%]",
    beyond: Sequence[bool] = (),
) -> None:
    """Draw one bar per name and prediction.

    Args:
        names: Of the recordings or joints.
        bars: Of each prediction: label, role, and its relative errors. [-]
        path: File to write: PNG, SVG or PDF by its suffix.
        label: Of the axis of the errors.
        beyond: Which names have hatched bars: recordings at temperatures that their fit has
            not seen.

    Raises:
        ShapeError: If there is nothing to draw.
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    if not names or not bars or any(len(values) != len(names) for _, _, values in bars):
        raise ShapeError("nothing to draw, or not one error for each name", "one or more")
    place, height = np.arange(len(names)), 0.76 / len(bars)
    hatch = ["////" if off else "" for off in (*beyond, *[False] * (len(names) - len(beyond)))]
    with canvas(path, (8.0, 0.42 * len(names) + 1.1)) as figure:
        axes = figure.subplots()
        for number, (name, role, values) in enumerate(bars):
            axes.barh(
                place + (number - 0.5 * (len(bars) - 1)) * height,
                100.0 * np.asarray(values),
                0.95 * height,
                color=COLOURS[role],
                hatch=hatch,
                edgecolor="white",
                linewidth=0.0,
                label=name,
            )
        axes.axvline(0.0, color=COLOURS["measured"], linewidth=0.8)
        named_ticks(axes.yaxis, place, names)
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(label)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(bars))
