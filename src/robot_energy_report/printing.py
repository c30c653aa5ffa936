"""A document on a terminal or a pipe: lines and tables that lose no character."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text as Line

from robot_energy.foundation.shown_text import shown_lines
from robot_energy_report.document import HEADINGS, Document, Part, Table, Text
from robot_energy_report.formats import typeset
from robot_energy_report.layout import MIN_PROSE_WIDTH, fitted_table

STYLES = {"strong": "bold", "problem": "bold red"}


def print_document(document: Document, console: Console) -> None:
    """Print what a terminal shows of a document: all but figures."""
    for part in document.shown("terminal"):
        _print(part, console)


def _print(part: Part, console: Console) -> None:
    match part:
        case Text(_, "command"):
            pass
        case Text(text, kind) if kind in HEADINGS.values():
            console.print()
            _line(console, text.upper() if kind == "h2" else text, "bold underline")
        case Text(text, kind):
            before = f"{kind}: " if kind in ("note", "problem") else ""
            _line(console, before + text, STYLES.get(kind, ""))
        case Table(_, (), rows):
            _pairs(console, rows)
        case Table():
            table(console, part.title, part.columns, part.rows, part.total)
        case _:
            pass


def table(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    total: Sequence[str] | None = None,
) -> None:
    """Print a table: first column left, the others right, sums below a rule; nothing is cut.

    Args:
        console: Where to.
        title: Above the table; empty for none.
        columns: Headings.
        rows: Cells, as many in each row as there are headings.
        total: Cells of the row of sums; None for none.
    """
    columns, *rows = (_cells(row, console) for row in (columns, *rows))
    total = None if total is None else _cells(total, console)
    if title:
        _line(console, title, "bold")
    console.print(fitted_table(columns, rows, console.width, total), crop=False)


def _pairs(console: Console, rows: Sequence[Sequence[str]]) -> None:
    """Names and values, then an empty line; long values wrap between words."""
    shown = [_cells(row, console) for row in rows]
    lead = max((cell_len(name) for name, _ in shown), default=0)
    room = max(console.width - lead - 1, MIN_PROSE_WIDTH)
    for name, value in shown:
        words = textwrap.wrap(value, room, break_long_words=False, break_on_hyphens=False)
        for place, part in enumerate(words or [""]):
            before = "" if place else name
            _line(console, f"{before}{' ' * (lead - cell_len(before))} {part}")
    console.print()


def _line(console: Console, text: str, style: str = "") -> None:
    console.print(Line(terminal_text(text, console), style=style), soft_wrap=True)


def _cells(row: Sequence[str], console: Console) -> list[str]:
    return [terminal_text(cell, console) for cell in row]


def terminal_text(text: str, console: Console) -> str:
    """Return a text as a terminal or a pipe shows it.

    A terminal has true signs and units if its encoding has them; a pipe, whose reader may be
    a program, stays ASCII.
    """
    true = console.is_terminal and console.encoding.lower().startswith("utf")
    return typeset(shown_lines(text)) if true else shown_lines(text)
