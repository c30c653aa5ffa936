"""A document on a terminal or a pipe: lines and tables that lose no character.

Columns are as wide as their content. A table that is wider than the terminal is set in
blocks below each other, which all begin with its first column; prose in the last column
wraps between words. What fits in no way keeps its width, and the terminal wraps it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

from rich import box
from rich.cells import cell_len
from rich.console import Console, Group
from rich.table import Table as Grid
from rich.text import Text as Line

from robot_energy.foundation.described import Described
from robot_energy.foundation.shown_text import shown_lines
from robot_energy_report.document import HEADINGS, Document, Part, Table, Text
from robot_energy_report.formats import PROSE, typeset

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


MIN_PROSE_WIDTH = 30  # characters, below which a column of prose is a block of its own
EDGES = 2  # characters left and right of all columns
BETWEEN = 2  # characters between two columns


class _Column(Described):
    name: str
    cells: tuple[str, ...]
    prose: bool
    wraps: Annotated[bool, "Whether it may be narrower than its content."]

    @property
    def width(self) -> int:
        lines = (line for text in (self.name, *self.cells) for line in text.splitlines())
        return max((cell_len(line) for line in lines), default=0) or 1  # rich knows no 0

    @property
    def least(self) -> int:
        """Width below which a word would be cut."""
        if not self.wraps:
            return self.width
        words = (word for text in (self.name, *self.cells) for word in text.split())
        longest = max((cell_len(word) for word in words), default=0)
        return min(self.width, max(longest, MIN_PROSE_WIDTH))


def fitted_table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    width: int,
    total: Sequence[str] | None = None,
) -> Group:
    """Return one table or several below each other, prose left, to be printed without cropping."""
    parts: list[_Column] = []
    for index, name in enumerate(columns):
        cells = tuple(row[index] for row in (*rows, *([] if total is None else [total])))
        prose = index > 0 and any(len(cell) > PROSE for cell in cells[: len(rows)])
        parts.append(_Column(name, cells, prose, prose and index == len(columns) - 1))
    blocks = _blocks(parts, width)
    return Group(*(_table(block, width, total is not None) for block in blocks))


def width_of(laid_out: Group) -> int:
    """Return the width of the widest table of `fitted_table`. [characters]"""
    tables = (part for part in laid_out.renderables if isinstance(part, Grid))
    return max((table.width or 0 for table in tables), default=0)


def _blocks(columns: Sequence[_Column], width: int) -> list[list[_Column]]:
    """Share the columns out evenly among as few blocks as fit."""
    first, rest = columns[0], columns[1:]
    for count in range(1, len(rest) + 1):
        edges = [round(number * len(rest) / count) for number in range(count + 1)]
        blocks = [[first, *rest[low:high]] for low, high in pairwise(edges)]
        if all(_width([column.least for column in block]) <= width for block in blocks):
            return blocks
    return [list(columns)]


def _width(widths: Sequence[int]) -> int:
    return EDGES + sum(widths) + BETWEEN * (len(widths) - 1)


def _table(columns: Sequence[_Column], width: int, with_total: bool) -> Grid:
    widths = [column.width for column in columns]
    if columns[-1].wraps:
        room = width - _width(widths[:-1]) - BETWEEN
        widths[-1] = min(widths[-1], max(room, columns[-1].least))
    table = Grid(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, width=_width(widths))
    for index, (column, wide) in enumerate(zip(columns, widths, strict=True)):
        table.add_column(
            Line(column.name),
            justify="left" if column.prose or not index else "right",
            width=wide,
            no_wrap=not column.wraps,
            overflow="fold",
            vertical="bottom",
        )
    count = len(columns[0].cells)
    for number, cells in enumerate(zip(*(column.cells for column in columns), strict=True)):
        summed = with_total and number == count - 1
        table.add_row(
            *(Line(cell, style="bold" if summed else "") for cell in cells),
            end_section=with_total and number == count - 2,
        )
    return table
