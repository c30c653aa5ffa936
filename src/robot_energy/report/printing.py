"""Formats, lines and tables for a page: the terminal, a pipe, or an HTML document."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

from robot_energy.report.document import Document
from robot_energy.report.layout import MIN_PROSE_WIDTH, fitted_table
from robot_energy.shown_text import shown_lines

Page = Console | Document
NOTHING = "-"
NOTE = "note: "  # begins a line that must not be overlooked
WATT_HOUR = 3600.0  # J


class EnergyFormat:
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
    page.print(Text(shown_lines(text), style=style), soft_wrap=True)


def table(
    page: Page,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    total: Sequence[str] | None = None,
) -> None:
    """First column left, the others right; a last row of sums below a rule; nothing is cut."""
    if isinstance(page, Document):
        page.table(title, columns, rows, total)
        return
    columns, *rows = (_cells(row) for row in (columns, *rows))
    total = None if total is None else _cells(total)
    if title:
        line(page, title, style="bold")
    page.print(fitted_table(columns, rows, page.width, total), crop=False)


def pairs(page: Page, rows: Sequence[tuple[str, str]]) -> None:
    """Write names and values, then an empty line; long values wrap between words."""
    if isinstance(page, Document):
        page.table("", ("", ""), rows)
        return
    rows = [(shown_lines(name), shown_lines(value)) for name, value in rows]
    lead = max((cell_len(name) for name, _ in rows), default=0)
    room = max(page.width - lead - 1, MIN_PROSE_WIDTH)
    for name, value in rows:
        words = textwrap.wrap(value, room, break_long_words=False, break_on_hyphens=False)
        for number, part in enumerate(words or [""]):
            before = "" if number else name
            line(page, f"{before}{' ' * (lead - cell_len(before))} {part}")
    page.print()


def _cells(row: Sequence[str]) -> list[str]:
    return [shown_lines(cell) for cell in row]
