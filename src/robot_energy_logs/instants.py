"""Cells of the time of a log -> instants: numbers, dates of a zone, dates in a stated form."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta, tzinfo
from decimal import Decimal, InvalidOperation

import numpy as np
import polars as pl
from numpy.typing import NDArray

from robot_energy.foundation.time_zone import time_zone
from robot_energy_logs.mapping import DIGITS, LATEST_NS, Time, since_1970

SECOND = 10**9  # ns
QUARTER = 900 * SECOND  # offsets from UTC change at quarters of an hour
BACK = 60 * SECOND  # a step back by more within a doubled hour begins the second one
DOUBLED = (1800 * SECOND, 3600 * SECOND)  # how far local times step back at the end of summer time
EPOCH, ELAPSED = datetime(1970, 1, 1), datetime(1900, 1, 1)  # of strptime without a date
EXCEL_DAYS = 25_569  # from 1899-12-30, where Excel's days begin, to 1970
MAX_EXPONENT = 30  # of a number that can be a time
BEYOND_MICROSECONDS = re.compile(r"[.,]\d{6}(\d{1,3})")
CLOCKS = ("%H:%M:%S", "%H:%M:%S.%f", "%H:%M:%S,%f", "%H:%M", "%I:%M:%S %p")
DAYS = (
    *("%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%Y/%m/%d", "%Y.%m.%d", "%d-%m-%Y", "%Y-%m-%d"),
    *("%d.%m.%y", "%d/%m/%y", "%m/%d/%y", "%d %b %Y", "%d-%b-%Y", "%b %d %Y", "%Y:%m:%d"),
)
FORMS = (
    *(f"{day}{between}{clock}" for day in DAYS for between in (" ", "T", ":") for clock in CLOCKS),
    *CLOCKS,
)
LIKELY = (Decimal(946_684_800), Decimal(2_145_916_800))  # 2000 to 2038 [s]


class Instants:
    """Turns the cells of a column of time into instants, in the order of the rows.

    A date that has no zone is of the zone of the mapping. At the end of summer time an hour
    stands twice: its rows are the first until the times step back.
    """

    def __init__(self, time: Time) -> None:
        self._unit = time.unit
        form = time.format
        # Decimal commas of a table have become points before its cells come here.
        self._forms = () if form is None else tuple(dict.fromkeys((form, form.replace(",", "."))))
        self._zone = None if time.zone is None else time_zone(time.zone)
        self._offsets: dict[int, tuple[int, int]] = {}
        self._last: int | None = None
        self._named: set[int] = set()  # doubled hours that have a note
        self.notes: list[str] = []

    def begin(self) -> None:
        """Begin a run whose times do not follow those before it."""
        self._last = None

    def __call__(
        self, column: pl.Series, lines: Sequence[int] = (), source: str = ""
    ) -> list[int | None]:
        """Return instants, exact to the last digit written; None where there is none. [ns]

        Args:
            column: Numbers or text, or dates, which have a unit of their own.
        """
        if isinstance(column.dtype, pl.Datetime | pl.Duration):
            # Whole numbers of Python: a date of another century does not fit into 64 bits of ns.
            each = 10 ** DIGITS[column.dtype.time_unit or "us"]
            found = [count and count * each for count in column.to_physical().to_list()]
            without = isinstance(column.dtype, pl.Datetime) and column.dtype.time_zone is None
            local = [without] * len(found)
        else:
            pairs = [self._read(text) for text in column.cast(pl.String).to_list()]
            found, local = [instant for instant, _ in pairs], [without for _, without in pairs]
        if not any(local):
            return found
        return [
            self._in_zone(instant, lines[row] if row < len(lines) else 0, source)
            if instant is not None and without
            else instant
            for row, (instant, without) in enumerate(zip(found, local, strict=True))
        ]

    def exact(self, column: pl.Series) -> NDArray[np.int64] | None:
        """Return instants, shape (N,), of plain decimal numbers that have no digit below 1 ns. [ns]

        Args:
            column: As of a call; None comes of any other one.
        """
        digits = DIGITS.get(self._unit)
        if self._forms or digits is None or column.dtype != pl.String or not len(column):
            return None
        parts = column.str.splitn(".", 2).struct.unnest()
        whole, rest = parts.get_columns()
        rest = rest.fill_null("")
        first, longest = whole.min(), rest.str.len_bytes().max()
        found = (whole + rest.str.pad_end(digits, "0")).cast(pl.Int64, strict=False)
        if (
            not (isinstance(first, str) and first >= "0")  # no sign, space or empty cell
            or not (isinstance(longest, int) and longest <= digits)
            or found.null_count()
        ):
            return None
        instants = found.to_numpy()
        return instants if instants.max() < LATEST_NS else None

    def _read(self, cell: str | None) -> tuple[int | None, bool]:
        """The instant of a cell, and whether it is a date that has no zone."""
        text = (cell or "").strip()
        for form in self._forms:
            try:
                date = datetime.strptime(text, form)
            except ValueError:
                continue
            if not re.search("%[djcxGV]", form):  # a time of the day: counts from midnight
                return _elapsed(date - ELAPSED), False
            return since_1970(date), date.tzinfo is None
        if self._forms:
            return None, False
        try:
            number = Decimal(text)
        except InvalidOperation:
            return _iso(text)
        try:
            if self._unit == "excel_day":
                microseconds = ((number - EXCEL_DAYS) * 86_400 * 10**6).to_integral_value()
                return _bounded(microseconds.scaleb(3)), True
            return _bounded(number.scaleb(DIGITS[self._unit])), False
        except ArithmeticError:  # not a number, or beyond all exponents
            return None, False

    def _in_zone(self, local: int, line: int, source: str) -> int | None:
        """The instant of a date without zone; None of one that the zone leaves out. [ns]"""
        if abs(local) >= LATEST_NS:
            return None
        if self._zone is None:
            self._assume(local, line, source)
            return local
        first, second = self._offset(local // QUARTER, self._zone)
        if first < second:  # the clocks were put forward
            return None
        instant = local - first
        if first > second:
            stepped = self._last is not None and instant < self._last - BACK
            instant = local - second if stepped else instant
            self._name(local, line if stepped else 0, source)
        self._last = instant if self._last is None else max(self._last, instant)
        return instant

    def _offset(self, quarter: int, zone: tzinfo) -> tuple[int, int]:
        """Offsets from UTC of a local time, of the first and second such hour. [ns]"""
        if quarter not in self._offsets:
            local = EPOCH + timedelta(minutes=15 * quarter)
            both = [local.replace(tzinfo=zone, fold=fold).utcoffset() for fold in (0, 1)]
            first, second = (_elapsed(offset or timedelta()) for offset in both)
            self._offsets[quarter] = first, second
        return self._offsets[quarter]

    def _name(self, local: int, line: int, source: str) -> None:
        """Note how the rows of a doubled hour are taken."""
        hour = local // (4 * QUARTER)
        key = 2 * hour + bool(line)
        if key in self._named:
            return
        self._named.add(key)
        begin = _shown(hour * 4 * QUARTER)
        if not line:
            text = f"the hour from {begin} occurs twice in {self._zone}: its rows count as the"
            self.notes.append(f"{text} first, of summer time, until the times step back")
        else:
            self.notes.append(
                f"from line {line} of {source} on, rows of the hour from {begin} count as the "
                "second"
            )

    def _assume(self, local: int, line: int, source: str) -> None:
        """Note that UTC is assumed, and a doubled hour of local times."""
        if self._last is None and not self._named:
            self._named.add(0)
            self.notes.append(
                "dates have no zone and are taken as UTC: set time.zone in the mapping, such as "
                "Europe/Berlin, if they are local"
            )
        back = 0 if self._last is None else self._last - local
        if DOUBLED[0] <= back <= DOUBLED[1] and self._last is not None and len(self._named) < 2:
            self._named.add(1)
            self.notes.append(
                f"times step back from {_shown(self._last)} to {_shown(local)} at line {line} of "
                f"{source}, as local times do at the end of summer time: set time.zone in the "
                "mapping, so that both of these hours are read"
            )
        self._last = local


def time_remedy(cell: str) -> str:
    """Return the key of a mapping that reads a cell of the time; empty where none is known."""
    text = cell.strip()
    try:
        number = Decimal(text)
    except InvalidOperation:
        return _form_remedy(text)
    if not number.is_finite() or abs(number.adjusted()) > MAX_EXPONENT:
        return ""
    for unit, digits in DIGITS.items():
        if LIKELY[0] <= number.scaleb(digits - 9) <= LIKELY[1]:
            return f"set time.unit: {unit} in the mapping"
    if LIKELY[0] <= (number - EXCEL_DAYS) * 86_400 <= LIKELY[1]:
        return "set time.unit: excel_day in the mapping if these are the days of Excel"
    return ""


def _form_remedy(text: str) -> str:
    fitting: list[str] = []
    for form in FORMS:
        try:
            datetime.strptime(text, form)
        except ValueError:
            continue
        fitting.append(form)
    if not fitting:
        return ""
    remedy = " or ".join(f"'{form}'" for form in fitting[:2])
    remedy = f"set time.format: {remedy} in the mapping"
    if "%d" not in fitting[0]:
        remedy += ", and time.start to the midnight before"
    return remedy


def _iso(text: str) -> tuple[int | None, bool]:
    if ":" not in text and "T" not in text:  # a day alone is not an instant
        return None, False
    try:
        date = datetime.fromisoformat(text)
        instant = since_1970(date)
    except (ValueError, OverflowError):
        return None, False
    beyond = BEYOND_MICROSECONDS.search(text)
    return instant + (int(beyond[1].ljust(3, "0")) if beyond else 0), date.tzinfo is None


def _bounded(instant: Decimal) -> int | None:
    return int(instant.to_integral_value()) if abs(instant) < LATEST_NS else None


def _elapsed(time: timedelta) -> int:
    return (time.days * 86_400 + time.seconds) * SECOND + time.microseconds * 1000


def _shown(local: int) -> str:
    return (EPOCH + timedelta(seconds=local // SECOND)).isoformat(" ")
