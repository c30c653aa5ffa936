"""CSV files -> blocks of numbers, with an account of every row."""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from robot_energy.blocks import Float, Int
from robot_energy.errors import LogFormatError
from robot_energy.files.regular_file import open_regular
from robot_energy.logs.recording import FileAccount
from robot_energy.timeline.stamps import BAD_STAMP, MAX_STAMP_NS, MIN_STAMP_NS

BLOCK_ROWS = 8192
SHOWN_COLUMNS = 12
DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
PARQUET = {".parquet", ".pq"}
LONGEST_LINE = 2**20
"""Characters; a packed file could hold one line that fills the memory."""
MAX_RATIO = 200
"""How many times larger a packed log may become; numbers shrink to a tenth."""
MIN_UNPACKED = 16 * 2**20
"""Characters that any packed log may become."""
MAX_NUMBERS = 24_000_000
"""Numbers that are kept of one file: an hour of six joints at 1 kHz."""
_UNREADABLE = (csv.Error, OSError, EOFError, UnicodeDecodeError, zlib.error)


@dataclass(frozen=True)
class TableRows:
    """Usable rows of a table.

    Attributes:
        line: Line in the file, shape (N,).
        time_ns: Shape (N,). [ns]
        values: The columns asked for, in their order, shape (N, K); NaN where a cell is empty.
    """

    line: Int
    time_ns: Int
    values: Float


@dataclass(frozen=True)
class Clock:
    """How the rows of a table tell their time.

    Attributes:
        column: Column of the time; None: rows are counted at ``rate``.
        unit: Unit of that column.
        rate: Rows per second. [Hz]
        run: Column whose change begins another run; None: the file is one run.
        apart: How long after the end of a run the next one is set. [s]
    """

    column: str | None
    unit: str = "s"
    rate: float = float("nan")
    run: str | None = None
    apart: float = 10.0


