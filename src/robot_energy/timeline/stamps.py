"""Stamps: which are in range, in order and new, and where the time between two is a gap.

``builtin_interfaces/Time`` holds seconds as int32 and nanoseconds as uint32, so a message
can carry stamps that no message can carry again: nanoseconds beyond one second, and
seconds so late that the next period ends after 2038-01-19. A stamp outside the range is
refused where it enters, so that nothing behind the entry has to test it again.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Block, Int, differences

if TYPE_CHECKING:
    from robot_energy.timeline.streams import EpochSplitter

MIN_STAMP_NS = 0  # 1970-01-01; zero itself means "not set" and has its own reason
# A day before the int32 seconds of builtin_interfaces/Time end: deadlines and periods that
# begin at an accepted stamp can still be published. [ns]
MAX_STAMP_NS = (2**31 - 1 - 86_400) * SECOND_NS

MIN_DATE = 946_684_800  # 2000-01-01: an earlier stamp is of simulated time [s]
INVALID_STAMP_NS = -1  # what a Time that is not well formed decodes to

RANGE = "from 1970 to 2038, with nanoseconds below one second"  # for the text of errors
BAD_STAMP = "bad_stamp"  # the reason under which such messages are counted
OLDER = "older_stamp"  # the reason under which messages that come too late are counted
BACKWARD_JUMP_NS = SECOND_NS  # older than this starts a new epoch, less is a late sample
HISTORY = 31  # periods behind the median
GAP_PERIODS = 5
MIN_GAP_NS = SECOND_NS // 10
MAX_GAP_NS = SECOND_NS
MIN_PERIOD_NS = 50_000  # 20 kHz: quicker than any driver
MIN_PERIODS = 10  # that make a period usual
BY_PERIOD = 0.0  # as max_gap: five median periods, 0.1 s to 1 s
MIN_MAX_GAP, MAX_MAX_GAP = 0.001, 60.0  # any other max_gap [s]
B = TypeVar("B", bound=Block)


def valid_stamps(stamp_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which stamps are from ``MIN_STAMP_NS`` to ``MAX_STAMP_NS``, same shape.

    Args:
        stamp_ns: Any shape. [ns]
    """
    return (stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS)


def bounded(stamp_ns: int) -> int:
    """Return the nearest stamp within the range, for an output whose stamp is derived. [ns]"""
    return min(max(stamp_ns, MIN_STAMP_NS), MAX_STAMP_NS)


def is_valid_time(seconds: int, nanoseconds: int) -> bool:
    """Return whether a ``builtin_interfaces/Time`` is well formed and within the range."""
    well_formed = 0 <= nanoseconds < SECOND_NS
    return well_formed and MIN_STAMP_NS <= seconds * SECOND_NS + nanoseconds <= MAX_STAMP_NS


def readable_time(stamp_ns: int) -> str:
    """Return a stamp for people: date and time in UTC, or seconds in simulated time."""
    seconds, rest = divmod(stamp_ns, SECOND_NS)
    if seconds < MIN_DATE:
        return f"{stamp_ns / SECOND_NS:.3f} s"
    date = datetime.fromtimestamp(seconds, UTC)
    return f"{date:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"


def checked_max_gap(max_gap: float) -> float:
    """Return the longest gap that is bridged, if it can be one.

    Args:
        max_gap: 0 for five median periods, 0.1 s to 1 s; else 0.001 s to 60 s. [s]
    """
    if max_gap != BY_PERIOD and not MIN_MAX_GAP <= max_gap <= MAX_MAX_GAP:
        raise ParameterError(
            f"max_gap is {max_gap:g} s",
            f"0, or {MIN_MAX_GAP:g} to {MAX_MAX_GAP:g} s",
            "leave it at 0 for five times the usual period of the joint states",
        )
    return max_gap


