"""Layouts of Foxglove, Lichtblick (the form before), PlotJuggler 3 and rqt.

They are made from the message definitions: which numbers belong into one plot, then the files.

Every `float64` of our messages is in a plot: those of a message that share a unit together, those
of the joints by field; a new field appears by itself. The first page is a choice of the totals.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

from robot_energy.bag.cdr.types import definition
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import LayoutError
from robot_energy.foundation.files.output_files import FileKind, check_file, write_file
from robot_energy.messages.fields import METER_TOPIC, TEMPERATURES_TOPIC

DIAGNOSTICS = "/diagnostics"
UNIT = re.compile(r"\[([^\]\d][^\]]*)\]")
FIELD = re.compile(r"^(\S+)\s+(\w+)\s*$")


class PlotCurve(Described):
    """One line of a plot."""

    topic: str
    field: Annotated[str, "Of the message, or of the entry of `joints`."]
    joint: Annotated[int | None, "Position of the joint; None for a number of the whole robot."] = (
        None
    )
    name: Annotated[str, "Name of the joint; empty for the whole robot."] = ""
    nested: Annotated[bool, "Whether joints are entries of `joints`, not elements."] = False

    def path(self, dots: bool) -> str:
        """Return its path, with dots as Foxglove and Lichtblick or with slashes as the others."""
        between = "." if dots else "/"
        if self.nested:
            entry = f'[:]{{name=="{self.name}"}}' if dots else f"[{self.joint}]"
            return between.join((self.topic, f"{JOINTS}{entry}", self.field))
        index = "" if self.joint is None else f"[{self.joint}]"
        return f"{self.topic}{between}{self.field}{index}"


@dataclass(frozen=True)
class Plot:
    """Curves with one axis."""

    title: str
    curves: tuple[PlotCurve, ...]


@dataclass(frozen=True)
class Page:
    """Plots that are seen together."""

    title: str
    plots: tuple[Plot, ...]


# Topic, type, title of the page of its totals, title of the page of its joints; empty: no page.
TOPICS = (
    ("/energy/power", "PowerState", "Power", "Joints"),
    ("/energy/registers", "EnergyRegisters", "Registers", "Energy of joints"),
    ("/energy/joint_torque", "JointTorque", "", "Torque"),
    ("/energy/joint_friction", "JointFriction", "", "Friction"),
    ("/energy/payload", "Payload", "", ""),
    (METER_TOPIC, "PowerReading", "Meter", ""),
    (TEMPERATURES_TOPIC, "MotorTemperatures", "", "Temperatures"),
)
JOINTS = "joints"
# The first page: titles, and fields of one topic in each.
OVERVIEW = (
    (
        "Power from the grid [W]",
        "/energy/power",
        ("predicted_grid_power", "predicted_power_lower", "predicted_power_upper"),
    ),
    ("Power at the meter [W]", "/energy/power", ("predicted_power_at_meter", "measured_power")),
    (
        "Where it goes [W]",
        "/energy/power",
        (
            "rigid_power", "friction_power", "drive_loss", "loss_dc", "loss_grid",
            "brake_power", "capacitor_power",
        ),
    ),
    ("Predicted minus measured [W]", "/energy/power", ("residual_power",)),
    (
        "Energy [J]",
        "/energy/registers",
        ("predicted_import_energy", "predicted_energy_at_meter", "measured_energy", "brake_energy"),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class _Number:
    name: str
    unit: str
    array: bool


def pages(joint_names: Sequence[str]) -> list[Page]:
    """Return all pages of plots."""
    overview = (
        Plot(title, tuple(PlotCurve(topic, name) for name in fields))
        for title, topic, fields in OVERVIEW
    )
    found = [Page("Energy", tuple(overview))]
    for topic, kind, totals, by_joint in TOPICS:
        numbers = _numbers(kind)
        if totals:
            found.append(Page(totals, _totals(topic, numbers)))
        if by_joint:
            arrays = [number for number in numbers if number.array]
            entries, _ = _fields(kind).get(JOINTS, ("", ""))
            nested = _numbers(entries.removesuffix("[]")) if entries else []
            plots = [_by_joint(topic, number, joint_names, False) for number in arrays]
            plots += [_by_joint(topic, number, joint_names, True) for number in nested]
            found.append(Page(by_joint, tuple(plots)))
    return found


def _totals(topic: str, numbers: Sequence[_Number]) -> tuple[Plot, ...]:
    units = dict.fromkeys(number.unit for number in numbers if not number.array)
    return tuple(
        Plot(
            f"{topic} [{unit}]",
            tuple(
                PlotCurve(topic, one.name) for one in numbers if one.unit == unit and not one.array
            ),
        )
        for unit in units
    )


def _by_joint(topic: str, number: _Number, joint_names: Sequence[str], nested: bool) -> Plot:
    curves = (
        PlotCurve(topic, number.name, at, name, nested) for at, name in enumerate(joint_names)
    )
    return Plot(f"{number.name} [{number.unit}]", tuple(curves))


def _numbers(kind: str) -> list[_Number]:
    """Every float64 of a message of ours, and arrays of them, in the order of its definition."""
    return [
        _Number(name, unit, written.endswith("[]"))
        for name, (written, unit) in _fields(kind).items()
        if written in ("float64", "float64[]")
    ]


def _fields(kind: str) -> dict[str, tuple[str, str]]:
    """Type and unit of every field: the unit stands in brackets in the comment above it."""
    found: dict[str, tuple[str, str]] = {}
    comment = ""
    for line in definition(kind).splitlines():
        match = FIELD.match(line)
        if match is not None:
            units = UNIT.findall(comment)
            found[match.group(2)] = match.group(1), units[0] if units else "-"
        comment = f"{comment} {line}" if line.startswith("#") else ""
    return found


VARIABLES = {"made_by": "robot-energy"}
COLUMNS = 2  # of plots on a page


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
            "value": curve.path(dots=True),
            "label": curve.name or curve.field,
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
        ElementTree.SubElement(drawn, "curve", {"name": curve.path(dots=False), "color": colour})


def rqt(pages: Sequence[Page]) -> str:
    """Return a perspective of the first page: rqt has no tabs. Fields as PlotJuggler names them."""
    groups: dict[str, Any] = {}
    for number, plot in enumerate(pages[0].plots, start=1):
        settings = {
            "autoscroll": True,
            "plot_type": 1,
            "topics": [curve.path(dots=False) for curve in plot.curves],
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


LAYOUTS: dict[str, tuple[FileKind, Callable[[Sequence[Page]], str]]] = {
    file: (FileKind(f"a layout for {viewer}", start, b"robot-energy"), make)
    for file, viewer, start, make in (
        ("foxglove.json", "Foxglove", b"{", foxglove),
        ("lichtblick.json", "Lichtblick", b"{", lichtblick),
        ("plotjuggler.xml", "PlotJuggler 3", b"<?xml", plotjuggler),
        ("rqt.perspective", "rqt", b"{", rqt),
    )
}
"""By the name of its file what a layout is, and what makes its text."""


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
    for name, (kind, _) in LAYOUTS.items():
        check_file(place / name, (kind,), "the layout", error=LayoutError)
    for name, (kind, make) in LAYOUTS.items():
        write_file(place / name, make(made).encode(), (kind,), "the layout", LayoutError)
    return [place / name for name in LAYOUTS]
