"""Figure of reduced efficiency maps in four quadrants, with their points (paper B, fig. A1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.errors import ShapeError
from robot_energy.identify.drives.drives import AxisFit
from robot_energy.model.drive_models import EfficiencyMap
from robot_energy.report.canvas import COLOURS, Target, canvas, panel_grid, panels

LEVELS = np.linspace(-0.5, 1.5, 21)
MIN_POINTS = 4  # of a surface


def efficiency_maps(axes: Sequence[AxisFit], path: Target, title: str = "") -> None:
    """Draw the map of every axis.

    Args:
        axes: With maps.
        path: File to write: PNG, SVG or PDF by its suffix.
        title: Above the figure.

    Raises:
        ShapeError: If there is no map.
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    maps = [(axis.name, axis.map.entry) for axis in axes if axis.map is not None]
    if not maps:
        raise ShapeError("no efficiency map to draw", "measured power of the drives")
    columns, rows = panel_grid(len(maps))
    with canvas(path, (3.2 * columns + 1.2, 2.8 * rows + 0.6), title) as figure:
        grid = panels(figure, len(maps))
        surface: Any = None
        for panel, (name, entry) in zip(grid.flat, maps, strict=False):
            surface = _map(panel, entry) or surface
            panel.set_title(name, fontsize=9, loc="left")
        for panel in grid[:, 0]:
            panel.set_ylabel("motor torque [N m]")
        for panel in grid[-1]:
            panel.set_xlabel("motor velocity [rad/s]")
        if surface is not None:
            bar = figure.colorbar(surface, ax=grid, shrink=0.9)
            bar.set_label("efficiency, mechanical over electrical power")


def _map(panel: Any, entry: EfficiencyMap) -> Any:
    from matplotlib.tri import Triangulation

    speed, torque = np.asarray(entry.motor_velocity), np.asarray(entry.motor_torque)
    eta = np.clip(np.asarray(entry.efficiency), LEVELS[0], LEVELS[-1])
    surface = None
    if len(eta) >= MIN_POINTS and min(float(np.ptp(speed)), float(np.ptp(torque))) > 0:
        shape: Any = Triangulation(speed / np.ptp(speed), torque / np.ptp(torque))
        flat: Any = Triangulation(speed, torque, shape.triangles)
        surface = panel.tricontourf(flat, eta, levels=LEVELS, cmap="viridis", extend="both")
    panel.plot(speed, torque, ".", color=COLOURS["measured"], markersize=1.5)
    panel.axhline(0.0, color=COLOURS["measured"], linewidth=0.6)
    panel.axvline(0.0, color=COLOURS["measured"], linewidth=0.6)
    return surface
