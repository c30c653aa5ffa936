"""A layout for PlotJuggler 3, and a perspective for rqt, which names fields as PlotJuggler does."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from robot_energy_report.layouts.plots import JOINTS, Page, Plot, PlotCurve

COLOURS = (
    "#1f77b4", "#d62728", "#1ac938", "#ff7f0e", "#f14cc1", "#9467bd", "#17becf", "#bcbd22",
)  # fmt: skip
STREAMER = "ROS2 Topic Subscriber"
LOADER = "DataLoad ROS2 bags"
ROWS = 6  # plots of a column, beyond which there is another
PLOT, MONITOR = "rqt_plot/Plot", "rqt_runtime_monitor/RuntimeMonitor"


def series_name(curve: PlotCurve) -> str:
    """Return the name of a curve as PlotJuggler lists it."""
    if curve.nested:
        return f"{curve.topic}/{JOINTS}[{curve.joint}]/{curve.field}"
    index = "" if curve.joint is None else f"[{curve.joint}]"
    return f"{curve.topic}/{curve.field}{index}"


def plotjuggler(pages: Sequence[Page]) -> str:
    """Return a layout with a tab for each page, that reads header stamps."""
    root = ElementTree.Element("root")
    root.append(ElementTree.Comment(" robot-energy "))
    window = ElementTree.SubElement(
        root, "tabbed_widget", {"parent": "main_window", "name": "Main Window"}
    )
    for page in pages:
        tab = ElementTree.SubElement(window, "Tab", {"containers": "1", "tab_name": page.title})
        container = ElementTree.SubElement(tab, "Container")
        columns = [page.plots[at : at + ROWS] for at in range(0, len(page.plots), ROWS)]
        across = _splitter(container, "|", len(columns))
        for column in columns:
            down = _splitter(across, "-", len(column))
            for plot in column:
                _area(down, plot)
    ElementTree.SubElement(window, "currentTabIndex", {"index": "0"})
    ElementTree.SubElement(root, "use_relative_time_offset", {"enabled": "1"})
    plugins = ElementTree.SubElement(root, "Plugins")
    for name in (LOADER, STREAMER):
        plugin = ElementTree.SubElement(plugins, "plugin", {"ID": name})
        ElementTree.SubElement(plugin, "use_header_stamp", {"value": "true"})
        ElementTree.SubElement(plugin, "max_array_size", {"value": "100"})
    ElementTree.SubElement(root, "previouslyLoaded_Datafiles")
    ElementTree.SubElement(root, "previouslyLoaded_Streamer", {"name": STREAMER})
    ElementTree.indent(root, " ")
    body = ElementTree.tostring(root, encoding="unicode")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{body}\n"


def _splitter(parent: ElementTree.Element, orientation: str, count: int) -> ElementTree.Element:
    sizes = ";".join([f"{1 / count:.6f}"] * count)
    given = {"orientation": orientation, "count": str(count), "sizes": sizes}
    return ElementTree.SubElement(parent, "DockSplitter", given)


def _area(parent: ElementTree.Element, plot: Plot) -> None:
    area = ElementTree.SubElement(parent, "DockArea", {"name": plot.title})
    drawn = ElementTree.SubElement(
        area,
        "plot",
        {"mode": "TimeSeries", "style": "Lines", "flip_x": "false", "flip_y": "false"},
    )
    ElementTree.SubElement(
        drawn, "range", {"left": "0.0", "right": "10.0", "bottom": "0.0", "top": "1.0"}
    )
    ElementTree.SubElement(drawn, "limitY")
    for at, curve in enumerate(plot.curves):
        colour = COLOURS[at % len(COLOURS)]
        ElementTree.SubElement(drawn, "curve", {"name": series_name(curve), "color": colour})


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
