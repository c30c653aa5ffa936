"""What a command prints, to be set again at any width of the terminal."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest
from rich.console import Console, Group

from robot_energy.foundation.shown_text import shown_lines
from robot_energy_report import printing
from robot_energy_report.document import Document, Illustration, Table, Text
from robot_energy_report.formats import typeset
from robot_energy_report.printing import fitted_table

WIDTHS = range(20, 201, 13)  # every width: `test_any_table_is_whole_at_any_width`
TERMINALS = (60, 80, 200)  # columns


@contextmanager
def recorded_tables() -> Iterator[list[tuple[Any, ...]]]:
    """Collect headings, rows and sums of every table that is printed meanwhile."""
    found: list[tuple[Any, ...]] = []

    def record(
        columns: Sequence[str], rows: Sequence[Sequence[str]], width: int, total: Any = None
    ) -> Group:
        found.append((columns, rows, total))
        return fitted_table(columns, rows, width, total)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(printing, "fitted_table", record)
        yield found


def lost(
    columns: Sequence[str], rows: Sequence[Sequence[str]], total: Sequence[str] | None, width: int
) -> Counter[str]:
    """Words of headings and cells that a terminal of this width does not show."""
    stream = io.StringIO()
    Console(file=stream, width=width).print(fitted_table(columns, rows, width, total), crop=False)
    shown = Counter(stream.getvalue().split())
    return (
        Counter(" ".join((*columns, *(c for r in rows for c in r), *(total or ()))).split()) - shown
    )


@contextmanager
def recorded_documents() -> Iterator[list[Document]]:
    """Collect every document that is printed meanwhile."""
    found: list[Document] = []
    print_document = printing.print_document

    def record(document: Document, console: Console) -> None:
        found.append(document)
        print_document(document, console)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(printing, "print_document", record)
        yield found


def lost_figures(document: Document, width: int, terminal: bool) -> Counter[str]:
    """Words with digits that a terminal or a pipe of this width does not show whole."""
    stream = io.StringIO()
    console = Console(file=stream, width=width, force_terminal=terminal, color_system=None)
    printing.print_document(document, console)
    texts: list[str] = []
    for part in document.shown("terminal"):
        match part:
            case Table(title, columns, rows, total):
                texts += [title, *columns, *(cell for row in rows for cell in row), *(total or ())]
            case Text(text, kind) if kind != "command":
                texts.append(text)
            case Text() | Illustration():
                pass
    sign = typeset if terminal else str
    wanted = Counter(word for text in texts for word in sign(shown_lines(text)).split())
    lost = wanted - Counter(stream.getvalue().split())
    return Counter({word: count for word, count in lost.items() if any(map(str.isdigit, word))})
