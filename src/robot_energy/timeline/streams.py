"""Messages of one stream: epochs between jumps of the stamps, segments between gaps, no outliers.

The same for every stream: joint states, temperatures, friction, torque, meters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Int, differences
from robot_energy.timeline.stamps import (
    BY_PERIOD,
    MAX_GAP_NS,
    MIN_CONFIRMATIONS,
    B,
    EpochRun,
    Reach,
    ReorderBuffer,
    Sorted,
    checked_max_gap,
)

STRAY_STAMP = "stray_stamp"  # the reason under which outliers are counted
HISTORY = 31  # periods behind the median
GAP_PERIODS = 5
MIN_GAP_NS = SECOND_NS // 10
MIN_PERIODS = 10  # that make a period usual
REACH_PERIODS = 5
MAX_CONFIRMATIONS = 8  # the same while two clocks take turns
MAX_PAUSE_NS = 60 * SECOND_NS  # between the first message of all and the second
FIRST_PIECE = 16  # messages that are looked at one by one before all others at once
RESTLESS_MESSAGES = 8  # a jump after fewer messages than this is not a reset but another clock


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
        first = int(self._last is None)  # the first sample has no period
        known, periods = len(self._periods), np.concatenate([self._periods, elapsed[first:]])
        new = elapsed < 0
        self.jumps += int(new.sum())
        for row in np.flatnonzero(elapsed > (self._fixed_ns or MIN_GAP_NS)).tolist():
            index = known + row - first
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


class EpochSplitter:
    """Cuts one stream at the jumps of its stamps, and takes outliers out.

    A message whose stamp lies out of reach of the newest one is held. If the stream goes on
    from the newest, what was held are strays: messages of the run before a loop, stale
    ones, a wrong clock. If three messages in a row (two of a state that is held) lie in
    another time, the stamps have jumped: forward (a gap) or back (a new epoch, as when a bag
    loops or a simulation restarts). Jumps that follow each other within a few messages come
    from two clocks that take turns; each then needs twice as many messages, up to eight, so
    that the clock in use stays in use. So no single message can send the state into the past or
    the future, and at most seven messages are held.

    Attributes:
        stray_ns: How far the last of them lay from the newest stamp, ahead or behind. [ns]
        odd_ns: Newest stamp when the last stamp was odd in any way; None: none was. [ns]
        behind: Messages more than a second behind the newest one that still continue it.
        behind_ns: How far the last of them lay behind. [ns]
        first_off_ns: How far the first message lay from the second, if neither continued
            the other. [ns]
        newest_ns: Newest stamp of the running epoch; None before the first. [ns]
    """

    def __init__(self, reach: Reach | None = None) -> None:
        self.strays = 0
        self.stray_ns = 0
        self.odd_ns: int | None = None
        self.behind = 0
        self.behind_ns = 0
        self.first_off_ns = 0
        self._reach = reach or Reach()
        self._periods: Int = np.empty(0, dtype=np.int64)
        self.restart()

    def restart(self) -> None:
        """Forget where the stream was and what waits, as after an error; counts are kept."""
        self.newest_ns: int | None = None
        self._begin_ns = 0  # first stamp since the last jump
        self._accepted = 0  # messages since then
        self._sure = False  # whether a second message has continued the first
        self._begun = 0  # messages given out without that
        self._needed = self._reach.confirmations
        self._held: list[int] = []  # stamps that wait; the first message too while not sure

    @property
    def beginning(self) -> bool:
        """Whether the first message of all waits for the second."""
        return bool(self._held) and not self._sure

    @property
    def period_ns(self) -> int:
        """Median step of the newest stamps; 0 before the second. [ns]"""
        return int(np.median(self._periods)) if len(self._periods) else 0

    def step(self, stamp_ns: Int) -> Sorted:
        """Return what became of stamps in order of arrival, and of the messages held before.

        Args:
            stamp_ns: Shape (N,), N >= 1. [ns]
        """
        start, position, size = len(self._held), 0, FIRST_PIECE
        waiting: list[int] = list(range(start))
        runs: list[EpochRun] = []
        strays: list[int] = []
        while position < len(stamp_ns):
            rest = stamp_ns[position:]
            calm = self._calm(rest) if self._sure and not self._held else None
            if calm is not None:
                if position or start:
                    calm.rows = list(range(start + position, start + len(stamp_ns)))
                return Sorted([*runs, calm], strays)
            # One by one, but only as far as it takes to be calm again.
            piece = rest[:size].tolist()
            place = [*waiting, *range(start + position, start + position + len(piece))]
            found = self._sort_out([*self._held, *piece])
            for run in found.runs:
                run.rows = [place[row] for row in run.rows or ()]
            runs += found.runs
            strays += [place[row] for row in found.strays]
            waiting = [place[row] for row in found.held]
            position, size = position + len(piece), 2 * size
        return Sorted(runs, strays, waiting)

    def flush(self) -> Sorted:
        """Decide on what still waits, as at the end.

        In a stream with enough messages, a single message out of reach is an outlier; in one
        that has only begun, that is undecided and the message counts.
        """
        stamps, self._held = self._held, []
        rows = list(range(len(stamps)))
        if not stamps or self.newest_ns is None:
            return Sorted([])
        if self._sure:
            known = self._accepted >= MIN_CONFIRMATIONS
            if known and not (len(stamps) > 1 and self._continues(stamps[-1], stamps[-2])):
                return Sorted([], self._refused(rows, stamps))
            runs: list[EpochRun] = []
            self._jump(stamps, rows, runs)
            return Sorted(runs)
        back = differences(np.asarray(stamps), stamps[0]) < 0
        runs = [EpochRun([row], new_epoch=bool(back[row])) for row in rows]
        self._jump_to(stamps[-1])
        return Sorted(runs)

    def _calm(self, stamp: Int) -> EpochRun | None:
        """All at once where none is out of reach, as nearly always; else None."""
        assert self.newest_ns is not None
        ahead, newest, reach = differences(stamp, self.newest_ns), int(stamp[-1]), self._reach
        rising = bool((ahead > 0).all())
        if not rising:
            before = np.maximum.accumulate(np.concatenate([[self.newest_ns], stamp]))
            ahead, newest = stamp - before[:-1], int(before[-1])
        steps, most = ahead if rising else ahead[ahead > 0], int(ahead.max())
        if most > reach.ahead_ns:  # the median of the periods is at least the shortest
            known = len(self._periods) > 0
            shortest = min(int(steps.min()), int(self._periods.min())) if known else 0
            if most > min(REACH_PERIODS * shortest, reach.max_ahead_ns):
                return None
        if not rising:
            low = int(ahead.min())
            if low <= -reach.behind_ns:
                return None
            if low < -SECOND_NS:
                late = ahead[ahead < -SECOND_NS]
                self.behind += len(late)
                self.behind_ns = -int(late[-1])
                self.odd_ns = newest
        self._periods = np.concatenate([self._periods, steps[-HISTORY:]])[-HISTORY:]
        self._accepted += len(stamp)
        self.newest_ns = newest
        return EpochRun(None, rising=rising)

    def _learn(self, step: int) -> None:
        """Keep a step that may be a period of the stream."""
        if 0 < step <= self._reach.max_ahead_ns:
            self._periods = np.append(self._periods, step)[-HISTORY:]

    def _ahead_ns(self) -> int:
        """How far ahead of the newest stamp one may lie now. [ns]"""
        reach = self._reach
        if not len(self._periods):
            return reach.max_ahead_ns if not reach.prompt else reach.ahead_ns
        return min(max(REACH_PERIODS * self.period_ns, reach.ahead_ns), reach.max_ahead_ns)

    def _continues(self, stamp: int, newest: int) -> bool:
        behind = self._reach.behind_ns if self._sure else self._reach.ahead_ns
        near = stamp - newest <= self._reach.ahead_ns
        return newest - behind < stamp and (near or stamp <= newest + self._ahead_ns())

    def _refused(self, rows: list[int], stamps: list[int]) -> list[int]:
        """Count outliers and return their rows."""
        assert self.newest_ns is not None
        self.strays += len(rows)
        self.stray_ns = stamps[rows[-1]] - self.newest_ns
        self.odd_ns = self.newest_ns
        return rows

    def _jump_to(self, stamp: int) -> None:
        self.newest_ns = self._begin_ns = stamp
        self._accepted = 0

    def _advance(self, stamp: int) -> None:
        """Take one message that continues the newest one or a jump."""
        assert self.newest_ns is not None
        step = stamp - self.newest_ns
        self._learn(step)
        if step < -SECOND_NS:
            self.behind += 1
            self.behind_ns = -step
            self.odd_ns = self.newest_ns
        self._accepted += 1
        self.newest_ns = max(self.newest_ns, stamp)

    def _sort_out(self, stamps: list[int]) -> Sorted:
        """Go through the messages one by one."""
        runs = [EpochRun()]
        strays: list[int] = []
        first: list[int] = []  # the first message of all, while nothing continues it
        held: list[int] = []
        if self._held and not self._sure and not self._reach.prompt:
            self.newest_ns = None  # it is among those that are held
        for row, stamp in enumerate(stamps):
            if self.newest_ns is None:
                self._jump_to(stamp)
                if self._reach.prompt:
                    self._begun = 1
                    _rows(runs).append(row)
                else:
                    first = [row]
                continue
            newest = self.newest_ns
            if self._continues(stamp, newest):
                if held and stamp > newest:
                    strays += self._refused(held, stamps)
                    held = []
                _rows(runs).extend([*first, row])
                first = []
                self._sure = True
                self._advance(stamp)
                continue
            if not self._sure and self._reach.prompt:
                runs.append(EpochRun([row], new_epoch=stamp < newest))
                self._learn(stamp - newest)
                if not newest <= stamp <= newest + self._reach.max_ahead_ns:
                    self.first_off_ns = newest - stamp
                    self.odd_ns = stamp
                self._begun += 1
                self._sure = self._begun == MIN_CONFIRMATIONS
                self._jump_to(stamp)
                continue
            if first and 0 < stamp - newest <= MAX_PAUSE_NS:
                _rows(runs).extend(first)
                first, self._sure, self._accepted = [], True, 1
            before = stamps[held[-1]] if held else stamp
            if stamp <= before - self._reach.behind_ns or before < newest < stamp:
                strays += self._refused(held, stamps)
                held = []
            held.append(row)
            needed = self._needed if self._sure else 2
            if len(held) < needed:
                continue
            near = self._continues(stamp, stamps[held[-2]])
            if first and near:
                strays += self._refused(first, stamps)  # two agree against the first
                first = []
                self.newest_ns = None
            elif first:
                _rows(runs).extend(first)
                first = []
            self._jump(stamps, held, runs)
            held = []
        waiting = sorted([*first, *held])
        self._held = [stamps[row] for row in waiting]
        return Sorted([run for run in runs if run.rows], strays, waiting)

    def _jump(self, stamps: list[int], held: list[int], runs: list[EpochRun]) -> None:
        """Go on from what was held."""
        start = stamps[held[0]]
        newest = self.newest_ns
        if newest is None:
            runs.append(EpochRun(list(held)))
        else:
            back = start < newest
            restless = back and newest - self._begin_ns < SECOND_NS
            runs.append(EpochRun(list(held), back, restless))
            quick = self._sure and self._accepted < RESTLESS_MESSAGES
            least = self._reach.confirmations
            most = MAX_CONFIRMATIONS if self._reach.patient else least
            self._needed = min(2 * self._needed, most) if quick else least
            self._learn(start - newest)
        self._sure = True
        self._jump_to(start)
        for row in held:
            self._advance(stamps[row])


def _rows(runs: list[EpochRun]) -> list[int]:
    rows = runs[-1].rows
    assert rows is not None
    return rows


def _uncounted(reason: str, count: int) -> None:
    """Leave out what nobody counts; a lambda could not go to another process."""


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
        self._reject = reject or _uncounted
        self.order = ReorderBuffer[B](window_ns, self._reject, kinds)
        self.refused: B | None = None
        self.held: B | None = None
        self.lag_ns: int | None = None

    @property
    def waiting(self) -> int:
        """Messages that wait for later ones."""
        return sum(len(each) for each in (self.held, self.order.held) if each is not None)

    def step(self, block: B, arrival_ns: int | None = None) -> list[tuple[B, EpochRun]]:
        """Return the messages that are known to belong to their epoch, run by run; often one."""
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
