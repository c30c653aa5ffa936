"""Cells of tables -> numbers; which cell offends, and what mends it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import polars as pl
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.shown_text import shown
from robot_energy.timeline.blocks import Float, Int

Mask = NDArray[np.bool_]
EMPTY = ("", "-", "--", "na", "n/a", "#n/a", "null", "none")
"""What stands for a cell without a value, in small letters."""
GROUPED = r"^[+-]?[1-9]\d{0,2}(\.\d{3})+$"  # 1.234 next to decimal commas: a thousand or one?
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?\d{1,3}([.,' ]\d{3})+([.,]\d+)?")
WITH_UNIT = re.compile(r"[+-]?\d+([.,]\d+)?\s*([^\W\d_]+|%)")
LATEST = 10**10  # s, some centuries either way
PER_SECOND = {"ms": 10**3, "us": 10**6, "ns": 10**9}
MAX_CELL = 40  # characters of a cell that are shown


class TableRows(Described):
    """Rows of a table as numbers."""

    line: Annotated[Int, "Line of a text, or row of another file, where each stands, shape (N,)."]
    values: Annotated[Float, "Of the columns asked for, NaN where a cell is empty, shape (N, K)."]
    width: Annotated[
        Int, "How many cells a row has, one too many for all that are too many, shape (N,)."
    ]
    whole: Annotated[Mask, "Whether a row has as many cells as there are columns, shape (N,)."]
    numeric: Annotated[Mask, "Whether no cell asked for holds anything but a number, shape (N,)."]
    cells: Annotated[
        tuple[pl.Series, ...],
        "The columns of the values as they stand in the file; their names are those of the "
        "columns.",
    ] = ()
    texts: Annotated[
        tuple[pl.Series, ...], "Further columns as they stand in the file, such as the time."
    ] = ()
    decimal: str = "."
    repeated: Annotated[
        tuple[int, ...], "Lines that repeat the header, before or among the rows."
    ] = ()

    def __len__(self) -> int:
        return len(self.line)

    def unusable_cell(self, row: int, required: Mask) -> tuple[str, str]:
        """Return name and text of what in a row is not a number, or not finite; empty for none.

        Args:
            required: Columns whose cells must not be empty, shape (K,).
        """
        for value, cell, needed in zip(self.values[row], self.cells, required, strict=True):
            text = _text(cell, row)
            given = text.strip().lower() not in (*EMPTY, "nan", "+nan", "-nan")
            if np.isinf(value) or (np.isnan(value) and (needed or given)):
                return cell.name, shown(text, MAX_CELL)
        return "", ""

    def text_cell(self, row: int) -> tuple[str, str]:
        """Return name and cell of the first text in a row; empty where there is none."""
        if not self.texts:
            return "", ""
        return self.texts[0].name, shown(_text(self.texts[0], row), MAX_CELL)


def _text(column: pl.Series, row: int) -> str:
    if isinstance(column.dtype, pl.Datetime | pl.Duration):
        count, unit = column.to_physical()[row], column.dtype.time_unit or "us"
        if count is not None and abs(count) > LATEST * PER_SECOND[unit]:
            return f"{count} {unit}"  # polars ends the process over a date far beyond
    value = column[row]
    return "" if value is None else str(value)


def as_numbers(
    line: Int,
    cells: Sequence[pl.Series],
    width: Int,
    columns: int,
    numbers: int,
    decimal: str,
    repeated: tuple[int, ...] = (),
) -> TableRows:
    """Return rows with their first cells as numbers.

    Args:
        line: Where each row stands, shape (N,).
        cells: Columns asked for, named; text or of a type of numbers.
        width: Cells of each row, shape (N,).
    """
    values = np.full((len(line), numbers), np.nan)
    numeric = np.ones(len(line), dtype=np.bool_)
    for place, column in enumerate(cells[:numbers]):
        if column.dtype == pl.Float64:
            values[:, place] = column.to_numpy()
            continue
        given = column
        if column.dtype == pl.String:
            given = pl.select(_written_number(column, decimal)).to_series()
        found = given.cast(pl.Float64, strict=False)
        numeric &= (found.is_not_null() | given.is_null()).to_numpy()
        values[:, place] = found.fill_null(np.nan).to_numpy()
    return TableRows(
        line,
        values,
        width,
        width == columns,
        numeric,
        tuple(cells[:numbers]),
        tuple(cells[numbers:]),
        decimal,
        repeated,
    )


def _written_number(column: pl.Series, decimal: str) -> pl.Expr:
    """Text with a decimal point, null where the cell has no value."""
    text = pl.lit(column).str.strip_chars()
    text = pl.when(~text.str.to_lowercase().is_in(EMPTY)).then(text)
    if decimal == ".":
        return text
    point = text.str.replace(decimal, ".", literal=True)
    return pl.when(text.str.contains(GROUPED)).then(pl.lit("?")).otherwise(point)


def number_remedy(cell: str) -> str:
    """Return what makes a number of a cell; empty where nothing is known."""
    text = cell.strip()
    if DECIMAL_COMMA.fullmatch(text) and not THOUSANDS.fullmatch(text):
        return 'these are decimal commas: set decimal: "," in the mapping'
    if DECIMAL_COMMA.fullmatch(text):
        return (
            'set decimal: "," in the mapping if this is a decimal comma; write numbers without '
            "separators of thousands if it is one"
        )
    if THOUSANDS.fullmatch(text):
        return "write numbers without separators of thousands"
    if WITH_UNIT.fullmatch(text):
        return "write numbers only; the mapping states their unit"
    return ""
