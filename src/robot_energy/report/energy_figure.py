"""Figure of the energy error of two models on recordings held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_energy.errors import ShapeError
from robot_energy.report.canvas import COLOURS, Target, canvas, named_ticks


def energy_errors(
    names: Sequence[str],
    given: Sequence[float],
    new: Sequence[float],
    path: Target,
    beyond: Sequence[bool] = (),
) -> None:
    """Draw two bars per recording.

    Args:
        names: Of the recordings.
        given: Predicted over measured energy less 1, of the model as given. [-]
        new: The same of the new model. [-]
        path: File to write: PNG, SVG or PDF by its suffix.
        beyond: Which recordings are at temperatures that their fit has not seen; those
            bars are hatched.

    Raises:
        ShapeError: If there is nothing to draw.
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    if not names or len(given) != len(names) or len(new) != len(names):
        raise ShapeError("no recordings to draw, or not one error for each", "one or more")
    place = np.arange(len(names))
    hatch = ["////" if off else "" for off in (*beyond, *[False] * (len(names) - len(beyond)))]
    with canvas(path, (8.0, 0.42 * len(names) + 1.1)) as figure:
        axes = figure.subplots()
        for shift, values, role, label in (
            (-0.19, given, "fixed", "model as given"),
            (0.19, new, "predicted", "new model"),
        ):
            axes.barh(
                place + shift,
                100.0 * np.asarray(values),
                0.36,
                color=COLOURS[role],
                hatch=hatch,
                edgecolor="white",
                linewidth=0.0,
                label=label,
            )
        axes.axvline(0.0, color=COLOURS["measured"], linewidth=0.8)
        named_ticks(axes.yaxis, place, names)
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("predicted minus measured energy [%]")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
