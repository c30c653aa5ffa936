"""Friction over the time of the torques: which row is valid at each of their stamps.

Two streams meet here, each with jumps of its own stamps, and each may meet a jump first.
Rows are chosen by what the stamps say, never by counting jumps, so a clock that jumps alone
costs at most `ALONE_NS` of older temperatures. At most two lines of rows are kept.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_energy.timeline.blocks import NANOSECOND, Float, FrictionBlock, Int, differences
from robot_energy.timeline.stamps import SLOW_NS

HISTORY_NS = 60_000_000_000  # friction kept behind the samples
ALONE_NS = 10_000_000_000  # a jump that the other stream does not follow by then is its own
MAX_BEGINNING = 3  # rows of a line that may have been none: the first stamps were wrong
MAX_ROWS = 100_000  # friction kept ahead of the samples: hours
APART_NS = 5_000_000_000  # stamps that far from the torques' are another clock's [ns]


class FrictionTimeline:
    """Rows of friction, each valid from its stamp onward.

    Where friction jumps back first, torque goes on with the line before the jump, until it is
    ten seconds past a row that no other follows within a minute. Where torque jumps back
    first, the row in use goes on until friction follows, or for ten seconds. The first row of
    all that comes before any torque holds for the first five seconds of torque also if its
    stamp is that of another time: nothing else is known then.
    """

    def __init__(self, initial: FrictionBlock) -> None:
        self._line = initial  # its first row, of stamp zero, holds before all others
        self._before: FrictionBlock | None = None  # the line before friction jumped back
        self._used: FrictionBlock = initial  # the row at the newest torque
        self._part = (initial, 0, 0, initial)  # line, first and last row, the rows last in use
        self._first: FrictionBlock | None = None  # the first row of all, at the start
        self._start_ns: int | None = None  # first torque
        self._alone_ns: int | None = None  # torque has jumped back to here, friction has not

    @property
    def rows(self) -> int:
        """Rows that are kept."""
        return len(self._line) + (0 if self._before is None else len(self._before))

    def add(self, block: FrictionBlock) -> None:
        """Take rows in order of arrival, without those of stamp zero (before any temperature).

        They are known already; a restarted friction monitor repeats them, which must not undo what
        came later.
        """
        block = block[block.stamp_ns != 0]
        if not len(block):
            return
        if len(self._line) == 1 and self._before is None and self._start_ns is None:
            self._first = block[slice(0, 1)]
        block = replace(  # no temperature is newer than the row that says so
            block,
            temperature_stamp_ns=np.minimum(block.temperature_stamp_ns, block.stamp_ns[:, None]),
        )
        while len(block):
            newest = int(self._line.stamp_ns[-1])
            if int(block.stamp_ns[0]) <= newest - SLOW_NS:
                if self._alone_ns is None:
                    self._before = self._line
                self._line, self._alone_ns, newest = self._line[slice(0, 1)], None, 0
            falls = np.flatnonzero(differences(block.stamp_ns, newest) < 0)
            rising = int(falls[0]) if len(falls) else len(block)
            if rising:
                line = FrictionBlock.concatenate([self._line, block[slice(0, rising)]])
                if len(line) > MAX_ROWS:
                    newest = line[slice(-MAX_ROWS, None)]
                    line = FrictionBlock.concatenate([line[slice(0, 1)], newest])
                self._line = line
            late = rising == 0  # a little older than what is known: superseded
            block = block[slice(rising + late, None)]

    def jump_back(self, stamp_ns: int) -> None:
        """Note that the stamps of torque have jumped back; the row in use goes on."""
        self._first = None
        used, seen = self._used, self._used.temperature_stamp_ns
        carried = replace(
            used,
            stamp_ns=np.zeros(1, dtype=np.int64),
            temperature_stamp_ns=np.where(seen > 0, stamp_ns, 0),
        )
        self._line = FrictionBlock.concatenate([carried, self._line[slice(1, None)]])
        self._alone_ns = stamp_ns if self._before is None else None
        self._before = None

    def at(self, stamp_ns: Int) -> tuple[FrictionBlock, Int]:
        """Return rows and which of them is valid at each stamp.

        Args:
            stamp_ns: Of torques of one epoch, rising, shape (N,), N >= 1. [ns]
        """
        line = self._line
        row = np.searchsorted(line.stamp_ns, stamp_ns, side="right") - 1
        refuted = self._before is not None
        if self._alone_ns is not None:
            alone = int(np.searchsorted(stamp_ns, self._alone_ns + ALONE_NS, side="right"))
            row[:alone] = 0
            if alone < len(stamp_ns):
                self._alone_ns = None
        elif self._before is not None:
            line, row = self._chosen(self._before, stamp_ns, row)
        if self._start_ns is None:
            self._start_ns = int(stamp_ns[0])
            first = self._first
            if first is not None and 0 <= self._start_ns - first.stamp_ns[0] <= HISTORY_NS:
                self._first = None  # it is of the same time
        if self._first is not None:
            line, row = self._begun(self._first, self._start_ns, stamp_ns, line, row, refuted)
        first, last = int(row.min()), int(row.max())
        if self._part[0] is not line or self._part[1:3] != (first, last):
            self._part = (line, first, last, line[slice(first, last + 1)])
        part = self._part[3]
        row -= first
        self._used = part if first == last else part[slice(int(row[-1]), int(row[-1]) + 1)]
        oldest_ns = int(stamp_ns[0]) - HISTORY_NS  # rows that ended before it are forgotten
        needed = int(np.searchsorted(self._line.stamp_ns, oldest_ns, side="right")) - 1
        if needed > 1:
            kept = [self._line[slice(0, 1)], self._line[slice(needed, None)]]
            self._line = FrictionBlock.concatenate(kept)
        return part, row

    def _begun(
        self, first: FrictionBlock, start: int, stamp_ns: Int, line: FrictionBlock, row: Int,
        refuted: bool,
    ) -> tuple[FrictionBlock, Int]:  # fmt: skip
        """Let the first row of all hold at the start, if its stamp is of another time."""
        own, until = int(first.stamp_ns[0]), start + SLOW_NS
        if int(stamp_ns[-1]) >= until:
            self._first = None
        ahead = own - start
        if not (abs(ahead) > HISTORY_NS or (refuted and ahead > 0)):
            return line, row
        chosen = line.stamp_ns[row]
        held = (stamp_ns < until) & ((chosen == 0) | (chosen == own))
        if not held.any():
            return line, row
        seen = np.where(first.temperature_stamp_ns > 0, start, 0)
        first = replace(first, stamp_ns=np.zeros(1, dtype=np.int64), temperature_stamp_ns=seen)
        return FrictionBlock.concatenate([first, line]), np.where(held, 0, row + 1)

    def next_ns(self, stamp_ns: int) -> int | None:
        """Return the stamp of the first row after a time; None if there is none. [ns]"""
        row = int(np.searchsorted(self._line.stamp_ns, stamp_ns, side="right"))
        return int(self._line.stamp_ns[row]) if row < len(self._line) else None

    def _chosen(self, before: FrictionBlock, stamp_ns: Int, row: Int) -> tuple[FrictionBlock, Int]:
        """Choose between the line that friction has left and the one it is on."""
        earlier = np.searchsorted(before.stamp_ns, stamp_ns, side="right") - 1
        reached, left = self._line.stamp_ns[row], before.stamp_ns[earlier]
        coming = before.stamp_ns[np.minimum(earlier + 1, len(before) - 1)]
        ended = (coming == left) | (coming - stamp_ns > HISTORY_NS)
        newer = (reached > left) | (coming == left)
        moved = (stamp_ns - left > ALONE_NS) & ended & newer
        if len(before) <= MAX_BEGINNING:
            moved |= (earlier == 0) & (reached > 0)
        if bool(moved.any()):  # from there on, its clock has jumped alone
            moved[int(np.argmax(moved)) :] = True
            self._before = None
        if not moved.any():
            return before, earlier
        if moved.all():
            return self._line, row
        whole = FrictionBlock.concatenate([before, self._line])
        return whole, np.where(moved, row + len(before), earlier)


class FallbackUse:
    """Counts the samples whose friction is that of the fallback temperature.

    Args:
        fallback_degc: The temperature used instead. [degC]

    Attributes:
        stale: Samples with a motor whose temperature is too old, and none missing.
        apart_ns: Stamp of the nearest temperature minus that of the last such sample; None
            if no temperature has come. [ns]
        silence_ns: Longest time that such a sample lay behind the last temperature of its
            motor. [ns]
    """

    def __init__(self, fallback_degc: float) -> None:
        self.samples = 0
        self.missing = 0
        self.stale = 0
        self.apart_ns: int | None = None
        self.silence_ns = 0
        self._fallback_degc = fallback_degc

    def note(
        self, stamp_ns: Int, temperature_degc: Float, seen_ns: Int, timeline: FrictionTimeline
    ) -> None:
        """Take samples of which one lacks a temperature; `samples` counts them already.

        Args:
            stamp_ns: Shape (N,), N >= 1. [ns]
            temperature_degc: In use, shape (N, n); NaN where the fallback is. [degC]
            seen_ns: Stamps of the temperatures known at the last sample, shape (n,); 0 where
                none is. [ns]
        """
        lacking = np.logical_or.reduce(np.isnan(temperature_degc), axis=1)
        count = int(lacking.sum())
        if bool((seen_ns > 0).all()):
            self.stale += count
        else:
            self.missing += count
        if not lacking[-1]:
            return
        now = int(stamp_ns[-1])
        known = seen_ns[seen_ns > 0]
        behind = int(known.max()) - now if len(known) else None
        coming = timeline.next_ns(now)
        ahead = None if coming is None else coming - now
        found = [each for each in (behind, ahead) if each is not None]
        self.apart_ns = min(found, key=abs) if found else None
        too_old = np.isnan(temperature_degc[-1]) & (seen_ns > 0)
        if too_old.any():
            self.silence_ns = max(self.silence_ns, now - int(seen_ns[too_old].min()))

    def of_another_time(self, ahead_ns: int | None) -> bool:
        """Return whether temperatures, so far ahead of torques [ns], are from another clock."""
        far = self.apart_ns is not None and abs(self.apart_ns) > APART_NS
        return far and ahead_ns is not None and abs(ahead_ns) > APART_NS

    def sentence(self, ahead_ns: int | None) -> str:
        """Return what a user should know of it; empty if every sample had its temperatures."""
        count = self.missing + self.stale
        if not count:
            return ""
        why = "missing" if not self.stale else "stale" if not self.missing else "missing or stale"
        text = (
            f"{count} of {self.samples} joint samples used the fallback temperature of "
            f"{self._fallback_degc:g} degC: a motor temperature was {why}"
        )
        if self.of_another_time(ahead_ns) and ahead_ns is not None:
            way = "ahead of" if ahead_ns > 0 else "behind"
            text += (
                f"; its stamps are {abs(ahead_ns) * NANOSECOND:.1f} s {way} those of the joint "
                "states: synchronise the clocks"
            )
        elif self.silence_ns:
            text += (
                f"; no new one for up to {self.silence_ns * NANOSECOND:.1f} s: check its driver "
                "or topic"
            )
        return text
