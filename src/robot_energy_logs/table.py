"""One table (CSV, Parquet) -> numbers of the columns asked for, row by row; what mends a cell."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Unpack

import numpy as np
import polars as pl
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.files.first_bytes import FIRST_BYTES, MAX_MAGIC, named
from robot_energy.foundation.files.regular_file import open_regular
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.foundation.shown_text import shown
from robot_energy.timeline.blocks import Float, Int
from robot_energy_logs.text_table import (
    BLOCK_ROWS,
    EXPECTED,
    GZIP,
    MAX_RATIO,
    MIN_UNPACKED,
    Cells,
    TextForm,
    TextTable,
)

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
    width: Annotated[Int, "Cells of a row; one too many stands for all that are, shape (N,)."]
    whole: Annotated[Mask, "Whether a row has as many cells as there are columns, shape (N,)."]
    numeric: Annotated[Mask, "Whether no cell asked for holds anything but a number, shape (N,)."]
    cells: Annotated[tuple[pl.Series, ...], "Columns of the values as in the file, by name."] = ()
    texts: Annotated[tuple[pl.Series, ...], "Further columns as in the file, as the time."] = ()
    decimal: str = "."
    repeated: Annotated[tuple[int, ...], "Lines that repeat the header."] = ()

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


MAX_NUMBERS = 24_000_000
"""Numbers that are kept of one table: an hour of six joints at 1 kHz."""
SHOWN_COLUMNS = 12
PARQUET = b"PAR1"
TABLES = (PARQUET, GZIP)
WORDS = (pl.Categorical, pl.Enum)
UNIT = re.compile(r"[\[(]([^\[\]()]{2,})[\])]$")  # one letter may be a counter: q(a)
# A damaged Parquet file can end the process that reads it, so another one does.
UNPACK = """
import resource, sys
import polars
path, out, limit = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
polars.scan_parquet(path, glob=False).sink_ipc(out, compression="uncompressed")
"""


class LogTable:
    """One file: CSV, plain or gzip, or Parquet; which one, its first bytes say.

    Args:
        column_names: Of a text without a header.
        **text: How a text is written.

    Attributes:
        units: Of the columns, in the words of the file, as far as it says them.
        notes: What was found about the file, one sentence each.
    """

    def __init__(
        self, path: str | Path, column_names: Sequence[str] | None = None, **text: Unpack[TextForm]
    ) -> None:
        self.path = Path(path)
        self.units: dict[str, str] = {}
        self.notes: list[str] = []
        self._text: TextTable | None = None
        try:
            self.columns = tuple(self._open(column_names, text))
        except OSError as error:
            why = error.strerror or str(error)
            raise LogFormatError(f"{self.path} cannot be read ({why})", EXPECTED) from error

    def _open(self, column_names: Sequence[str] | None, form: TextForm) -> Sequence[str]:
        with open_regular(self.path) as file:
            head = file.read(MAX_MAGIC)
            self._size = file.seek(0, io.SEEK_END)
        if not head.startswith(TABLES) and head.startswith(tuple(FIRST_BYTES)):
            found, remedy = named(self.path, head)
            raise LogFormatError(found, EXPECTED, remedy)
        if head.startswith(PARQUET):
            return self._unpack().columns
        text = TextTable(self.path, headed=column_names is None, **form)
        self._text, self.notes = text, text.notes
        names = text.columns if column_names is None else column_names
        stated = {name: UNIT.search(name) for name in names}
        self.units = {name: unit[1].strip() for name, unit in stated.items() if unit}
        return names

    def _unpack(self) -> pl.DataFrame:
        """Content of a Parquet file, in a file that only takes up address space."""
        limit = max(self._size * MAX_RATIO, MIN_UNPACKED)
        with TemporaryFolder() as folder:
            out = folder.path / "table.arrow"
            command = [sys.executable, "-I", "-c", UNPACK, str(self.path.resolve()), str(out)]
            done = subprocess.run([*command, str(limit)], capture_output=True, check=False)
            if done.returncode:
                why = f"it is damaged, or becomes over {MAX_RATIO} times as large"
                raise LogFormatError(f"{self.path} cannot be read ({why})", EXPECTED)
            self._frame = pl.read_ipc(out)
        return self._frame

    @property
    def delimiter(self) -> str | None:
        """Between the cells of a text; None of another table."""
        return None if self._text is None else self._text.delimiter

    def require(self, name: str, owner: str = "") -> str:
        """Return the name of a column that must be there once."""
        count = self.columns.count(name)
        if count == 1:
            return name
        asked = f" that {owner} names" if owner else ""
        if count:
            remedy = "rename one of them"
            if self._text is not None:
                remedy += (
                    ", or give all columns new names: column_names and skip_rows in the mapping"
                )
            raise LogFormatError(
                f"{self.path} has the column '{name}'{asked} {count} times",
                "each column once",
                remedy,
            )
        near = get_close_matches(name, self.columns, SHOWN_COLUMNS, 0.5)
        shown = near or list(self.columns[:SHOWN_COLUMNS])
        more = len(self.columns) - len(shown)
        tail = f" ({more} more)" if more > 0 else ""
        remedy = ""
        if self._text is not None:
            line = self._text.line_of(name) if self._text.headed else 0
            remedy = "" if self._text.headed else "correct column_names"
            remedy = f"set skip_rows: {line - 1} in the mapping" if line > 1 else remedy
        raise LogFormatError(
            f"{self.path} has no column '{name}'{asked}",
            f"a column of the file, such as {', '.join(shown)}{tail}",
            remedy,
        )

    def first(self, names: Sequence[str]) -> list[pl.Series]:
        """Return columns of the first row; nothing where there is none."""
        rows = next(self.rows((), names), None)
        return [] if rows is None else [column[:1] for column in rows.texts]

    def rows(
        self, numbers: Sequence[str], texts: Sequence[str] = (), kept: bool = False
    ) -> Iterator[TableRows]:
        """Yield all rows that are not blank.

        Args:
            kept: Whether all rows will be kept in memory, so that their number is bounded.

        Yields:
            Some rows at a time, in the order of the file.
        """
        names = (*numbers, *texts)
        pick = [self.columns.index(name) for name in names]
        count, most = 0, MAX_NUMBERS // max(len(numbers), 1)
        decimal = "." if self._text is None else self._text.decimal
        width = len(self.columns)
        parts = (
            self._frame_rows(pick, len(numbers))
            if self._text is None
            else self._text.rows(pick, width, len(numbers))
        )
        for line, cells, found, repeated in parts:
            count += len(line)
            if kept and count > most:
                raise LogFormatError(
                    f"{self.path} has over {most} rows of {len(numbers)} columns",
                    f"at most {MAX_NUMBERS} numbers",
                    "cut it, or import it as a bag",
                )
            given = [cell.alias(name) for cell, name in zip(cells, names, strict=True)]
            yield as_numbers(line, given, found, width, len(numbers), decimal, repeated)

    def _frame_rows(self, pick: Sequence[int], numbers: int) -> Iterator[Cells]:
        for place, column in enumerate(pick):
            self._check_type(column, place < numbers)
        for place, part in enumerate(self._frame.iter_slices(BLOCK_ROWS)):
            line = place * BLOCK_ROWS + np.arange(1, len(part) + 1)
            cells = [part[:, column] for column in pick]
            cells = [
                cell.cast(pl.String) if isinstance(cell.dtype, WORDS) else cell for cell in cells
            ]
            yield line, cells, np.full(len(part), len(self.columns)), ()

    def _check_type(self, column: int, number: bool) -> None:
        """Refuse what is neither number nor text, and, of times, no date."""
        kind = self._frame.dtypes[column]
        text = isinstance(kind, (pl.String, pl.Null, *WORDS))
        date = isinstance(kind, pl.Datetime | pl.Duration)
        if text or kind.is_numeric() or (date and not number):
            return
        expected = "numbers, or text of numbers" if number else "numbers, dates with time, or text"
        raise LogFormatError(
            f"the column '{self.columns[column]}' of {self.path} holds {kind}",
            expected,
            "convert the column, or name another one in the mapping",
        )
