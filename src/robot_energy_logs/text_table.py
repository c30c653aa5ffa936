"""A table as text -> cells of every row: its encoding, its header, and what is left out.

A text is cut into lines and cells here, not by the CSV reader of polars: that one leaves out
blank lines and fills up short rows, and then nobody can say which row was refused and why. It
reads what has neither, up to the first part of a file in which a cell does not hold a number or a
row has more or fewer cells than the header.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import zlib
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO, TextIO, TypedDict

import numpy as np
import polars as pl

from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.files.regular_file import open_regular
from robot_energy.timeline.blocks import Int

BLOCK_ROWS = 8192
PLAIN_PART = 2**22  # characters that the reader of polars takes at once
MAX_LINE = 2**20
"""Characters; a packed file could hold one line that fills the memory."""
MAX_RATIO = 200
"""How many times larger a packed log may become; numbers shrink to a tenth."""
MIN_UNPACKED = 16 * 2**20
"""Characters or bytes that any packed log may become."""
HEAD, PART = 2**16, 2**10  # bytes that show the encoding; that are read at once
HEAD_LINES = 200  # in which the line of a header is looked for
DELIMITERS = (",", ";", "\t", " ")
GZIP = b"\x1f\x8b"
COMMENT = "#"
EXPECTED = "a table: CSV, plain or gzip, or Parquet"
MARKS = {  # byte order marks, the longer ones first
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
NO_TEXT = (csv.Error, OSError, EOFError, UnicodeError, zlib.error)
Cells = tuple[Int, list[pl.Series], Int, tuple[int, ...]]
"""Line of each row, its cells, how many they are, and lines that repeat the header."""


class TextForm(TypedDict, total=False):
    """How a table is written as text; see `TextTable`."""

    delimiter: str | None
    decimal: str
    encoding: str | None
    comment: str | None
    skip_rows: int


@dataclass
class TextTable:
    """One text: CSV, plain or gzip.

    Args:
        delimiter: Between cells; None: the likeliest in its first line, spaces only where
            there is no other.
        encoding: Of the text; None: UTF-8, UTF-16 or Windows-1252, whichever it is.
        comment: What lines begin with that are left out; None: ``#``.
        skip_rows: Lines before the header, or the rows, that are left out.

    Attributes:
        notes: What was found about the text, one sentence each.
    """

    path: Path
    delimiter: str | None = None
    decimal: str = "."
    encoding: str | None = None
    comment: str | None = None
    skip_rows: int = 0
    headed: bool = True
    columns: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list[str])

    def __post_init__(self) -> None:
        try:
            if self.encoding is None:
                self.encoding = _found_encoding(self._head())
                if self.encoding != "utf-8-sig":
                    shown = "Windows-1252" if self.encoding == "cp1252" else self.encoding.upper()
                    self.notes.append(f"{self.path.name} is read as {shown} text")
            elif codecs.lookup(self.encoding).name == "utf-8":
                self.encoding = "utf-8-sig"
            self._begin = self._header()
        except NO_TEXT as error:
            raise self.unreadable(error) from error

    def _head(self) -> bytes:
        head = b""
        with self._bytes() as file, suppress(EOFError, zlib.error, gzip.BadGzipFile):
            while len(head) < HEAD and (part := file.read(PART)):
                head += part
        return head

    def _header(self) -> int:
        commented, mark, first, number = "", self.comment or COMMENT, "", 0
        with self._open() as file:
            for number, line in enumerate(self._lines(file), 1):
                text = line.strip()
                if number <= self.skip_rows or not text:
                    continue
                if text[:4].lower() == "sep=" and len(text) == len("sep=;"):  # Excel's first line
                    self.delimiter = self.delimiter or text[-1]
                elif text.startswith(mark):
                    commented = text.removeprefix(mark).strip()
                else:
                    first = line
                    break
        if not first:
            raise LogFormatError(f"{self.path} is empty", "a line with the names of the columns")
        likely = max(";\t" if self.decimal == "," else ",;\t", key=first.count)
        self.delimiter = self.delimiter or (likely if likely in first else " ")
        self._first = first.strip()
        if not self.headed:
            return number - 1
        self.columns = self._named(first)
        if commented and all(map(_is_value, self.columns)):  # as numpy writes its header
            names = self._named(commented)
            if len(names) == len(self.columns) and not all(map(_is_value, names)):
                self.columns, self._first = names, ""
                return number - 1
        return number

    def _named(self, line: str) -> tuple[str, ...]:
        reader = csv.reader([line], delimiter=self.delimiter or ",", skipinitialspace=True)
        return tuple(name.strip() for name in next(reader, list[str]()))

    def line_of(self, name: str) -> int:
        """Return the line among the first ones that has a cell of this text; 0 where none has."""
        try:
            with self._open() as file:
                for number, line in enumerate(islice(self._lines(file), HEAD_LINES), 1):
                    cells = (line.split(delimiter) for delimiter in DELIMITERS)
                    if any(name in (cell.strip(' "\r\n') for cell in row) for row in cells):
                        return number
        except NO_TEXT:
            pass
        return 0

    def rows(self, pick: Sequence[int], width: int, numbers: int = 0) -> Iterator[Cells]:
        """Yield all rows that are neither blank nor comments.

        Args:
            numbers: How many of the first ones of `pick` should hold numbers; they may come as
                such, not as text.
        """
        done, repeated = self._begin, list[int]()
        try:
            with self._open() as file:
                lines = self._lines(file)
                for _ in islice(lines, self._begin):
                    pass
                while text := file.read(PLAIN_PART):
                    text += file.readline(MAX_LINE)
                    cells = self._plain(text, width, pick[:numbers])
                    if cells is None:
                        lines = self._lines(io.StringIO(text, newline=""), file)
                        break
                    line = done + np.arange(1, len(cells) + 1)
                    done += len(cells)
                    self._count(len(text))
                    picked = [cells[:, column] for column in pick]
                    yield line, picked, np.full(len(cells), width), ()
                while part := list(islice(lines, BLOCK_ROWS)):
                    repeated += self._blanked(part, done)
                    cells, line = self._split(part, lines, width)
                    found = cells.select(pl.sum_horizontal(pl.all().is_not_null())).to_series()
                    blank = (found == 1) & (cells[:, 0].str.strip_chars() == "")
                    rows = ~blank.to_numpy()
                    if rows.any():
                        given = cells.filter(~blank)
                        picked = [given[:, column] for column in pick]
                        yield done + line[rows], picked, found.to_numpy()[rows], tuple(repeated)
                        repeated = []
                    done += int(line[-1])
        except NO_TEXT as error:
            raise self.unreadable(error, done) from error

    def _plain(self, text: str, width: int, numbers: Sequence[int]) -> pl.DataFrame | None:
        """Cells of whole lines, some of them numbers; None where a line is not just a row of them.

        Quotes, comments and repeated headers are looked for anywhere. What the reader fills up or
        leaves out shows in the number of cells or of rows.
        """
        delimiter, mark = self.delimiter or ",", self.comment or COMMENT
        lines = text.count("\n") + (not text.endswith("\n"))
        data = text.encode()
        cuts = np.frombuffer(data, np.uint8) == ord(delimiter)  # several times as fast as by text
        if (
            any(each in text for each in ('"', "\r", mark, self._first or mark))
            or delimiter == " " or self.decimal != "." or width < 2
            or np.count_nonzero(cuts) != lines * (width - 1)
            or len(text) >= PLAIN_PART + MAX_LINE
        ):  # fmt: skip
            return None
        kinds = {str(k): pl.Float64 if k in numbers else pl.String for k in range(width)}
        try:
            cells = pl.read_csv(
                data, has_header=False, schema=kinds, separator=delimiter, quote_char=None
            )
        except pl.exceptions.PolarsError:
            return None
        endless = np.isinf(cells.select(pl.col(pl.Float64)).to_numpy()).any()
        return cells if len(cells) == lines and not endless else None

    def _blanked(self, part: list[str], done: int) -> Iterator[int]:
        """Make blank lines of comments and repeated headers; yield the places of the latter."""
        mark = self.comment or COMMENT
        for place, line in enumerate(part):
            text = line.strip()
            again = self.headed and text == self._first and text != ""
            if again or text.startswith(mark):
                part[place] = "\n"
            if again:
                yield done + place + 1

    def _split(self, part: list[str], more: Iterator[str], width: int) -> tuple[pl.DataFrame, Int]:
        """Cells of some lines, one column more than there should be, and the line of each row.

        Only a quote asks for the reader of the standard library; a quoted cell may go on in
        the lines that follow.
        """
        delimiter = self.delimiter or ","
        if not any('"' in line for line in part):
            lines = pl.Series(part, dtype=pl.String).str.strip_chars_end("\r\n")
            if delimiter == " ":  # several stand for one, as in columns that are lined up
                lines = lines.str.strip_chars_start(" ").str.replace_all(" +", " ")
            cells = lines.str.split_exact(delimiter, width).struct.unnest()
            cells.columns = [str(place) for place in range(width + 1)]
            return cells, np.arange(1, len(part) + 1)
        reader = csv.reader(chain(part, more), delimiter=delimiter, skipinitialspace=True)
        rows: list[list[str | None]] = []
        ends: list[int] = []
        while reader.line_num < len(part):
            row = next(reader)[: width + 1] or [""]
            rows.append([*row, *[None] * (width + 1 - len(row))])
            ends.append(reader.line_num)
        schema = {str(place): pl.String for place in range(width + 1)}
        return pl.DataFrame(rows, schema=schema, orient="row"), np.asarray(ends)

    @contextmanager
    def _bytes(self) -> Generator[gzip.GzipFile | BinaryIO, None, None]:
        with open_regular(self.path) as raw:
            packed = raw.read(len(GZIP)) == GZIP
            size = raw.seek(0, io.SEEK_END)
            raw.seek(0)
            self._length = 0
            self._most = max(size * MAX_RATIO, MIN_UNPACKED) if packed else size
            yield gzip.GzipFile(fileobj=raw, mode="rb") if packed else raw

    @contextmanager
    def _open(self) -> Generator[TextIO, None, None]:
        with (
            self._bytes() as binary,
            io.TextIOWrapper(binary, encoding=self.encoding, newline="") as text,
        ):
            yield text

    def _lines(self, *files: TextIO) -> Iterator[str]:
        for file in files:
            while line := file.readline(MAX_LINE):
                if len(line) == MAX_LINE:
                    raise csv.Error(f"a line of over {MAX_LINE} characters")
                self._count(len(line))
                yield line

    def _count(self, characters: int) -> None:
        self._length += characters
        if self._length > self._most:
            raise csv.Error(f"it holds over {self._most} characters, {MAX_RATIO} times its size")

    def unreadable(self, error: Exception, line: int = 0) -> LogFormatError:
        """Return why the file cannot be read."""
        where = f" after line {line}" if line else ""
        what = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        remedy = ""
        if isinstance(error, UnicodeError):
            name = (self.encoding or "utf-8").removesuffix("-sig").upper()
            what = f"it is not {name} text"
            remedy = "if it is a text, set its encoding in the mapping, such as encoding: cp1252"
        return LogFormatError(f"{self.path} cannot be read{where} ({what})", EXPECTED, remedy)


def _found_encoding(head: bytes) -> str:
    for mark, name in MARKS.items():
        if head.startswith(mark):
            return name
    zeros = [head[place::2].count(0) for place in (0, 1)]  # of ASCII letters in UTF-16
    for place, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if zeros[place] > len(head) // 4 and not zeros[1 - place]:
            return name
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head, final=len(head) < HEAD)
    except UnicodeDecodeError:
        text = head.decode("cp1252")
        if not all(letter.isprintable() or letter in "\t\r\n\f\v\xa0\xad" for letter in text):
            raise
        return "cp1252"
    return "utf-8-sig"


def _is_value(cell: str) -> bool:
    """Whether a cell is a number or a date rather than a name."""
    return cell == "" or (any(map(str.isdigit, cell)) and not cell.strip("0123456789+-.,:eETZ "))
