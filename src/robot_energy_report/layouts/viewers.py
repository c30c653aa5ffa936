"""Layouts of Foxglove, Lichtblick (the form before), PlotJuggler 3 and rqt, and their files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from robot_energy.foundation.errors import LayoutError
from robot_energy.foundation.files.output_files import FileKind, check_file, write_file
from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy_report.layouts.plots import DIAGNOSTICS, JOINTS, Page, Plot, PlotCurve, pages

VARIABLES = {"made_by": "robot-energy"}
COLUMNS = 2  # of plots on a page


def _message_path(curve: PlotCurve) -> str:
    """Return the message path of a curve, in the syntax that both viewers share."""
    if curve.nested:
        return f'{curve.topic}.{JOINTS}[:]{{name=="{curve.name}"}}.{curve.field}'
    index = "" if curve.joint is None else f"[{curve.joint}]"
    return f"{curve.topic}.{curve.field}{index}"


def foxglove(pages: Sequence[Page]) -> str:
    """Return a layout of version 1: tabs of splits of panels."""

    def panel(plot: Plot) -> dict[str, Any]:
        return _panel("Plot", plot.title, {"paths": _series(plot), "showLegend": True})

    def split(direction: str, items: Sequence[Any]) -> Any:
        return {
            "type": "split",
            "direction": direction,
            "items": [{"proportion": 1, "content": item} for item in items],
        }

    tabs = [
        {
            "title": page.title,
            "content": split("column", [split("row", [*map(panel, row)]) for row in _rows(page)]),
        }
        for page in pages
    ]
    summary = _panel("DiagnosticsSummary", "", {"topicToRender": DIAGNOSTICS, "sortByLevel": True})
    tabs.append({"title": "Diagnostics", "content": summary})
    content = {"type": "tabs", "selectedTabIndex": 0, "tabs": tabs}
    return _text({"version": 1, "variables": VARIABLES, "content": content})


def lichtblick(pages: Sequence[Page]) -> str:
    """Return a layout of the older form: panels by identifier, and a mosaic of identifiers."""
    panels: dict[str, Any] = {}

    def add(kind: str, name: str, config: dict[str, Any]) -> str:
        known = f"{kind}!{re.sub(r'[^a-z0-9]+', '', name.lower())}{len(panels)}"
        panels[known] = config
        return known

    def plot(one: Plot) -> str:
        config = {
            "title": one.title,
            "foxglovePanelTitle": one.title,
            "paths": _series(one),
            "showLegend": True,
            "legendDisplay": "floating",
            "isSynced": True,
            "xAxisVal": "timestamp",
        }
        return add("Plot", one.title, config)

    tabs = [
        {
            "title": page.title,
            "layout": _mosaic([_mosaic([plot(one) for one in row], "row") for row in _rows(page)]),
        }
        for page in pages
    ]
    config: dict[str, Any] = {
        "topicToRender": DIAGNOSTICS,
        "sortByLevel": True,
        "minLevel": 0,
        "pinnedIds": [],
    }
    summary = add("DiagnosticSummary", "diagnostics", config)
    tabs.append({"title": "Diagnostics", "layout": summary})
    root = add("Tab", "pages", {"activeTabIdx": 0, "tabs": tabs})
    return _text(
        {
            "globalVariables": VARIABLES,
            "userNodes": {},
            "playbackConfig": {"speed": 1},
            "layout": root,
            "configById": panels,
        }
    )


def _panel(kind: str, title: str, config: dict[str, Any]) -> dict[str, Any]:
    named = {"title": title} if title else {}
    return {"type": "panel", "panelType": kind, "version": 1, **named, "config": config}


def _series(plot: Plot) -> list[dict[str, Any]]:
    return [
        {
            "value": _message_path(curve),
            "label": curve.label,
            "enabled": True,
            "timestampMethod": "headerStamp",
        }
        for curve in plot.curves
    ]


def _rows(page: Page) -> list[tuple[Plot, ...]]:
    return [page.plots[at : at + COLUMNS] for at in range(0, len(page.plots), COLUMNS)]


def _mosaic(items: Sequence[Any], direction: str = "column") -> Any:
    """Halve a list until single items are left: a mosaic has two parts."""
    if len(items) == 1:
        return items[0]
    half = (len(items) + 1) // 2
    return {
        "direction": direction,
        "first": _mosaic(items[:half], direction),
        "second": _mosaic(items[half:], direction),
        "splitPercentage": round(100 * half / len(items)),
    }


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=1) + "\n"


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
    """Return a perspective of the first page: rqt has no tabs. Fields as PlotJuggler names them."""
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
    inner: dict[str, Any] = {name: each for name, each in content.items() if isinstance(each, dict)}
    keys = {name: _value(each) for name, each in content.items() if name not in inner}
    return {"keys": keys, "groups": inner}


def _value(value: Any) -> dict[str, str]:
    return {"type": "repr", "repr": repr(value)}


MARK = b"robot-energy"


@dataclass(frozen=True, kw_only=True)
class Layout(Kind):
    """A layout for one viewer.

    Attributes:
        file: Its file name.
        start: First bytes of the file.
        make: Makes its text.
    """

    file: str
    start: bytes
    make: Callable[[Sequence[Page]], str]


LAYOUTS = Kinds(
    "viewer",
    *(
        Layout(name=name, label=label, line=line, file=file, start=start, make=make)
        for name, label, line, file, start, make in (
            ("foxglove", "Foxglove", "layout of version 1", "foxglove.json", b"{", foxglove),
            ("lichtblick", "Lichtblick", "layout of the older form", "lichtblick.json", b"{",
             lichtblick),
            ("plotjuggler", "PlotJuggler 3", "layout with a ROS 2 streamer", "plotjuggler.xml",
             b"<?xml", plotjuggler),
            ("rqt", "rqt", "perspective with the first page and the diagnostics", "rqt.perspective",
             b"{", rqt),
        )
    ),
)  # fmt: skip


def write_layouts(folder: str | Path, joint_names: Sequence[str]) -> list[Path]:
    """Return the files of the layouts of all viewers; earlier ones of this tool are replaced."""
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LayoutError(
            f"the folder '{place}' cannot be made ({error.strerror})", "a place for one"
        ) from error
    made = pages(joint_names)
    files = [(place / one.file, one) for one in LAYOUTS.values()]
    for path, one in files:
        check_file(path, _kinds(one), "the layout", error=LayoutError)
    for path, one in files:
        write_file(path, one.make(made).encode(), _kinds(one), "the layout", LayoutError)
    return [path for path, _ in files]


def _kinds(one: Layout) -> tuple[FileKind, ...]:
    return (FileKind(f"a layout for {one.label}", one.start, MARK),)
