"""Time and trapezoids: which time was integrated, and what energy each interval carries.

Time is counted in ns: ``span = observed + gap``. A step of the stamps that is longer than
``MAX_GAP_NS`` is no gap: somebody has set the clock, as after a start in 1970, and nobody
knows how much time has passed. It is a jump, forward instead of backward, and no time
passes across it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.exact_sum import MAX_COUNTER
from robot_energy.blocks import NANOSECOND, Float, Int, differences
from robot_energy.physics.equations import interval_energy

MAX_GAP_NS = 90 * 86_400 * 10**9  # a longer step between two samples is one of the clock [ns]


@dataclass
class Coverage:
    """How much of a recording was integrated, exact in ns.

    Attributes:
        observed_ns: Time between finite samples of one segment. [ns]
        gap_ns: Time between samples that could not be integrated. [ns]
        gap_count: Number of gaps.
        jumps: Number of jumps of the stamps, backward or forward by more than
            ``MAX_GAP_NS``; no time passes across one.
        start_ns: First stamp. [ns]
        end_ns: Last stamp. [ns]
    """

    observed_ns: int = 0
    gap_ns: int = 0
    gap_count: int = 0
    jumps: int = 0
    start_ns: int | None = None
    end_ns: int | None = None

    def precede(self, earlier: Coverage) -> None:
        """Put an earlier account before this one; what lies between is a gap, or a jump.

        Args:
            earlier: Ends no later than this one starts.
        """
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

    def count(self, observed_ns: int, gap_ns: int, gap_count: int, jumps: int) -> None:
        """Count on; a counter that is full stays so. [ns] [ns]"""
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


LARGEST_ENERGY = 2e6  # of one interval, which sums exactly [J]
NO_SEGMENT = -1  # segments count from zero: nothing is integrated from this one


@dataclass(frozen=True)
class SampleIntervals:
    """The intervals that end at the samples of a block.

    Attributes:
        duration_ns: Shape (N,); 0 where the interval is a gap or a jump. [ns]
        energy: Energy of each interval, 0 across gaps, shape (N, R). [J]
    """

    duration_ns: Int
    energy: Float


@dataclass
class TrapezoidIntegrator:
    """Cuts a stream of power samples into intervals and keeps the time.

    Attributes:
        time: Running account of observed and missing time.
    """

    time: Coverage = field(default_factory=Coverage)
    _last: tuple[int, int, Float] | None = None
    _in_gap: bool = False

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are gaps
    def step(self, stamp_ns: Int, segment: Int, power: Float) -> SampleIntervals:
        """Take samples and return the intervals that end at them.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            power: Shape (N, R). An interval is a gap if a sample of it is not finite in all
                columns, or if its energy is more than a register can take. [W]

        Returns:
            One interval per sample.
        """
        if self._last is None:
            self._last = (int(stamp_ns[0]), int(segment[0]), power[0].copy())
            self.time.start_ns = int(stamp_ns[0])
        elapsed = differences(stamp_ns, self._last[0])
        same = differences(segment, self._last[1]) == 0
        observed = same & (elapsed >= 0) & (elapsed <= MAX_GAP_NS)
        duration = np.where(observed, elapsed, 0) * NANOSECOND
        energy, greatest = interval_energy(power, self._last[2], duration)
        if not greatest <= LARGEST_ENERGY:
            bookable = (np.abs(energy) <= LARGEST_ENERGY).all(axis=1)
            energy[~bookable] = 0.0
            observed &= bookable
        duration_ns = np.where(observed, elapsed, 0)
        self._account(elapsed, observed)
        self._last = (int(stamp_ns[-1]), int(segment[-1]), power[-1].copy())
        self.time.end_ns = int(stamp_ns[-1])
        return SampleIntervals(duration_ns, energy)

    def reset(self) -> None:
        """Begin the account at the last sample, with nothing counted."""
        self.time = Coverage(start_ns=self.time.end_ns, end_ns=self.time.end_ns)
        self._in_gap = False

    def interrupt(self) -> None:
        """Let the time from the last to the next sample be a gap of its own, or a jump."""
        if self.time.end_ns is not None:
            self._last = (self.time.end_ns, NO_SEGMENT, np.full(1, np.nan))
            self._in_gap = False

    def _account(self, elapsed: Int, observed: NDArray[np.bool_]) -> None:
        jump = (elapsed < 0) | (elapsed > MAX_GAP_NS)
        missing = ~observed & ~jump & (elapsed > 0)
        begins = missing & ~np.concatenate([[self._in_gap], missing[:-1]])
        self.time.count(
            _total(elapsed[observed]), _total(elapsed[missing]), int(begins.sum()), int(jump.sum())
        )
        self._in_gap = bool(missing[-1])


def _total(durations: Int) -> int:
    """Sum of durations, each at most ``MAX_GAP_NS``, exact. [ns]"""
    if len(durations) and len(durations) * int(durations.max()) > MAX_COUNTER:
        return sum(durations.tolist())
    return int(durations.sum())
