"""Rows of tables side by side, their time, and what becomes of every row."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat

import numpy as np
import polars as pl

from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Int
from robot_energy.timeline.stamps import BAD_STAMP, MIN_DATE, valid_stamps
from robot_energy_logs.instants import Instants
from robot_energy_logs.mapping import LATEST_NS, Time
from robot_energy_logs.recording import FileAccount
from robot_energy_logs.table import LogTable, Mask, TableRows


def side_by_side(
    tables: Sequence[LogTable], streams: Sequence[Iterator[TableRows]]
) -> Iterator[TableRows]:
    """Join rows of tables that were recorded together, the first with the first and so on.

    Yields:
        Rows with the numbers of all tables; line and texts are those of the first.
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
            np.concatenate([part.width for part in first]),
            _all(np.concatenate([part.whole for part in parts]) for parts in kept),
            _all(np.concatenate([part.numeric for part in parts]) for parts in kept),
            tuple(cell for parts in kept for cell in _joined([part.cells for part in parts])),
            _joined([part.texts for part in first]),
            first[0].decimal,
        )


def _joined(parts: Sequence[tuple[pl.Series, ...]]) -> tuple[pl.Series, ...]:
    return tuple(pl.concat(columns) for columns in zip(*parts, strict=True))


def _all(masks: Iterable[Mask]) -> Mask:
    return np.asarray(np.logical_and.reduce(list(masks)))


class Clock:
    """Gives the rows of the tables of one log their time, run after run."""

    def __init__(self, time: Time) -> None:
        self._time = time
        self._instants = Instants(time)
        self._in_runs = time.rate is not None or time.run is not None or time.each_file_is_a_run
        self._apart_ns = round(time.apart * 1e9)
        self._begins = False
        self._label: str | None = None
        self._shift_ns = 0
        self._last_ns: int | None = None
        self._rows = 0
        self._run = 0
        self._source = ""
        self.notes = self._instants.notes  # what was assumed of the times, one sentence each

    def begin_table(self, name: str = "") -> None:
        """Begin another table: where times begin at zero, it is a run of its own."""
        self._begins, self._rows, self._source = self._in_runs, 0, name
        if self._time.each_file_is_a_run:
            self._instants.begin()

    def instants(self, rows: TableRows) -> tuple[Int, Mask, Int]:
        """Return instants without the start [ns], which are known, and their runs, shape (N,).

        Args:
            rows: With the columns of time and run, as far as there are such, as texts.
        """
        texts = list(rows.texts)
        in_turn = self._in_runs or rows.repeated or self._shift_ns
        if not in_turn and (exact := self._instants.exact(texts[0])) is not None:
            latest = int(exact.max())
            self._last_ns = latest if self._last_ns is None else max(self._last_ns, latest)
            return exact, np.ones(len(rows), np.bool_), np.full(len(rows), self._run)
        lines: list[int] = rows.line.tolist()
        if self._time.rate is not None:
            count = np.arange(self._rows, self._rows + len(rows))
            found = np.rint(count * 1e9 / self._time.rate).astype(np.int64).tolist()
            self._rows += len(rows)
        else:
            column = texts.pop(0)
            if column.dtype == pl.String and rows.decimal != ".":
                column = column.str.replace(rows.decimal, ".", literal=True)
            found = self._instants(column, lines, self._source)
        if in_turn:
            placed, run = self._placed(found, texts, rows)
        else:
            placed, run = found, [self._run] * len(found)
            latest = [instant for instant in (self._last_ns, *found) if instant is not None]
            self._last_ns = max(latest, default=None)
        known = [instant is not None and abs(instant) < LATEST_NS for instant in placed]
        pairs = zip(placed, known, strict=True)
        values = [instant if ok and instant is not None else 0 for instant, ok in pairs]
        return (
            np.asarray(values, dtype=np.int64),
            np.asarray(known, dtype=np.bool_),
            np.asarray(run, dtype=np.int64),
        )

    def _placed(
        self, found: Sequence[int | None], labels: Sequence[pl.Series], rows: TableRows
    ) -> tuple[list[int | None], list[int]]:
        """Instants with the runs one after the other [ns], and the run of each row."""
        texts = labels[0].cast(pl.String).str.strip_chars().to_list() if labels else repeat("")
        repeated, placed, run = list(rows.repeated), list[int | None](), list[int]()
        for instant, label, line in zip(found, texts, rows.line.tolist(), strict=False):
            while repeated and line > repeated[0]:
                self._restart(repeated.pop(0), instant)
            placed.append(None if instant is None else self._place(instant, label))
            run.append(self._run)
        return placed, run

    def _restart(self, header: int, instant: int | None) -> None:
        """Note a header that is repeated; a clock that begins again there begins a run."""
        text = f"line {header} of {self._source} repeats the header: another recording follows"
        last = None if self._last_ns is None else self._last_ns - self._shift_ns
        if last is not None and instant is not None and instant <= last < MIN_DATE * SECOND_NS:
            self._begins = True
            text += f", whose clock begins again: it is set {self._time.apart:g} s after the first"
        self.notes.append(text)

    def _place(self, instant: int, label: str | None) -> int:
        """Set the runs, which count their own time, one after the other. [ns]"""
        if self._begins or label != self._label:
            self._begins, self._label = False, label
            if self._last_ns is not None:
                self._shift_ns = self._last_ns + self._apart_ns - instant
                self._run += 1
        placed = instant + self._shift_ns
        self._last_ns = placed if self._last_ns is None else max(self._last_ns, placed)
        return placed


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
    (the time is not a stamp) and ``not_newer`` (the time does not advance).

    Args:
        instants: From `Clock.instants`, shape (N,). [ns]
        known: From `Clock.instants`, shape (N,).
        required: Which of the numbers must be there, shape (K,).
        last_ns: Time of the last row used, None before the first. [ns]
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
        _reject(rows, reason, used & ~good, required, account)
        used &= good
    least = np.iinfo(np.int64).min if last_ns is None else last_ns
    before = np.maximum.accumulate(np.concatenate([[least], instants[used]]))
    newer = used.copy()
    newer[used] = before[1:] > before[:-1]
    _reject(rows, "not_newer", used & ~newer, required, account)
    account.accepted += int(newer.sum())
    return newer, int(before[-1]) if len(before) > 1 else last_ns


def _reject(rows: TableRows, reason: str, bad: Mask, required: Mask, account: FileAccount) -> None:
    if bad.any() and reason not in account.first_line:
        row = int(np.argmax(bad))
        if reason in ("not_numeric", "not_finite"):
            cell = rows.unusable_cell(row, required)
        elif reason == "wrong_length":
            cell = "", f"{rows.width[row]} cells"
        else:
            cell = rows.text_cell(row)
        account.first_line[reason], account.first_cell[reason] = int(rows.line[row]), cell
    account.reject(reason, int(bad.sum()))
