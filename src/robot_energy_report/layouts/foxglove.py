"""Layouts for Foxglove (its present form) and Lichtblick (the form before)."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

from robot_energy_report.layouts.plots import DIAGNOSTICS, JOINTS, Page, Plot, PlotCurve

MARK = {"made_by": "robot-energy"}
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
    return _text({"version": 1, "variables": MARK, "content": content})


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
            "globalVariables": MARK,
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
