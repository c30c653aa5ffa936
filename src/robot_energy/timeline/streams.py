"""Messages of one stream: cut at the jumps of their stamps, without outliers, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from robot_energy.timeline.blocks import NANOSECOND, Block, Int
from robot_energy.timeline.epochs import (
    SLOW_NS,
    STRAY_STAMP,
    EpochRun,
    EpochSplitter,
    Reach,
    Sorted,
)

OLDER = "older_stamp"  # the reason under which messages that come too late are counted
B = TypeVar("B", bound=Block)


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


class StreamSplitter(Generic[B]):
    """Cuts one stream at the jumps of its stamps, takes outliers out, and sorts what is late.

    It holds the messages of which `EpochSplitter` has not decided, and those that
    `ReorderBuffer` lets wait.

    Args:
        reject: Counts what is refused, by its reason; nothing where the caller does.
        window_ns: In which messages that overtook each other are sorted. [ns]
        kinds: Gives the rows of the messages that are sorted among each other.

    Attributes:
        refused: Outliers of the last step; None if there were none.
        held: Messages of which it is not known where they belong; None if there are none.
        lag_ns: Newest stamp minus the time at which it arrived; None before the first. [ns]
    """

    def __init__(
        self,
        reach: Reach,
        reject: Callable[[str, int], None] | None = None,
        window_ns: int = 0,
        kinds: Callable[[B], dict[bytes, Int]] | None = None,
    ) -> None:
        self.epochs = EpochSplitter(reach)
        self._reject = reject or _by_caller
        self.order = ReorderBuffer[B](window_ns, self._reject, kinds)
        self.refused: B | None = None
        self.held: B | None = None
        self.lag_ns: int | None = None

    @property
    def waiting(self) -> int:
        """Messages that wait for later ones."""
        return sum(len(each) for each in (self.held, self.order.held) if each is not None)

    def step(self, block: B, arrival_ns: int | None = None) -> list[tuple[B, EpochRun]]:
        """Return the messages that are known to belong to their epoch, run by run; often one.

        Args:
            arrival_ns: When the last of them was received; None where it does not matter. [ns]
        """
        newest_ns = self.epochs.newest_ns
        found = self.epochs.step(block.stamp_ns)
        if arrival_ns is not None and self.epochs.newest_ns not in (None, newest_ns):
            self.lag_ns = self.epochs.newest_ns - arrival_ns
        if self.held is not None:
            block = type(block).concatenate([self.held, block])
        return self._taken(block, found)

    def flush(self) -> list[tuple[B, EpochRun]]:
        """Return what still waits and is not an outlier."""
        held, found = self.held, self.epochs.flush()
        self.held = self.refused = None
        runs = [] if held is None else self._taken(held, found)
        return [*runs, *self._end_of_epoch()]

    def restart(self) -> None:
        """Drop what waits, as after an error."""
        self.held = self.refused = None
        self.epochs.restart()
        self.order.restart()

    def _taken(self, block: B, found: Sorted) -> list[tuple[B, EpochRun]]:
        self.refused = block[np.asarray(found.strays, dtype=np.int64)] if found.strays else None
        self.held = block[np.asarray(found.held, dtype=np.int64)] if found.held else None
        if found.strays:
            self._reject(STRAY_STAMP, len(found.strays))
        runs: list[tuple[B, EpochRun]] = []
        for run in found.runs:
            arrived = block if run.rows is None else block[np.asarray(run.rows, dtype=np.int64)]
            if run.new_epoch:
                runs += self._end_of_epoch()
            ordered = self.order.step(arrived) if self.order.window_ns else arrived
            run.rising &= ordered is arrived
            run.first_ns = int(arrived.stamp_ns[0])
            runs.append((ordered, run))
        return runs

    def _end_of_epoch(self) -> list[tuple[B, EpochRun]]:
        """Return what waits for its place within the epoch that ends."""
        late = self.order.flush()
        return [] if late is None else [(late, EpochRun())]


def joined(runs: Sequence[tuple[B, EpochRun]]) -> B | None:
    """Return the messages of some runs as one block; None if there are none."""
    blocks = [block for block, _ in runs if len(block)]
    return type(blocks[0]).concatenate(blocks) if blocks else None


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


def apart_sentence(epochs: EpochSplitter, newest_ns: int | None, ahead_ns: int | None) -> str:
    """Return that temperatures are of another time than the joint states; empty if not.

    A stream that has stopped is not a clock: its stamps were right when they arrived.

    Args:
        newest_ns: Newest stamp of the joint states; None before the first. [ns]
        ahead_ns: How far its stamps are ahead of those of the joint states on arrival; None where
            that is not known. [ns]
    """
    if epochs.newest_ns is None or newest_ns is None or ahead_ns is None:
        return ""
    bound = SLOW_NS + 3 * epochs.period_ns
    apart = epochs.newest_ns - newest_ns
    if abs(apart) <= bound or abs(ahead_ns) <= bound:
        return ""
    way = "after" if ahead_ns > 0 else "before"
    return (
        f"the newest temperature is stamped {abs(ahead_ns) * NANOSECOND:.1f} s {way} the joint "
        "states that arrived with it: synchronise the clocks"
    )


def _by_caller(reason: str, count: int) -> None:
    """Leave the count to the caller."""
