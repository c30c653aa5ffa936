"""Time and trapezoids: which time was integrated, and what energy each interval carries.

Which time counts says `Coverage`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, differences
from robot_energy.physics.equations import interval_energy
from robot_energy.timeline.coverage import MAX_GAP_NS, Coverage

MAX_ENERGY = 2e6  # of one interval, which sums exactly [J]
Energies = Callable[[Float, Float], tuple[Float, float, Float]]
"""Powers at the sample before, shape (R,) [W], and times of the intervals, shape (N,) [s] ->
energies, shape (N, R) [J], the greatest amount, NaN if one is NaN [J], and the last powers [W]."""
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
        return self.integrate(
            stamp_ns,
            segment,
            lambda: power[0].copy(),
            lambda before, duration: (
                *interval_energy(power, before, duration),
                power[-1].copy(),
            ),
        )

    @np.errstate(invalid="ignore", over="ignore")  # bad samples are gaps
    def integrate(
        self, stamp_ns: Int, segment: Int, first: Callable[[], Float], energies: Energies
    ) -> SampleIntervals:
        """Take samples whose energies are computed elsewhere, likewise.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            first: Gives the powers at the first sample, shape (R,). [W]
            energies: Computes the energies.

        Returns:
            One interval per sample.
        """
        if self._last is None:
            self._last = (int(stamp_ns[0]), int(segment[0]), first())
            self.time.start_ns = int(stamp_ns[0])
        elapsed = differences(stamp_ns, self._last[0])
        same = differences(segment, self._last[1]) == 0
        observed = same & (elapsed >= 0) & (elapsed <= MAX_GAP_NS)
        duration = np.where(observed, elapsed, 0) * NANOSECOND
        energy, greatest, last = energies(self._last[2], duration)
        if not greatest <= MAX_ENERGY:
            countable = (np.abs(energy) <= MAX_ENERGY).all(axis=1)
            energy[~countable] = 0.0
            observed &= countable
        duration_ns = np.where(observed, elapsed, 0)
        self.time.take(elapsed, observed)
        self._last = (int(stamp_ns[-1]), int(segment[-1]), last)
        self.time.end_ns = int(stamp_ns[-1])
        return SampleIntervals(duration_ns, energy)

    def reset(self) -> None:
        """Begin the account at the last sample, with nothing counted."""
        self.time = Coverage(start_ns=self.time.end_ns, end_ns=self.time.end_ns)

    def interrupt(self) -> None:
        """Let the time from the last to the next sample be a gap of its own, or a jump."""
        self.time.in_gap = False
        if self.time.end_ns is None:
            self._last = None
        else:
            self._last = (self.time.end_ns, NO_SEGMENT, np.full(1, np.nan))
