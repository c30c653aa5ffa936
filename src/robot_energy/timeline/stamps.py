"""Stamps: which are in range, in order and new, and how far they may lie from the newest one.

``builtin_interfaces/Time`` holds seconds as int32 and nanoseconds as uint32, so a message
can carry stamps that no message can carry again: nanoseconds beyond one second, and
seconds so late that the next period ends after 2038-01-19. A stamp outside the range is
refused where it enters, so that nothing behind the entry has to test it again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Block, Int

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
MAX_GAP_NS = SECOND_NS
MIN_PERIOD_NS = 50_000  # 20 kHz: quicker than any driver
BY_PERIOD = 0.0  # as max_gap: five median periods, 0.1 s to 1 s
MIN_MAX_GAP, MAX_MAX_GAP = 0.001, 60.0  # any other max_gap [s]
MIN_CONFIRMATIONS = 3  # messages in a row that make a jump of the stamps
SLOW_CONFIRMATIONS = 2  # the same of a state that is held, where a false jump costs little
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


class Reach(Described):
    """How far a stamp may lie from the newest one of its stream and still continue it."""

    ahead_ns: int = SECOND_NS // 10
    max_ahead_ns: Annotated[
        int, "At most, where the stream is slow: five median periods count. [ns]"
    ] = SECOND_NS
    behind_ns: Annotated[int, "Less than this behind it: late, not another time. [ns]"] = SECOND_NS
    prompt: Annotated[
        bool,
        "The first message counts at once, as it does of a state that is latched; otherwise it "
        "waits for the second.",
    ] = False
    patient: Annotated[bool, "Whether jumps that follow each other quickly need more messages."] = (
        True
    )
    confirmations: Annotated[int, "Messages in a row that make a jump of the stamps."] = (
        MIN_CONFIRMATIONS
    )


SLOW_NS = 5 * SECOND_NS  # temperatures move little in this


def slow_reach(stale_ns: int) -> Reach:
    """Return the reach of a state that changes slowly and is held until it is stale."""
    return Reach(
        SLOW_NS,
        max(SLOW_NS, stale_ns // 2),
        SLOW_NS,
        prompt=True,
        confirmations=SLOW_CONFIRMATIONS,
    )


@dataclass
class EpochRun:
    """Messages that belong together.

    Attributes:
        rows: Their numbers; None for all that were given, when none was held before.
        new_epoch: Whether the stamps jumped back before them.
        restless: Whether they did so within a second after another jump, as they do when
            two clocks take turns.
        rising: Whether it is known that each stamp is newer than all before.
        first_ns: Stamp of the first of them that arrived, once their blocks are known. [ns]
    """

    rows: list[int] | None = field(default_factory=list[int])
    new_epoch: bool = False
    restless: bool = False
    rising: bool = False
    first_ns: int = 0


class Sorted(Described):
    """What became of messages. Rows count those that were held first, then those given."""

    runs: list[EpochRun]
    strays: list[int] = field(default_factory=list[int])
    held: Annotated[
        list[int], "Rows that wait for later messages; the caller puts them before the next ones."
    ] = field(default_factory=list[int])


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
    if within is not None and abs(epochs.newest_ns - epochs.odd_ns) > within / NANOSECOND:
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
