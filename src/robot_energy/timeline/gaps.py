"""Order of stamps: duplicates, late samples, gaps and new epochs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Int, differences

SECOND_NS = 1_000_000_000
BACKWARD_JUMP_NS = SECOND_NS  # older than this starts a new epoch, less is a late sample
HISTORY = 31  # periods behind the median
GAP_PERIODS = 5
LEAST_GAP_NS = SECOND_NS // 10
LONGEST_GAP_NS = SECOND_NS

ACCEPTED, DUPLICATE, OLDER = 0, 1, 2


class StampOrder:
    """Sorts samples of one stream into accepted, duplicate and older, and finds gaps.

    A stamp that is not newer than the last accepted one is dropped, unless it lies more
    than a second back: then a new epoch starts (bag loop, reset of a simulation). A
    segment ends at every new epoch and at every gap, that is where the stamps step by
    more than five median periods, but at least 0.1 s and at most 1 s.

    Attributes:
        jumps: Backward jumps met.
        gaps: Gaps met.
        segment: Number of the running segment.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self.gaps = 0
        self.segment = 0
        self._last: int | None = None
        self._interrupted = False
        self._periods: Int = np.empty(0, dtype=np.int64)

    @property
    def longest_gap_ns(self) -> int:
        """Longest time between two samples that would not be a gap now. [ns]"""
        return self._longest(self._periods)

    def verdict(self, stamp_ns: Int) -> Int:
        """Judge samples in order of arrival; accepted ones advance the state.

        Args:
            stamp_ns: Shape (N,). [ns]

        Returns:
            ``ACCEPTED``, ``DUPLICATE`` or ``OLDER`` for each sample.
        """
        verdict = np.zeros(len(stamp_ns), dtype=np.int64)
        if not len(stamp_ns):
            return verdict
        first_is_newer = self._last is None or stamp_ns[0] > self._last
        if first_is_newer and bool((np.diff(stamp_ns) > 0).all()):
            return verdict
        last = self._last
        for row, stamp in enumerate(stamp_ns.tolist()):
            if last is not None and last - BACKWARD_JUMP_NS < stamp <= last:
                verdict[row] = DUPLICATE if stamp == last else OLDER
                continue
            last = stamp
        return verdict

    def interrupt(self) -> None:
        """End the running segment here: what comes next follows a gap, however short."""
        self._interrupted = self._last is not None

    def segments(self, stamp_ns: Int, broken: NDArray[np.bool_] | None = None) -> Int:
        """Number the segments of accepted samples and remember where they ended.

        Args:
            stamp_ns: Accepted stamps, shape (N,). [ns]
            broken: Samples before which something is missing, whatever the stamps say,
                shape (N,); None for none.

        Returns:
            Segment number of each sample, shape (N,).
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
        for row in np.flatnonzero(elapsed > LEAST_GAP_NS).tolist():
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

    @staticmethod
    def _longest(history: Int) -> int:
        positive = history[history > 0]
        if not len(positive):
            return LONGEST_GAP_NS
        median = float(np.median(positive))
        return int(np.clip(GAP_PERIODS * median, LEAST_GAP_NS, LONGEST_GAP_NS))
