"""One table (CSV, Parquet, DIAdem) -> numbers of the columns asked for, row by row as they stand.

A text is cut into lines and cells here, not by the CSV reader of polars: that one leaves out
blank lines and fills up short rows, and then nobody can say which row was refused and why.
"""

from __future__ import annotations

import csv
import gzip
import io
import subprocess
import sys
import zlib
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np
import polars as pl
from numpy.typing import NDArray

from robot_energy.blocks import Float, Int
from robot_energy.errors import LogFormatError
from robot_energy.files.first_bytes import FIRST_BYTES, MAX_MAGIC, named
from robot_energy.files.regular_file import open_regular
from robot_energy.files.temporary_folder import TemporaryFolder
from robot_energy.logs.diadem import MAGIC as DIADEM
from robot_energy.logs.diadem import read_diadem

BLOCK_ROWS = 8192
MAX_NUMBERS = 24_000_000
"""Numbers that are kept of one table: an hour of six joints at 1 kHz."""
SHOWN_COLUMNS = 12
MAX_LINE = 2**20
"""Characters; a packed file could hold one line that fills the memory."""
MAX_RATIO = 200
"""How many times larger a packed log may become; numbers shrink to a tenth."""
MIN_UNPACKED = 16 * 2**20
"""Characters or bytes that any packed log may become."""
EXPECTED = "a table: CSV, plain or gzip, Parquet, or the header of a DIAdem recording (.dat)"
PARQUET, GZIP = b"PAR1", b"\x1f\x8b"
TABLES = (PARQUET, GZIP, DIADEM)
Mask = NDArray[np.bool_]
_Cells = tuple[Int, pl.DataFrame, Mask]  # line of each row, cells, whether it is whole
_NO_TEXT = (csv.Error, OSError, EOFError, UnicodeDecodeError, zlib.error)
# A damaged Parquet file can end the process that reads it, so another one does.
UNPACK = """
import resource, sys
import polars
path, out, limit = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
polars.scan_parquet(path, glob=False).sink_ipc(out, compression="uncompressed")
"""


@dataclass(frozen=True)
class TableRows:
    """Rows of a table as numbers.

    Attributes:
        line: Line of a text, or row of another file, where each stands, shape (N,).
        values: Of the columns asked for, NaN where a cell is empty, shape (N, K).
        whole: Whether a row has as many cells as there are columns, shape (N,).
        numeric: Whether no cell asked for holds anything but a number, shape (N,).
        texts: Further columns as they stand in the file, such as the time.
    """

    line: Int
    values: Float
    whole: Mask
    numeric: Mask
    texts: tuple[pl.Series, ...] = ()

    def __len__(self) -> int:
        return len(self.line)


