"""A layout for PlotJuggler 3."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from robot_energy.layouts.plots import JOINTS, Page, Plot, PlotCurve

COLOURS = (
    "#1f77b4", "#d62728", "#1ac938", "#ff7f0e", "#f14cc1", "#9467bd", "#17becf", "#bcbd22",
)  # fmt: skip
STREAMER = "ROS2 Topic Subscriber"
LOADER = "DataLoad ROS2 bags"
ROWS = 6  # plots of a column, beyond which there is another


def series_name(curve: PlotCurve) -> str:
    """Return the name of a curve as PlotJuggler lists it.

    Args:
        curve: The curve.
    """
    if curve.nested:
        return f"{curve.topic}/{JOINTS}[{curve.joint}]/{curve.field}"
    index = "" if curve.joint is None else f"[{curve.joint}]"
    return f"{curve.topic}/{curve.field}{index}"


def plotjuggler(pages: Sequence[Page]) -> str:
    """Return a layout with a tab for each page, that reads header stamps.

    Args:
        pages: One for each tab.
    """
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
