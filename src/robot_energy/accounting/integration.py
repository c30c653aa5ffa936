"""Time and trapezoids: which time was integrated, and what energy each interval carries.

Time is counted in ns: ``span = observed + gap``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Float, Int, differences


@dataclass
class Timekeeping:
    """How much of a recording was integrated, exact in ns.

    Attributes:
        observed_ns: Time between finite samples of one segment. [ns]
        gap_ns: Time between samples that could not be integrated. [ns]
        gap_count: Number of gaps.
        jumps: Number of backward jumps of the stamps; no time passes across one.
        start_ns: First stamp. [ns]
        end_ns: Last stamp. [ns]
    """

    observed_ns: int = 0
    gap_ns: int = 0
    gap_count: int = 0
    jumps: int = 0
    start_ns: int | None = None
    end_ns: int | None = None

    def precede(self, earlier: Timekeeping) -> None:
        """Put an earlier account before this one; what lies between them is a gap.

        Args:
            earlier: Ends no later than this one starts.
        """
        between = 0
        if earlier.end_ns is not None and self.start_ns is not None:
            between = self.start_ns - earlier.end_ns
        self.observed_ns += earlier.observed_ns
        self.gap_ns += earlier.gap_ns + between
        self.gap_count += earlier.gap_count + (between > 0)
        self.jumps += earlier.jumps
        if earlier.start_ns is not None:
            self.start_ns = earlier.start_ns
        if self.end_ns is None:
            self.end_ns = earlier.end_ns

    @property
    def span_ns(self) -> int:
        """Time from first to last sample, without backward jumps. [ns]"""
        return self.observed_ns + self.gap_ns

    @property
    def coverage(self) -> float:
        """Observed share of the span; NaN before the second sample. [-]"""
        return self.observed_ns / self.span_ns if self.span_ns else float("nan")


PIECE = 512  # samples worked on at a time
LARGEST_ENERGY = 2e6  # of one interval, which sums exactly [J]
NO_SEGMENT = -1  # segments count from zero: nothing is integrated from this one


@dataclass(frozen=True)
class Intervals:
    """The intervals that end at the samples of a block.

    Attributes:
        duration_ns: Shape (N,); 0 where the interval is a gap or a jump. [ns]
        energy: Energy of each interval, 0 across gaps, shape (N, R). [J]
    """

    duration_ns: Int
    energy: Float


@dataclass
class Trapezoid:
    """Cuts a stream of power samples into intervals and keeps the time.

    Attributes:
        time: Running account of observed and missing time.
    """

    time: Timekeeping = field(default_factory=Timekeeping)
    _last: tuple[int, int, Float] | None = None
    _in_gap: bool = False

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are gaps
    def step(self, stamp_ns: Int, segment: Int, power: Float) -> Intervals:
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
        observed = same & (elapsed >= 0)
        half = (np.where(observed, elapsed, 0) * (0.5 * NANOSECOND))[:, None]
        energy = np.empty_like(power)
        np.add(power[0], self._last[2], out=energy[0])
        bounded = True
        for start in range(0, len(power), PIECE):  # small enough for the cache
            end, first = min(start + PIECE, len(power)), max(start, 1)
            np.add(power[first:end], power[first - 1 : end - 1], out=energy[first:end])
            piece = energy[start:end]
            piece *= half[start:end]
            bounded &= bool(piece.max() <= LARGEST_ENERGY and piece.min() >= -LARGEST_ENERGY)
        if not bounded:
            bookable = (np.abs(energy) <= LARGEST_ENERGY).all(axis=1)
            energy[~bookable] = 0.0
            observed &= bookable
        duration_ns = np.where(observed, elapsed, 0)
        self._account(elapsed, observed)
        self._last = (int(stamp_ns[-1]), int(segment[-1]), power[-1].copy())
        self.time.end_ns = int(stamp_ns[-1])
        return Intervals(duration_ns, energy)

    def reset(self) -> None:
        """Begin the account at the last sample, with nothing counted."""
        self.time = Timekeeping(start_ns=self.time.end_ns, end_ns=self.time.end_ns)
        self._in_gap = False

    def interrupt(self) -> None:
        """Let the time from the last to the next sample be a gap of its own, or a jump."""
        if self.time.end_ns is not None:
            self._last = (self.time.end_ns, NO_SEGMENT, np.full(1, np.nan))
            self._in_gap = False

    def _account(self, elapsed: Int, observed: NDArray[np.bool_]) -> None:
        time = self.time
        backward = elapsed < 0
        missing = ~observed & (elapsed > 0)
        time.observed_ns += int(elapsed[observed].sum())
        time.gap_ns += int(elapsed[missing].sum())
        time.jumps += int(backward.sum())
        begins = missing & ~np.concatenate([[self._in_gap], missing[:-1]])
        time.gap_count += int(begins.sum())
        self._in_gap = bool(missing[-1])