class LogTable:
    """One file: CSV, plain or gzip, Parquet, or a header of DIAdem; which one, its first bytes say.

    Args:
        path: The file.
        delimiter: Between cells of a text; None: the likeliest in its first line, spaces only
            where there is no other.
        column_names: Names of all columns of a text without a header.
        decimal: The decimal sign of a text.

    Attributes:
        columns: Names of the columns.
        units: Of the columns, in the words of the file, as far as it says them.

    Raises:
        LogFormatError: If the file cannot be read or names no columns.
    """

    def __init__(
        self,
        path: str | Path,
        delimiter: str | None = None,
        column_names: Sequence[str] | None = None,
        decimal: str = ".",
    ) -> None:
        self.path, self._decimal = Path(path), decimal
        self._headed = column_names is None
        self.units: dict[str, str] = {}
        try:
            with open_regular(self.path) as file:
                head = file.read(MAX_MAGIC)
                self._size = file.seek(0, io.SEEK_END)
            if not head.startswith(TABLES) and head.startswith(tuple(FIRST_BYTES)):
                found, remedy = named(self.path, head)
                raise LogFormatError(found, EXPECTED, remedy)
            self._framed = head.startswith((PARQUET, DIADEM))
            if head.startswith(PARQUET):
                names = self._unpack().columns
            elif self._framed:
                names = self._diadem()
            else:
                names = self._header(delimiter)
        except _NO_TEXT as error:
            raise self._unreadable(error) from error
        self.columns = tuple(names if column_names is None or self._framed else column_names)

    def _diadem(self) -> list[str]:
        """Names of the channels; their values become the frame."""
        channels = read_diadem(self.path)
        self.units = {channel.name: channel.unit for channel in channels if channel.unit}
        columns = {str(place): channel.values for place, channel in enumerate(channels)}
        self._frame = pl.DataFrame(columns).fill_nan(None)
        return [channel.name for channel in channels]

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

    def _header(self, delimiter: str | None) -> list[str]:
        with self._open() as file:
            first = next(self._lines(file), "")
        if not first.strip():
            raise LogFormatError(f"{self.path} is empty", "a line with the names of the columns")
        likely = max(";\t" if self._decimal == "," else ",;\t", key=first.count)
        self.delimiter = delimiter or (likely if likely in first else " ")
        names = next(csv.reader([first], delimiter=self.delimiter, skipinitialspace=True))
        return [name.strip() for name in names]

    def require(self, name: str, owner: str = "") -> str:
        """Return the name of a column that must be there once.

        Args:
            name: The column.
            owner: Who asks for it, for the message.

        Raises:
            LogFormatError: If it is absent or there twice; the text names near ones.
        """
        count = self.columns.count(name)
        if count == 1:
            return name
        asked = f" that {owner} names" if owner else ""
        if count:
            raise LogFormatError(
                f"{self.path} has the column '{name}'{asked} {count} times", "each column once"
            )
        near = get_close_matches(name, self.columns, SHOWN_COLUMNS, 0.5)
        shown = near or list(self.columns[:SHOWN_COLUMNS])
        more = len(self.columns) - len(shown)
        tail = f" ({more} more)" if more > 0 else ""
        raise LogFormatError(
            f"{self.path} has no column '{name}'{asked}",
            f"a column of the file, such as {', '.join(shown)}{tail}",
            "" if self._headed else "correct column_names",
        )

    def first(self, names: Sequence[str]) -> list[pl.Series]:
        """Return columns of the first row; nothing where there is none.

        Args:
            names: Columns wanted.

        Raises:
            LogFormatError: If the file cannot be read.
        """
        rows = next(self.rows((), names), None)
        return [] if rows is None else [column[:1] for column in rows.texts]

    def rows(
        self, numbers: Sequence[str], texts: Sequence[str] = (), kept: bool = False
    ) -> Iterator[TableRows]:
        """Yield all rows that are not blank.

        Args:
            numbers: Columns wanted as numbers.
            texts: Columns wanted as they stand.
            kept: Whether all rows will be kept in memory, so that their number is bounded.

        Yields:
            At most 8192 rows at a time, in the order of the file.

        Raises:
            LogFormatError: If the file cannot be read to its end, or is too long to be kept.
        """
        pick = [self.columns.index(name) for name in (*numbers, *texts)]
        count, most = 0, MAX_NUMBERS // max(len(numbers), 1)
        for line, cells, whole in self._frame_rows(pick) if self._framed else self._text(pick):
            count += len(line)
            if kept and count > most:
                raise LogFormatError(
                    f"{self.path} has over {most} rows of {len(numbers)} columns",
                    f"at most {MAX_NUMBERS} numbers",
                    "cut it, or import it as a bag",
                )
            if self._decimal != "." and not self._framed:
                cells = cells.with_columns(pl.all().str.replace(self._decimal, ".", literal=True))
            yield _as_numbers(line, cells, whole, len(numbers))

    def _frame_rows(self, pick: Sequence[int]) -> Iterator[_Cells]:
        for column in pick:
            kind = self._frame.dtypes[column]
            if kind.is_nested() or kind == pl.Binary:
                raise LogFormatError(
                    f"the column '{self.columns[column]}' of {self.path} holds {kind}",
                    "numbers, dates or text",
                )
        for place, part in enumerate(self._frame.iter_slices(BLOCK_ROWS)):
            line = place * BLOCK_ROWS + np.arange(1, len(part) + 1)
            yield line, _picked(part, pick), np.ones(len(part), dtype=np.bool_)

    def _text(self, pick: Sequence[int]) -> Iterator[_Cells]:
        done = 0
        try:
            with self._open() as file:
                lines = self._lines(file)
                if self._headed:
                    next(lines)
                    done = 1
                while part := list(islice(lines, BLOCK_ROWS)):
                    cells, line = self._split(part, lines)
                    width = cells.select(pl.sum_horizontal(pl.all().is_not_null())).to_series()
                    blank = (width == 1) & (cells[:, 0].str.strip_chars() == "")
                    rows = ~blank.to_numpy()
                    whole = (width == len(self.columns)).to_numpy()[rows]
                    if rows.any():
                        yield done + line[rows], _picked(cells.filter(~blank), pick), whole
                    done += int(line[-1])
        except _NO_TEXT as error:
            raise self._unreadable(error, done) from error

    def _split(self, part: list[str], more: Iterator[str]) -> tuple[pl.DataFrame, Int]:
        """Cells of some lines, one column more than there should be, and the line of each row.

        Only a quote asks for the reader of the standard library; a quoted cell may go on in
        the lines that follow.
        """
        width = len(self.columns)
        if not any('"' in line for line in part):
            lines = pl.Series(part, dtype=pl.String).str.strip_chars_end("\r\n")
            if self.delimiter == " ":  # several stand for one, as in columns that are lined up
                lines = lines.str.strip_chars_start(" ").str.replace_all(" +", " ")
            cells = lines.str.split_exact(self.delimiter, width).struct.unnest()
            cells.columns = [str(place) for place in range(width + 1)]
            return cells, np.arange(1, len(part) + 1)
        reader = csv.reader(chain(part, more), delimiter=self.delimiter, skipinitialspace=True)
        rows: list[list[str | None]] = []
        ends: list[int] = []
        while reader.line_num < len(part):
            row = next(reader)[: width + 1] or [""]
            rows.append([*row, *[None] * (width + 1 - len(row))])
            ends.append(reader.line_num)
        schema = {str(place): pl.String for place in range(width + 1)}
        return pl.DataFrame(rows, schema=schema, orient="row"), np.asarray(ends)

    @contextmanager
    def _open(self) -> Generator[TextIO, None, None]:
        with open_regular(self.path) as raw:
            packed = raw.read(2) == GZIP
            raw.seek(0)
            self._most = max(self._size * MAX_RATIO, MIN_UNPACKED) if packed else self._size
            binary = gzip.GzipFile(fileobj=raw, mode="rb") if packed else raw
            with io.TextIOWrapper(binary, encoding="utf-8-sig", newline="") as text:
                yield text

    def _lines(self, file: TextIO) -> Iterator[str]:
        """Yield the lines of the file; an overlong one, or too many, are an error."""
        length = 0
        while line := file.readline(MAX_LINE):
            length += len(line)
            if len(line) == MAX_LINE:
                raise csv.Error(f"a line of over {MAX_LINE} characters")
            if length > self._most:
                raise csv.Error(
                    f"it holds over {self._most} characters, {MAX_RATIO} times its size"
                )
            yield line

    def _unreadable(self, error: Exception, line: int = 0) -> LogFormatError:
        where = f" after line {line}" if line else ""
        what = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        if isinstance(error, UnicodeDecodeError):
            what = "it is not UTF-8 text"
        return LogFormatError(f"{self.path} cannot be read{where} ({what})", EXPECTED)


def _picked(cells: pl.DataFrame, pick: Sequence[int]) -> pl.DataFrame:
    """Columns by their places, each named by its place among them; one may come twice."""
    return pl.DataFrame([cells[:, column].alias(str(place)) for place, column in enumerate(pick)])


def _as_numbers(line: Int, cells: pl.DataFrame, whole: Mask, numbers: int) -> TableRows:
    # An empty cell is no number and no mistake either.
    text = pl.col(pl.String).str.strip_chars()
    given = cells[:, :numbers].with_columns(pl.when(text != "").then(text).name.keep())
    values = given.select(pl.all().cast(pl.Float64, strict=False))
    lost = (
        values.select(pl.all().is_null()).to_numpy() > given.select(pl.all().is_null()).to_numpy()
    )
    return TableRows(
        line,
        values.select(pl.all().fill_null(np.nan)).to_numpy().reshape(len(line), numbers),
        whole,
        np.asarray(~lost.reshape(len(line), numbers).any(axis=1)),
        tuple(cells[:, place] for place in range(numbers, cells.width)),
    )
