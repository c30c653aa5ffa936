"""What a command prints as tables, to be set again at any width of the terminal."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest
from rich.console import Console, Group

from robot_energy.report import layout, printing

WIDTHS = range(20, 201)


@contextmanager
def recorded_tables() -> Iterator[list[tuple[Any, ...]]]:
    """Collect headings, rows and sums of every table that is printed meanwhile."""
    found: list[tuple[Any, ...]] = []

    def record(
        columns: Sequence[str], rows: Sequence[Sequence[str]], width: int, total: Any = None
    ) -> Group:
        found.append((columns, rows, total))
        return layout.fitted_table(columns, rows, width, total)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(printing, "fitted_table", record)
        yield found


def lost(
    columns: Sequence[str], rows: Sequence[Sequence[str]], total: Sequence[str] | None, width: int
) -> Counter[str]:
    """Words of headings and cells that a terminal of this width does not show."""
    stream = io.StringIO()
    Console(file=stream, width=width).print(
        layout.fitted_table(columns, rows, width, total), crop=False
    )
    shown = Counter(stream.getvalue().split())
    return (
        Counter(" ".join((*columns, *(c for r in rows for c in r), *(total or ()))).split()) - shown
    )