def newer(stamp_ns: Int, last_ns: int | None) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which stamps of an epoch are newer than all before, and which repeat the newest.

    Args:
        stamp_ns: In order of arrival, shape (N,), N >= 1. [ns]
        last_ns: Newest stamp before them; None if there is none. [ns]
    """
    last = int(stamp_ns[0]) - 1 if last_ns is None else last_ns
    before = np.maximum.accumulate(np.append(last, stamp_ns[:-1]))
    return stamp_ns > before, stamp_ns == before


def newest_by_epoch(stamp_ns: Int, epoch: Int) -> Int:
    """Return the newest stamp so far in each epoch, shape (N,). [ns]

    Args:
        stamp_ns: In order of arrival, shape (N,). [ns]
        epoch: Of each, rising, shape (N,).
    """
    parts = np.split(stamp_ns, np.flatnonzero(np.diff(epoch)) + 1)
    return np.concatenate([np.maximum.accumulate(part) for part in parts])


def held_rows(times_ns: Int, at_ns: Int, max_age_ns: int | None = None) -> Int:
    """Return the row of the value that holds at each instant, shape of ``at_ns``; -1 for none.

    Args:
        times_ns: Stamps of the values, rising, shape (M,). [ns]
        at_ns: The instants, any shape. [ns]
        max_age_ns: Age beyond which a value does not hold any more; None: it never ends. [ns]
    """
    row = np.asarray(np.searchsorted(times_ns, at_ns, side="right") - 1, dtype=np.int64)
    if max_age_ns is None or not len(times_ns):
        return row
    return np.where(at_ns - times_ns[row] <= max_age_ns, row, -1)


def first_needed(times_ns: Int, oldest_ns: int) -> int:
    """Return the first value that holds at an instant or later; earlier ones can be forgotten.

    Args:
        times_ns: Stamps of the values, rising, shape (M,). [ns]
        oldest_ns: The earliest instant that may still be asked for. [ns]
    """
    return max(int(np.searchsorted(times_ns, oldest_ns, side="right")) - 1, 0)


class StampOrder:
    """Numbers the segments of one stream of accepted stamps.

    A segment ends where the stamps step back, which is a new epoch, and at every gap, that is
    where they step by more than ``max_gap``.

    Args:
        max_gap: Longest step that is not a gap; 0: five median periods, but at least 0.1 s and at
            most 1 s. [s]
    """

    def __init__(self, max_gap: float = BY_PERIOD) -> None:
        self.jumps = 0
        self.gaps = 0
        self.segment = 0
        self._fixed_ns = round(checked_max_gap(max_gap) / NANOSECOND)
        self._last: int | None = None
        self._interrupted = False
        self._periods: Int = np.empty(0, dtype=np.int64)

    @property
    def longest_gap_ns(self) -> int:
        """Longest time between two samples that would not be a gap now. [ns]"""
        return self._longest(self._periods)

    @property
    def usual_period_ns(self) -> int | None:
        """Median step of the newest stamps, gaps included; None before there are a few. [ns]"""
        return int(np.median(self._periods)) if len(self._periods) >= MIN_PERIODS else None

    @property
    def gap_share(self) -> float:
        """Share of the newest steps that are gaps. [-]"""
        if not len(self._periods):
            return 0.0
        return float((self._periods > self.longest_gap_ns).mean())

    def interrupt(self) -> None:
        """End the running segment here: what comes next follows a gap, however short."""
        self._interrupted = self._last is not None

    def segments(self, stamp_ns: Int, broken: NDArray[np.bool_] | None = None) -> Int:
        """Return the segment number of each accepted sample, shape (N,).

        Args:
            stamp_ns: Accepted stamps, shape (N,). [ns]
            broken: Samples before which something is missing, whatever the stamps say,
                shape (N,); None for none.
        """
        if not len(stamp_ns):
            return np.empty(0, dtype=np.int64)
        before = stamp_ns[0] if self._last is None else self._last
        elapsed = differences(stamp_ns, int(before))
        known = len(self._periods)
        first = known + (1 if self._last is None else 0)  # the first sample has no period
        periods = np.concatenate(
            [self._periods, elapsed if self._last is not None else elapsed[1:]]
        )
        new = elapsed < 0
        self.jumps += int(new.sum())
        for row in np.flatnonzero(elapsed > (self._fixed_ns or MIN_GAP_NS)).tolist():
            index = known + row - (first - known)
            if elapsed[row] > self._longest(periods[max(0, index - HISTORY) : index]):
                new[row] = True
                self.gaps += 1
        if self._interrupted:
            self._interrupted = False
            if not new[0]:
                new[0] = True
                self.gaps += 1
        if broken is not None:
            self.gaps += int((broken & ~new).sum())
            new |= broken
        segment = self.segment + np.cumsum(new)
        self.segment = int(segment[-1])
        self._last = int(stamp_ns[-1])
        self._periods = periods[-HISTORY:]
        return segment

    def _longest(self, history: Int) -> int:
        if self._fixed_ns:
            return self._fixed_ns
        positive = history[history > 0]
        if not len(positive):
            return MAX_GAP_NS
        median = float(np.median(positive))
        return int(np.clip(GAP_PERIODS * median, MIN_GAP_NS, MAX_GAP_NS))


class ReorderBuffer(Generic[B]):
    """Puts messages of one kind into the order of their stamps.

    A message waits until the stamps of its kind have passed it by the window. One that
    arrives later than that is dropped.

    Args:
        window_ns: How far a stamp may lie behind the newest one of the same kind. [ns]
        kinds: Gives the rows of each kind, as of the messages that have the same joints; None where
            there is one kind only.

    Attributes:
        held: Messages that wait for the window to pass; None if there are none.
    """

    def __init__(
        self,
        window_ns: int,
        reject: Callable[[str, int], None],
        kinds: Callable[[B], dict[bytes, Int]] | None = None,
    ) -> None:
        self.window_ns = window_ns
        self._reject = reject
        self._kinds = kinds
        self.restart()

    def restart(self) -> None:
        """Forget what waits, and the stamps met."""
        self._newest: dict[bytes, int] = {}
        self.held: B | None = None

    def step(self, block: B) -> B:
        """Return the messages that are in order by now, which may be none."""
        known = 0 if self.held is None else len(self.held)
        whole = block if self.held is None else type(block).concatenate([self.held, block])
        release = np.full(len(whole), -1, dtype=np.int64)  # row whose arrival lets it go
        keep = np.ones(len(whole), dtype=np.bool_)
        kinds = {b"": np.arange(len(whole))} if self._kinds is None else self._kinds(whole)
        for key, rows in kinds.items():
            fresh = rows[rows >= known]
            stamp = whole.stamp_ns[fresh]
            if not len(stamp):
                continue
            before = self._newest.get(key, int(stamp[0]))
            newest = np.maximum.accumulate(np.append(before, stamp))
            keep[fresh[stamp < newest[:-1] - self.window_ns]] = False
            self._newest[key] = int(newest[-1])
            at = np.searchsorted(newest[1:], whole.stamp_ns[rows] + self.window_ns, side="left")
            free = at < len(stamp)
            release[rows[free]] = fresh[at[free]]
        self._reject(OLDER, int((~keep).sum()))
        free = np.flatnonzero(keep & (release >= 0))
        order = np.lexsort((whole.stamp_ns[free], release[free]))
        left = keep & (release < 0)
        self.held = whole[left] if bool(left.any()) else None
        return whole[free[order]]

    def flush(self) -> B | None:
        """Return what still waits, as at the end of an epoch, and forget its stamps."""
        held = self.held
        self.restart()
        return None if held is None else held[np.argsort(held.stamp_ns, kind="stable")]


def sentence_of(
    epochs: EpochSplitter,
    what: str,
    remedy: str = "synchronise the clocks",
    within: float | None = None,
) -> str:
    """Return what was wrong with the stamps of a stream; empty if nothing was.

    Args:
        what: Name of the messages, such as ``readings of the meter``.
        within: Only what concerns so much of the newest time; None for all. [s]
    """
    if epochs.odd_ns is None or epochs.newest_ns is None:
        return ""
    if within is not None and epochs.newest_ns - epochs.odd_ns > within / NANOSECOND:
        return ""
    count = epochs.strays
    offset = (epochs.stray_ns if count else epochs.first_off_ns) * NANOSECOND
    way = "ahead of" if offset > 0 else "behind"
    if count:
        kind = "two clocks?" if count >= 3 else "a wrong clock for a moment?"
        return (
            f"{count} {what} refused as stray_stamp: stamped {abs(offset):.1f} s {way} the "
            f"others ({kind}); {remedy}"
        )
    if epochs.behind:
        return (
            f"{epochs.behind} {what} are stamped up to {epochs.behind_ns * NANOSECOND:.1f} s "
            f"behind the others (two clocks?); {remedy}"
        )
    if offset:
        return f"the first of the {what} was stamped {abs(offset):.1f} s {way} the next; {remedy}"
    return ""