class LogTable:
    """One CSV file, plain or gzip.

    Args:
        path: The file.
        delimiter: Between cells; None: told from the header.

    Attributes:
        columns: Names in the header.
        account: What became of the rows read so far.

    Raises:
        LogFormatError: If the file cannot be read or has no header.
    """

    def __init__(self, path: str | Path, delimiter: str | None = None) -> None:
        self.path = Path(path)
        self.account = FileAccount(path=self.path)
        if self.path.suffix.lower() in PARQUET:
            raise LogFormatError(
                f"{self.path} is a Parquet file",
                "CSV, plain or gzip",
                "convert it, for example with pandas: "
                "pd.read_parquet('log.parquet').to_csv('log.csv', index=False)",
            )
        with self._open() as file:
            try:
                header = next(self._lines(file), "")
            except _UNREADABLE as error:
                raise self._unreadable(error) from error
        if not header.strip():
            raise LogFormatError(f"{self.path} is empty", "a line with the names of the columns")
        self.delimiter = delimiter or max(",;\t ", key=header.count)
        try:
            names = next(csv.reader([header], delimiter=self.delimiter, skipinitialspace=True))
        except csv.Error as error:
            raise self._unreadable(error) from error
        self.columns = tuple(name.strip() for name in names)

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
        )

    def first(self, names: Sequence[str]) -> list[str]:
        """Return cells of the first row; empty where it lacks them."""
        for _, cells in islice(self._rows(), 1):
            return [
                cells[self.columns.index(n)] if self.columns.index(n) < len(cells) else ""
                for n in names
            ]
        return [""] * len(names)

    def numbers(self, names: Sequence[str]) -> Float:
        """Return columns of a file in which every cell of them holds a number.

        Args:
            names: Columns wanted.

        Returns:
            Shape (rows, columns).

        Raises:
            LogFormatError: If it cannot be read, holds anything else or is too long.
        """
        pick = [self.columns.index(name) for name in names]
        rows = MAX_NUMBERS // max(len(pick), 1)
        try:
            with self._open() as file:
                lines = self._lines(file)
                next(lines)
                table = np.loadtxt(
                    lines, delimiter=self.delimiter, usecols=pick, ndmin=2, max_rows=rows + 1
                )
        except (*_UNREADABLE, ValueError) as error:
            raise LogFormatError(
                f"{self.path} cannot be read ({' '.join(str(error).split())})",
                "a number in every cell of the columns used",
            ) from error
        if len(table) > rows:
            raise LogFormatError(
                f"{self.path} has over {rows} rows of {len(pick)} columns",
                f"at most {MAX_NUMBERS} numbers",
                "cut it, or import it as a bag",
            )
        return table

    def blocks(
        self,
        names: Sequence[str],
        required: int,
        clock: Clock,
    ) -> Iterator[TableRows]:
        """Yield the usable rows and account for the others.

        A row is rejected as ``wrong_length``, ``not_numeric`` (a cell used holds text),
        ``not_finite`` (a required cell is empty, NaN or infinite) or ``bad_time``.

        Args:
            names: Columns wanted.
            required: How many of them, from the first, must hold a number.
            clock: How rows tell their time.

        Yields:
            At most 8192 rows at a time, in the order of the file.

        Raises:
            LogFormatError: If the file cannot be read to its end.
        """
        pick = [self.columns.index(name) for name in names]
        column = None if clock.column is None else self.columns.index(clock.column)
        runs = _Runs(self.columns.index(clock.run), clock.apart) if clock.run else None
        rows = self._rows()
        done = 0
        while part := list(islice(rows, BLOCK_ROWS)):
            self.account.received += len(part)
            if column is None:
                instants: list[int | None] = [
                    round((done + row) * 1e9 / clock.rate) for row in range(len(part))
                ]
            else:
                instants = [_nanoseconds(cells, column, clock.unit) for _, cells in part]
            if runs is not None:
                instants = [
                    runs.place(cells, instant)
                    for (_, cells), instant in zip(part, instants, strict=True)
                ]
            done += len(part)
            yield self._numbers(part, instants, pick, required)

    def _numbers(
        self,
        part: list[tuple[int, list[str]]],
        instants: list[int | None],
        pick: list[int],
        required: int,
    ) -> TableRows:
        lines: list[int] = []
        times: list[int] = []
        table: list[list[float]] = []
        width = len(self.columns)
        for (line, cells), instant in zip(part, instants, strict=True):
            if len(cells) != width:
                self.account.reject_line("wrong_length", line)
                continue
            try:
                values = [float(cells[i]) if cells[i].strip() else np.nan for i in pick]
            except ValueError:
                self.account.reject_line("not_numeric", line)
                continue
            if instant is None:
                self.account.reject_line("bad_time", line)
                continue
            lines.append(line)
            times.append(instant)
            table.append(values)
        values = np.asarray(table, dtype=np.float64).reshape(len(table), len(pick))
        bad = ~np.isfinite(values[:, :required]).all(axis=1) | np.isinf(values).any(axis=1)
        for row in np.flatnonzero(bad).tolist():
            self.account.reject_line("not_finite", lines[row])
        return TableRows(
            np.asarray(lines, dtype=np.int64)[~bad],
            np.asarray(times, dtype=np.int64)[~bad],
            values[~bad],
        )

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line number and cells of every row that is not blank."""
        with self._open() as file:
            reader = csv.reader(self._lines(file), delimiter=self.delimiter, skipinitialspace=True)
            try:
                next(reader)
                for cells in reader:
                    if cells and (len(cells) > 1 or cells[0].strip()):
                        yield reader.line_num, cells
            except _UNREADABLE as error:
                raise self._unreadable(error, reader.line_num) from error

    @contextmanager
    def _open(self) -> Generator[TextIO, None, None]:
        try:
            raw = open_regular(self.path)
        except OSError as error:
            raise self._unreadable(error) from error
        with raw:
            packed = raw.read(2) == b"\x1f\x8b"
            size = raw.seek(0, io.SEEK_END)
            raw.seek(0)
            self._most = max(size * MAX_RATIO, MIN_UNPACKED) if packed else size
            binary = gzip.GzipFile(fileobj=raw, mode="rb") if packed else raw
            with io.TextIOWrapper(binary, encoding="utf-8-sig", newline="") as text:
                yield text

    def _lines(self, file: TextIO) -> Iterator[str]:
        """Yield the lines of the file; an overlong one, or too many, are an error."""
        length = 0
        while line := file.readline(LONGEST_LINE):
            length += len(line)
            if len(line) == LONGEST_LINE:
                raise csv.Error(f"a line of over {LONGEST_LINE} characters")
            if length > self._most:
                raise csv.Error(
                    f"it holds over {self._most} characters, {MAX_RATIO} times its size"
                )
            yield line

    def _unreadable(self, error: Exception, line: int | None = None) -> LogFormatError:
        where = f" after line {line}" if line else ""
        what = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        if isinstance(error, UnicodeDecodeError):
            what = "it is not UTF-8 text"
        return LogFormatError(
            f"{self.path} cannot be read{where} ({what})", "a CSV file, plain or gzip"
        )


class _Runs:
    """Sets runs that each count their own time one after the other.

    Args:
        column: Index of the column that names the run.
        apart: From the end of a run to the start of the next. [s]
    """

    def __init__(self, column: int, apart: float) -> None:
        self._column = column
        self._apart_ns = round(apart * 1e9)
        self._label: str | None = None
        self._shift_ns = 0
        self._last_ns: int | None = None

    def place(self, cells: list[str], instant: int | None) -> int | None:
        """Return the instant of a row on the common time. [ns]"""
        if instant is None or self._column >= len(cells):
            return instant
        label = cells[self._column].strip()
        if label != self._label:
            self._label = label
            if self._last_ns is not None:
                self._shift_ns = self._last_ns + self._apart_ns - instant
        placed = instant + self._shift_ns
        self._last_ns = placed if self._last_ns is None else max(self._last_ns, placed)
        return placed


def _nanoseconds(cells: list[str], column: int, unit: str) -> int | None:
    """Return an instant, exact to the last digit written; None if it is none. [ns]"""
    try:
        instant = Decimal(cells[column].strip()).scaleb(DIGITS[unit])
        return int(instant.to_integral_value()) if abs(instant) < 2**63 else None
    except (InvalidOperation, ValueError, OverflowError, IndexError):
        return None


def newer_than(
    rows: TableRows, last_ns: int | None, account: FileAccount, start_ns: int = 0
) -> tuple[TableRows, int | None]:
    """Drop rows whose time does not advance (``not_newer``) or is no stamp (``bad_stamp``).

    Args:
        rows: Usable rows.
        last_ns: Time of the last row kept, None before the first. [ns]
        account: Where to count.
        start_ns: What their times are added to to become stamps. [ns]

    Returns:
        The rows kept, which are counted as accepted, and the time of the last of them.
    """
    keep = np.zeros(len(rows.line), dtype=np.bool_)
    for row, instant in enumerate(rows.time_ns.tolist()):
        if not MIN_STAMP_NS <= instant + start_ns <= MAX_STAMP_NS:
            account.reject_line(BAD_STAMP, int(rows.line[row]))
        elif last_ns is None or instant > last_ns:
            keep[row], last_ns = True, instant
        else:
            account.reject_line("not_newer", int(rows.line[row]))
    account.accepted += int(keep.sum())
    return TableRows(rows.line[keep], rows.time_ns[keep], rows.values[keep]), last_ns
