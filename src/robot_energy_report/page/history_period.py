"""A day, week, month or year of a history, or any span: its parts, the one before, its name."""

from __future__ import annotations

from datetime import date, datetime, timedelta
from itertools import pairwise
from typing import Annotated, Any
from zoneinfo import ZoneInfo

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, HOUR_NS, MINUTE_NS, SECOND_NS
from robot_energy_history.api import stamp_of
from robot_energy_history.differences import SLOT_NS
from robot_energy_history.queries import Resolution, edges
from robot_energy_history.tariffs import day_begin

KINDS: dict[str, Resolution] = {
    "hour": "hour", "day": "day", "week": "week", "month": "month", "year": "year",
}  # fmt: skip
SPAN = "span"
PARTS: dict[str, Resolution] = {
    "hour": "minute", "day": "hour", "week": "day", "month": "day", "year": "month",
}  # fmt: skip
"""Into which parts each kind is divided."""
SPANS: tuple[tuple[int, Resolution], ...] = (
    (3 * HOUR_NS, "minute"), (3 * DAY_NS, "hour"), (100 * DAY_NS, "day"),
    (1200 * DAY_NS, "month"),
)  # fmt: skip
"""Parts of a span up to each length [ns]; of a longer one years."""
MAX_YEARS = 100
MAX_NS = 7_200_000_000 * SECOND_NS  # of an instant that is asked for
LABELS = {"year": "%Y", "month": "%b", "day": "%-d", "hour": "%H", "quarter": "%H:%M"}
NAMES = {
    "hour": "%F %H:%M", "day": "%A %F", "week": "week %V of %G", "month": "%B %Y", "year": "%Y",
}  # fmt: skip


class Period(Described):
    """A time of the history, as a calendar has it."""

    kind: str
    start_ns: Annotated[int, "Its begin. [ns]"]
    stop_ns: Annotated[int, "Its end. [ns]"]
    resolution: Resolution
    zone: ZoneInfo

    @property
    def bounds(self) -> list[int]:
        """Where its parts begin, and its end. [ns]"""
        return edges(self.start_ns, self.stop_ns, self.resolution, self.zone)

    @property
    def name(self) -> str:
        """What people call it."""
        if self.kind != SPAN:
            return self._local(self.start_ns).strftime(NAMES[self.kind])
        first, last = self._local(self.start_ns), self._local(self.stop_ns)
        if first.time() == last.time() == datetime.min.time():
            return f"{first:%F} to {self._local(self.stop_ns - 1):%F}"
        return f"{first:%F %H:%M} to {last:%F %H:%M}"

    def moved(self, step: int) -> Period:
        """Return the period that lies so many steps later; of a span, as long as it."""
        local = self._local(self.start_ns)
        match self.kind:
            case "hour":
                begin = self.start_ns + step * HOUR_NS
            case "day" | "week":
                day = local.date() + timedelta(days=step * (7 if self.kind == "week" else 1))
                begin = day_begin(day, self.zone)
            case "month" | "year":
                begin = day_begin(_first_day(local.date(), self.kind, step), self.zone)
            case _:
                length = self.stop_ns - self.start_ns
                return Period(
                    SPAN, self.start_ns + step * length, self.stop_ns + step * length,
                    self.resolution, self.zone,
                )  # fmt: skip
        return period_at(self.kind, begin, self.zone)

    def same_part(self, until_ns: int) -> int:
        """Return until when the period before lasts to be as long as this one up to an instant.

        By local clock, so that a day of 23 hours is compared up to the same hour. [ns]

        Args:
            until_ns: A quarter hour within this period. [ns]
        """
        before = self.moved(-1)
        gone = self._wall(until_ns) - self._wall(self.start_ns)
        wall = self._local(before.start_ns).replace(tzinfo=None) + gone
        found = round(wall.replace(tzinfo=self.zone).timestamp()) * SECOND_NS
        return min(max(found, before.start_ns), before.stop_ns)

    def parts(self) -> list[dict[str, Any]]:
        """Return its parts as plain values: begin and end [s], labels, and the part as a period."""
        kind = {"minute": "", "quarter": "", "all": ""}.get(self.resolution, self.resolution)
        return [
            {
                "start": start / SECOND_NS,
                "stop": stop / SECOND_NS,
                "label": self._label(start),
                "name": self._part_name(start, stop),
                "zoom": {"period": kind, "at": self.at(start)} if kind else None,
            }
            for start, stop in pairwise(self.bounds)
        ]

    def at(self, stamp_ns: int) -> str:
        """Return an instant as requests name it."""
        return self._local(stamp_ns).isoformat(timespec="minutes")

    def plain(self) -> dict[str, str]:
        """Return what a request for it holds."""
        if self.kind != SPAN:
            return {"period": self.kind, "at": self.at(self.start_ns)}
        return {
            "period": SPAN, "start": self.at(self.start_ns), "stop": self.at(self.stop_ns),
        }  # fmt: skip

    def _label(self, start: int) -> str:
        local = self._local(start)
        if self.resolution == "minute":
            return f"{local:%H:%M}"
        if self.kind == "week":
            return f"{local:%a %-d}"
        return local.strftime(LABELS[self.resolution])

    def _part_name(self, start: int, stop: int) -> str:
        if self.resolution in NAMES and self.resolution != "hour":
            return self._local(start).strftime(NAMES[self.resolution])
        return f"{self._local(start):%F %H:%M} to {self._local(stop):%H:%M}"

    def _local(self, stamp_ns: int) -> datetime:
        return local_time(stamp_ns, self.zone)

    def _wall(self, stamp_ns: int) -> datetime:
        return self._local(stamp_ns).replace(tzinfo=None)


def period_at(kind: str, stamp_ns: int, zone: ZoneInfo) -> Period:
    """Return the period of a kind that an instant lies in."""
    found = KINDS.get(kind)
    if found is None:
        raise HistoryError(f"period '{kind[:20]}'", ", ".join((*KINDS, SPAN)))
    start, stop = edges(stamp_ns, stamp_ns + 1, found, zone)
    return Period(kind, start, stop, PARTS[kind], zone)


def span_of(start_ns: int, stop_ns: int, zone: ZoneInfo) -> Period:
    """Return any span, made longer so that it has whole parts."""
    start_ns, stop_ns = start_ns // SLOT_NS * SLOT_NS, -(-stop_ns // SLOT_NS) * SLOT_NS
    length = stop_ns - start_ns
    if not 0 < length <= MAX_YEARS * 366 * DAY_NS:
        raise HistoryError("a span that ends before it begins, or is too long",
                           f"up to {MAX_YEARS} years")  # fmt: skip
    parts: Resolution = "year"
    for longest, finer in reversed(SPANS):
        parts = finer if length <= longest else parts
    bounds = edges(start_ns, stop_ns, parts, zone)
    return Period(SPAN, bounds[0], bounds[-1], parts, zone)


def instant(text: str, zone: ZoneInfo) -> int:
    """Return an instant that a request names. [ns]

    Args:
        text: A date, or date and time, local to the zone unless it says its offset.
    """
    stamp_ns = stamp_of(text, zone)
    if not 0 <= stamp_ns < MAX_NS:
        raise HistoryError(f"time '{text[:40]}'", "one from 1970 to 2190")
    return stamp_ns // MINUTE_NS * MINUTE_NS


def _first_day(day: date, kind: str, step: int) -> date:
    months = day.year * 12 + day.month - 1 + (step if kind == "month" else 12 * step)
    return date(months // 12, months % 12 + 1, 1)
