"""A perspective for rqt: the plots of the first page, and the diagnostics."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from robot_energy.layouts.plotjuggler import series_name
from robot_energy.layouts.plots import Page

PLOT, MONITOR = "rqt_plot/Plot", "rqt_runtime_monitor/RuntimeMonitor"


def rqt(pages: Sequence[Page]) -> str:
    """Return a perspective. rqt_plot names fields as PlotJuggler does.

    Args:
        pages: Of which the first is shown: rqt has no tabs of plots.
    """
    groups: dict[str, Any] = {}
    for number, plot in enumerate(pages[0].plots, start=1):
        settings = {
            "autoscroll": True,
            "plot_type": 1,
            "topics": [series_name(curve) for curve in plot.curves],
            "x_limits": [0.0, 10.0],
            "y_limits": [0.0, 1.0],
        }
        dock = {"dock_widget_title": plot.title}
        groups[f"plugin__rqt_plot__Plot__{number}"] = _group(
            plugin=_group(**settings), dock_widget__DataPlotWidget=_group(**dock)
        )
    groups["plugin__rqt_runtime_monitor__RuntimeMonitor__1"] = _group(plugin=_group())
    running = {PLOT: list(range(1, len(pages[0].plots) + 1)), MONITOR: [1]}
    manager = _group(**groups)
    manager["keys"]["running-plugins"] = _value(running)
    document = _group(pluginmanager=manager, mainwindow=_group())
    document["keys"]["made_by"] = _value("robot-energy")
    return json.dumps(document, indent=1, sort_keys=False) + "\n"


def _group(**content: Any) -> dict[str, Any]:
    """Make a group of settings; a value that is itself a group becomes one inside."""
    inner = {name: each for name, each in content.items() if _is_group(each)}
    keys = {name: _value(each) for name, each in content.items() if name not in inner}
    return {"keys": keys, "groups": inner}


def _is_group(value: Any) -> bool:
    return isinstance(value, dict) and set(value) == {"keys", "groups"}  # pyright: ignore[reportUnknownArgumentType]


def _value(value: Any) -> dict[str, str]:
    return {"type": "repr", "repr": repr(value)}
