"""Time and trapezoids: which time was integrated, and what energy each interval carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_energy.physics.equations import interval_energy
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int, PowerBlock, differences
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
    """Cuts a stream of power samples into intervals and keeps the time."""

    time: Coverage = field(default_factory=Coverage)
    _last: tuple[int, int, Float] | None = None

    def step(self, stamp_ns: Int, segment: Int, power: Float) -> SampleIntervals:
        """Return the intervals that end at these samples, one a sample.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            power: Shape (N, R). An interval is a gap if a sample of it is not finite in all
                columns, or if its energy is more than a register can take. [W]
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
        """Return the intervals of samples whose energies are computed elsewhere, likewise.

        Args:
            stamp_ns: Shape (N,). [ns]
            segment: Shape (N,).
            first: Gives the powers at the first sample, shape (R,). [W]
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


@dataclass(frozen=True)
class HeldEnergies(Block):
    """Rows that have ended, with their integrals.

    Attributes:
        stamp_ns: Where each began, shape (M,). [ns]
        phase: At that sample, shape (M,).
        duration_ns: Integrated time, shape (M,). [ns]
        energy: Shape (M, K). [J]
    """

    phase: NDArray[np.uint8]
    duration_ns: Int
    energy: Float


class _Open(NamedTuple):
    """The row that has not ended: where it began, its phase, its time so far, its values."""

    stamp_ns: int
    phase: int
    duration_ns: int
    values: Float


class HeldIntegrator:
    """Integrates held rows over the observed time by trapezoids, from where each begins.

    A row is complete once the next one begins, so the cutting of the input makes no difference.
    """

    def __init__(self) -> None:
        self._open: _Open | None = None

    def step(self, block: PowerBlock, duration_ns: Int) -> HeldEnergies | None:
        """Return what becomes complete with these power samples, if anything.

        Args:
            duration_ns: Observed time up to each sample, shape (N,). [ns]
        """
        held, before = block.deviation, self._open
        starts = held.begins.nonzero()[0]
        if not len(starts):
            if before is not None:
                time = before.duration_ns + int(duration_ns.sum())
                self._open = before._replace(duration_ns=time)
            return None
        passed = np.cumsum(duration_ns)
        upto, last = passed[starts], int(starts[-1])
        stamp, phase = block.stamp_ns[starts], block.phase[starts]
        values = held.values[held.row[starts]]
        self._open = _Open(
            int(stamp[-1]), int(phase[-1]), int(passed[-1] - passed[last]), values[-1]
        )
        time = upto[1:] - upto[:-1]
        if before is not None:
            stamp = np.concatenate([[before.stamp_ns], stamp])
            phase = np.concatenate([np.array([before.phase], dtype=np.uint8), phase])
            time = np.concatenate([[before.duration_ns + upto[0]], time])
            values = np.concatenate([before.values[None], values])
        if len(stamp) == 1:
            return None
        energy = (values[1:] + values[:-1]) * (time * (0.5 * NANOSECOND))[:, None]
        np.clip(energy, -MAX_ENERGY, MAX_ENERGY, out=energy)
        return HeldEnergies(stamp[:-1], phase[:-1], time, energy)

    @property
    def open_ns(self) -> int:
        """Where the row began that is not complete, after the first sample. [ns]"""
        return 0 if self._open is None else self._open.stamp_ns

    @property
    def open_energy(self) -> Float | float:
        """Its integral so far, shape (K,). [J]"""
        row = self._open
        return 0.0 if row is None else row.values * (row.duration_ns * NANOSECOND)

    def interrupt(self) -> None:
        """Drop the row that is not complete."""
        self._open = None
