"""Formats, lines and tables for a page: the terminal, a pipe, or an HTML document."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robot_energy.report.document import Document

Page = Console | Document
NOTHING = "-"
NOTE = "note: "  # begins a line that must not be overlooked
WATT_HOUR = 3600.0  # J


class Scale:
    """One unit and precision for all energies of a report, so that columns add up by eye.

    Args:
        largest: The largest energy. [J]
    """

    def __init__(self, largest: float) -> None:
        units = (("MJ", 1e6), ("kJ", 1e3), ("J", 1.0))
        self.unit, self.factor = next((u for u in units if largest >= u[1]), units[-1])
        lead = largest / self.factor if largest > 0 else 1.0
        self.digits = max(0, 3 - math.floor(math.log10(lead)))
        self.digits = min(self.digits, 3)

    def joule(self, energy: float | None) -> str:
        """Format in the report's unit."""
        return NOTHING if energy is None else number(energy / self.factor, self.digits)

    def watt_hour(self, energy: float | None) -> str:
        """Format in Wh, or kWh above 10 kWh."""
        if energy is None:
            return NOTHING
        return f"{number(energy / WATT_HOUR, 3 if abs(energy) < 10 * WATT_HOUR else 1)} Wh"


def number(value: float, digits: int) -> str:
    """Format with fixed digits; never ``-0``."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def energy_text(energy: float) -> str:
    """One energy in words, three to four digits. [J]"""
    for unit, factor in (("MJ", 1e6), ("kJ", 1e3)):
        if abs(energy) >= factor:
            return f"{energy / factor:.4g} {unit}"
    return f"{energy:.4g} J"


def percent(ratio: float | None, sign: bool = False) -> str:
    """Format a ratio in percent."""
    return NOTHING if ratio is None else f"{100 * ratio:{'+' if sign else ''}.1f} %"


def seconds(time_ns: int) -> str:
    """Format a time in s. [ns]"""
    return f"{time_ns * 1e-9:.3f} s"


def heading(page: Page, text: str, depth: int = 2) -> None:
    """Begin a section."""
    if isinstance(page, Document):
        page.heading(text, depth)
        return
    page.print()
    line(page, text.upper() if depth == 2 else text, style="bold underline")


def line(page: Page, text: str, style: str = "") -> None:
    """Write one line as it is, without wrapping or markup."""
    if isinstance(page, Document):
        if text.startswith(NOTE):
            page.note(text.removeprefix(NOTE))
        else:
            page.paragraph(text)
        return
    page.print(Text(text, style=style), soft_wrap=True)


def table(
    page: Page,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    total: Sequence[str] | None = None,
) -> None:
    """First column left, the others right; a last row of sums below a rule."""
    if isinstance(page, Document):
        page.table(title, columns, rows, total)
        return
    line(page, title, style="bold")
    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for index, name in enumerate(columns):
        last = index == len(columns) - 1
        prose = index > 0 and any(len(row[index]) > 24 for row in rows)
        grid.add_column(
            Text(name),
            justify="left" if prose or not index else "right",
            no_wrap=not (last and prose),
            overflow="fold",
            vertical="bottom",
        )
    for index, row in enumerate(rows):
        last = total is not None and index == len(rows) - 1
        grid.add_row(*(Text(cell) for cell in row), end_section=last)
    if total is not None:
        grid.add_row(*(Text(cell, style="bold") for cell in total))
    page.print(grid)


def pairs(page: Page, rows: Sequence[tuple[str, str]]) -> None:
    """Write names and values, then an empty line."""
    if isinstance(page, Document):
        page.table("", ("", ""), rows)
        return
    grid = Table(box=None, show_header=False, pad_edge=False)
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in rows:
        grid.add_row(Text(name), Text(value))
    page.print(grid)
    page.print()
