"""Rows of tables side by side, their time, and what becomes of every row."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from decimal import Decimal, InvalidOperation
from itertools import repeat

import numpy as np
import polars as pl

from robot_energy.blocks import Int
from robot_energy.errors import LogFormatError
from robot_energy.logs.mapping import LATEST_NS, Time, since_1970
from robot_energy.logs.recording import FileAccount
from robot_energy.logs.table import LogTable, Mask, TableRows
from robot_energy.timeline.stamps import BAD_STAMP, valid_stamps

DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}


def side_by_side(
    tables: Sequence[LogTable], streams: Sequence[Iterator[TableRows]]
) -> Iterator[TableRows]:
    """Join rows of tables that were recorded together, the first with the first and so on.

    Args:
        tables: The tables, for messages.
        streams: Rows of each.

    Yields:
        Rows with the numbers of all tables; line and texts are those of the first.

    Raises:
        LogFormatError: If the tables differ in length.
    """
    if len(streams) == 1:
        yield from streams[0]
        return
    kept = [list(stream) for stream in streams]
    counts = [sum(map(len, parts)) for parts in kept]
    for table, count in zip(tables, counts, strict=True):
        if count != counts[0]:
            raise LogFormatError(
                f"'{tables[0].path.name}' has {counts[0]} rows and '{table.path.name}' has {count}",
                "one torque for every position: as many rows in every file",
                "cut the files at the same instants",
            )
    if counts[0]:
        first = kept[0]
        yield TableRows(
            np.concatenate([part.line for part in first]),
            np.hstack([np.concatenate([part.values for part in parts]) for parts in kept]),
            _all(np.concatenate([part.whole for part in parts]) for parts in kept),
            _all(np.concatenate([part.numeric for part in parts]) for parts in kept),
            tuple(pl.concat(texts) for texts in zip(*(part.texts for part in first), strict=True)),
        )


def _all(masks: Iterable[Mask]) -> Mask:
    return np.asarray(np.logical_and.reduce(list(masks)))


class Clock:
    """Gives the rows of the tables of one log their time, run after run.

    Args:
        time: What the mapping says of it.
    """

    def __init__(self, time: Time) -> None:
        self._time = time
        self._apart_ns = round(time.apart * 1e9)
        self._begins = False
        self._label: str | None = None
        self._shift_ns = 0
        self._last_ns: int | None = None
        self._rows = 0

    def begin_table(self) -> None:
        """Begin another table: where times begin at zero, it is a run of its own."""
        self._begins, self._rows = True, 0

    def instants(self, rows: TableRows) -> tuple[Int, Mask]:
        """Return the instant of every row without the start [ns], and which are known, shape (N,).

        Args:
            rows: With the columns of time and run, as far as there are such, as texts.
        """
        texts = list(rows.texts)
        if self._time.rate is not None:
            count = np.arange(self._rows, self._rows + len(rows))
            found = np.rint(count * 1e9 / self._time.rate).astype(np.int64).tolist()
            self._rows += len(rows)
        else:
            found = nanoseconds(texts.pop(0), self._time.unit)
        placed = found
        if texts or self._time.rate is not None or self._time.each_file_is_a_run:
            labels = texts[0].cast(pl.String).str.strip_chars().to_list() if texts else repeat("")
            placed = [
                None if instant is None else self._place(instant, label)
                for instant, label in zip(found, labels, strict=False)
            ]
        known = [instant is not None and abs(instant) < LATEST_NS for instant in placed]
        pairs = zip(placed, known, strict=True)
        values = [instant if ok and instant is not None else 0 for instant, ok in pairs]
        return np.asarray(values, dtype=np.int64), np.asarray(known, dtype=np.bool_)

    def _place(self, instant: int, label: str | None) -> int:
        """Set the runs, which count their own time, one after the other. [ns]"""
        if self._begins or label != self._label:
            self._begins, self._label = False, label
            if self._last_ns is not None:
                self._shift_ns = self._last_ns + self._apart_ns - instant
        placed = instant + self._shift_ns
        self._last_ns = placed if self._last_ns is None else max(self._last_ns, placed)
        return placed


def nanoseconds(column: pl.Series, unit: str) -> list[int | None]:
    """Return instants, exact to the last digit written; None where there is none. [ns]

    Args:
        column: Numbers or text, or dates, which have a unit of their own.
        unit: Of numbers: ``s``, ``ms``, ``us`` or ``ns``.
    """
    if isinstance(column.dtype, pl.Datetime):
        return column.dt.epoch("ns").to_list()
    if isinstance(column.dtype, pl.Duration):
        return column.dt.total_nanoseconds().to_list()
    return [_exact(text, DIGITS[unit]) for text in column.cast(pl.String).to_list()]


def _exact(text: str | None, digits: int) -> int | None:
    text = (text or "").strip()
    try:
        if ":" in text:  # a date, ISO 8601, exact to the microsecond
            return since_1970(datetime.fromisoformat(text))
        instant = Decimal(text).scaleb(digits)
        return int(instant.to_integral_value()) if abs(instant) < LATEST_NS else None
    except (InvalidOperation, ValueError, OverflowError):
        return None


def usable_rows(
    rows: TableRows,
    instants: Int,
    known: Mask,
    required: Mask,
    last_ns: int | None,
    account: FileAccount,
    start_ns: int = 0,
) -> tuple[Mask, int | None]:
    """Return which rows are used, shape (N,), and the time of the last of them. [ns]

    Every other row is counted for the first reason that applies.

    The reasons are ``wrong_length``, ``not_numeric`` (a cell asked for holds text),
    ``bad_time``, ``not_finite`` (a required cell is empty, NaN or infinite), ``bad_stamp``
    (the time is no stamp) and ``not_newer`` (the time does not advance).

    Args:
        rows: The rows.
        instants: From `Clock.instants`, shape (N,). [ns]
        known: From `Clock.instants`, shape (N,).
        required: Which of the numbers must be there, shape (K,).
        last_ns: Time of the last row used, None before the first. [ns]
        account: Where to count.
        start_ns: What instants are added to to become stamps. [ns]
    """
    finite = np.isfinite(rows.values[:, required]).all(axis=1)
    finite &= ~np.isinf(rows.values).any(axis=1)
    used = np.ones(len(rows), dtype=np.bool_)
    account.received += len(rows)
    for reason, good in (
        ("wrong_length", rows.whole),
        ("not_numeric", rows.numeric),
        ("bad_time", known),
        ("not_finite", finite),
        (BAD_STAMP, valid_stamps(instants + start_ns)),
    ):
        account.reject_lines(reason, rows.line[used & ~good])
        used &= good
    least = np.iinfo(np.int64).min if last_ns is None else last_ns
    before = np.maximum.accumulate(np.concatenate([[least], instants[used]]))
    newer = used.copy()
    newer[used] = before[1:] > before[:-1]
    account.reject_lines("not_newer", rows.line[used & ~newer])
    account.accepted += int(newer.sum())
    return newer, int(before[-1]) if len(before) > 1 else last_ns
