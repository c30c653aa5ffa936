"""How much of the time was integrated: ``span = observed + gap``, exact in ns.

A step of the stamps that is longer than ``MAX_GAP_NS`` is not a gap: the clock was set, as
after a start in 1970, and how much time has passed is unknown. It is a jump, forward instead
of backward, and no time passes across it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.timeline.blocks import Int

MAX_GAP_NS = 90 * 86_400 * 10**9  # a longer step between two samples is one of the clock [ns]


@dataclass
class Coverage:
    """How much of a recording was integrated, exact in ns.

    Attributes:
        observed_ns: Time between finite samples of one segment. [ns]
        gap_ns: Time between samples that could not be integrated. [ns]
        jumps: Number of jumps of the stamps, backward or forward by more than
            ``MAX_GAP_NS``; no time passes across one.
        in_gap: Whether the last sample ended a gap, which may go on.
    """

    observed_ns: int = 0
    gap_ns: int = 0
    gap_count: int = 0
    jumps: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    in_gap: bool = field(default=False, compare=False, repr=False)

    def take(self, elapsed: Int, observed: NDArray[np.bool_]) -> None:
        """Count the time between samples.

        Args:
            elapsed: From the sample before to each sample, shape (N,), N >= 1. [ns]
            observed: Whether that time was integrated, shape (N,).
        """
        if observed.all():
            self.count(_total(elapsed), 0, 0, 0)
            self.in_gap = False
            return
        jump = (elapsed < 0) | (elapsed > MAX_GAP_NS)
        missing = ~observed & ~jump & (elapsed > 0)
        begins = missing & ~np.concatenate([[self.in_gap], missing[:-1]])
        self.count(
            _total(elapsed[observed]), _total(elapsed[missing]), int(begins.sum()), int(jump.sum())
        )
        self.in_gap = bool(missing[-1])

    def precede(self, earlier: Coverage) -> None:
        """Put an earlier account before this one; what lies between is a gap, or a jump."""
        between = 0
        if earlier.end_ns is not None and self.start_ns is not None:
            between = self.start_ns - earlier.end_ns
        gap_ns = between if 0 < between <= MAX_GAP_NS else 0
        self.count(
            earlier.observed_ns,
            earlier.gap_ns + gap_ns,
            earlier.gap_count + (gap_ns > 0),
            earlier.jumps + (between != gap_ns),
        )
        if earlier.start_ns is not None:
            self.start_ns = earlier.start_ns
        if self.end_ns is None:
            self.end_ns = earlier.end_ns

    def surround(self, before_ns: int, after_ns: int) -> None:
        """Count time at both ends of which no sample could be used as gaps."""
        for time_ns in (before_ns, after_ns):
            self.count(0, time_ns, int(time_ns > 0), 0)
        if self.start_ns is not None and self.end_ns is not None:
            self.start_ns, self.end_ns = self.start_ns - before_ns, self.end_ns + after_ns

    def count(self, observed_ns: int, gap_ns: int, gap_count: int, jumps: int) -> None:
        """Count on; a counter that is full stays so."""
        self.observed_ns = min(self.observed_ns + observed_ns, MAX_COUNTER)
        self.gap_ns = min(self.gap_ns + gap_ns, MAX_COUNTER)
        self.gap_count = min(self.gap_count + gap_count, MAX_COUNTER)
        self.jumps = min(self.jumps + jumps, MAX_COUNTER)

    @property
    def span_ns(self) -> int:
        """Time from first to last sample, without jumps. [ns]"""
        return self.observed_ns + self.gap_ns

    @property
    def coverage(self) -> float:
        """Observed share of the span; NaN before the second sample. [-]"""
        return self.observed_ns / self.span_ns if self.span_ns else float("nan")


def _total(durations: Int) -> int:
    """Sum of durations, each at most ``MAX_GAP_NS``, exact. [ns]"""
    if len(durations) and len(durations) * int(durations.max()) > MAX_COUNTER:
        return sum(durations.tolist())
    return int(durations.sum())
