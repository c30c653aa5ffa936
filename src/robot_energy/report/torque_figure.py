"""Figure of motor torque over time: measured, and predicted by one or two models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import ShapeError
from robot_energy.report.canvas import COLOURS, LINES, Target, canvas, panel_grid, panels
from robot_energy.report.series import Role


@dataclass(frozen=True)
class TorqueCurve:
    """Motor torque that a model predicts.

    Attributes:
        label: For the legend.
        role: Decides the colour.
        motor_torque: Shape (K, n). [N m]
    """

    label: str
    role: Role
    motor_torque: Float


def torque_over_time(
    names: Sequence[str],
    time: Float,
    measured: Float,
    curves: Sequence[TorqueCurve],
    path: Target,
    residual: bool = False,
    title: str = "",
) -> None:
    """Draw one panel per joint.

    Args:
        names: Of the joints.
        time: Of each sample, shape (n_samples,). [s]
        measured: Motor torque, shape (n_samples, n_joints). [N m]
        curves: Predictions.
        path: File to write: PNG, SVG or PDF by its suffix.
        residual: Whether to draw predicted minus measured instead.
        title: Above the figure.

    Raises:
        ShapeError: If there is nothing to draw.
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    if not len(time) or not curves:
        raise ShapeError("no torque to draw", "measured torque and a prediction")
    wide, high = panel_grid(len(names), 2)
    with canvas(path, (4.6 * wide, 1.7 * high + 0.6), title) as figure:
        grid = panels(figure, len(names), 2)
        for joint, (axes, name) in enumerate(zip(grid.flat, names, strict=False)):
            if residual:
                axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
            else:
                axes.plot(time, measured[:, joint], color=COLOURS["measured"], label="measured")
            for curve in curves:
                torque = curve.motor_torque[:, joint]
                axes.plot(
                    time,
                    torque - measured[:, joint] if residual else torque,
                    LINES[curve.role],
                    color=COLOURS[curve.role],
                    label=curve.label,
                    linewidth=0.9,
                )
            axes.set_title(name, fontsize=9, loc="left")
            axes.margins(x=0.0)
            if residual:
                _limits(axes, measured[:, joint], [c.motor_torque[:, joint] for c in curves])
        for axes in grid[:, 0]:
            axes.set_ylabel("residual [N m]" if residual else "motor torque [N m]")
        for axes in grid[-1]:
            axes.set_xlabel("time since the start of the recording [s]")
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))


def _limits(axes: object, measured: Float, predicted: Sequence[Float]) -> None:
    """Peaks at reversals, where friction changes its sign at once, must not hide the rest."""
    error = np.abs(np.concatenate([measured - torque for torque in predicted]))
    known = error[np.isfinite(error)]
    if len(known):
        reach = 1.3 * float(np.quantile(known, 0.99))
        if reach > 0:
            axes.set_ylim(-reach, reach)  # type: ignore[attr-defined]
