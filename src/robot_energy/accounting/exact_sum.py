"""Sums of energies that lose nothing: integer microjoules with the remainder carried.

Samples are counted by quality and phase. What is summed and counted does not depend on the cutting
of the input, so short blocks wait until a sum is read, or until they are worth a pass.

A remainder counts units of 2^-40 microjoule. Integer sums do not depend on how the input
is cut into blocks, and a year at 1 kHz loses nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from math import isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import MAX_COUNTER, SECOND_NS
from robot_energy.physics import kernels
from robot_energy.physics.equations import CACHED
from robot_energy.timeline.blocks import Float, Int, Phase, PowerBlock, Quality

PER_JOULE = 1e6  # microjoules
REMAINDER_BITS = 40  # the remainder counts units of 2^-40 microjoule
REMAINDER_MASK = (1 << REMAINDER_BITS) - 1
BLOCK = 1 << 12  # rows whose sums, of 2 MJ each, are exact in a float
NEAR_FULL = MAX_COUNTER - (1 << 60)  # beyond, rows are added one by one [uJ]
SETTLED = 512  # rows that wait to be added together: few calls for each of many short blocks
ROUND_WHOLE = 1.5 * 2.0**52  # adding and subtracting this rounds to an integer,
ROUND_REMAINDER = 1.5 * 2.0 ** (52 - REMAINDER_BITS)  # and this to the remainder's unit

Undo = Callable[[], None]  # lets counters stand as they did
MIN_STANDBY = 60.0  # at rest, from which on it is standby [s]


def add_saturating(total: Int, more: Int) -> None:
    """Add integers in place; a sum beyond ``MAX_COUNTER``, either way, stays there.

    Args:
        total: What is added to, shape (N,).
        more: Same shape, or a single value.
    """
    wrapped = total + more
    full = ((total ^ wrapped) & (np.asarray(more) ^ wrapped)) < 0
    limit = np.where(total < 0, -MAX_COUNTER, MAX_COUNTER)
    np.maximum(np.where(full, limit, wrapped), -MAX_COUNTER, out=total)


class ExactSum:
    """Sums of energies, exact in integers, that never pass ``MAX_COUNTER``.

    Attributes:
        nearly_full: Whether a sum is so near its end that energies must be added one by one.
    """

    def __init__(self, size: int) -> None:
        self._microjoule: Int = np.zeros(size, dtype=np.int64)  # replaced, never changed
        self._remainder: Int = np.zeros(size, dtype=np.int64)
        self.nearly_full = False
        self._waiting: tuple[tuple[int, Float], ...] = ()  # not added yet, by first column
        self._rows = 0  # of them
        self._scratch: Float = np.empty((2, 0))

    @property
    def microjoule(self) -> Int:
        """Whole microjoules, shape (size,), not to be written to. [uJ]"""
        self._settle()
        return self._microjoule

    @property
    def remainder(self) -> Int:
        """What is left, 0 to 2^40 - 1, shape (size,), not to be written to. [2^-40 uJ]"""
        self._settle()
        return self._remainder

    def mark(self) -> Undo:
        """Return what drops all that is added from now on."""
        return partial(
            vars(self).update,
            _microjoule=self._microjoule,
            _remainder=self._remainder,
            nearly_full=self.nearly_full,
            _waiting=self._waiting,
            _rows=self._rows,
        )

    def add(self, energy: Float, first: int = 0) -> None:
        """Add the energies of intervals.

        Whole microjoules and remainders are rounded to multiples of their units, whose
        sums are exact in floats as well, whatever the order. So a few rows may wait for others.

        Args:
            energy: Finite, below 2 MJ each, not written to afterwards, shape (N, R). [J]
        """
        self._waiting = (*self._waiting, (first, energy))
        self._rows += len(energy)
        if self._rows >= SETTLED:
            self._settle()

    def add_counted(self, microjoule: Int, remainder: Int, energy: Float) -> None:
        """Add energies whose sums a kernel has made.

        Args:
            microjoule: Whole microjoules of the first R registers, shape (R,). [uJ]
            remainder: What is beyond them, shape (R,). [2^-40 uJ]
            energy: As `add` takes them, for a counter that is `nearly_full`, shape (N, R). [J]
        """
        if self.nearly_full:
            self.add(energy)
            return
        more, rest = np.zeros_like(self._microjoule), self._remainder.copy()
        more[: len(microjoule)] = microjoule
        rest[: len(remainder)] += remainder
        self._carry(more, rest, False)

    def _settle(self) -> None:
        """Add what waits."""
        if not self._waiting:
            return
        waiting, self._waiting, self._rows = self._waiting, (), 0
        for first in dict.fromkeys(first for first, _ in waiting):
            parts = [energy for column, energy in waiting if column == first]
            self._add(parts[0] if len(parts) == 1 else np.concatenate(parts), first)

    def _add(self, energy: Float, begin: int) -> None:
        """Add energies to the registers from one on."""
        end = begin + energy.shape[1]
        start = 0
        while start < len(energy):
            full = self.nearly_full
            part = energy[start : start + (1 if full else BLOCK)]  # cutting makes no difference
            start += len(part)
            more, remainder = np.zeros_like(self._microjoule), self._remainder.copy()
            if kernels.compiled is not None:
                kernels.compiled.add_exactly(part, more[begin:end], remainder[begin:end])
                self._carry(more, remainder, full)
                continue
            size = max(1, CACHED // len(part))
            for first in range(begin, end, size):
                columns = slice(first, min(first + size, end))
                given = part[:, first - begin : columns.stop - begin].T
                more[columns] = self._whole(given, remainder[columns])
            self._carry(more, remainder, full)

    def _whole(self, energy: Float, remainder: Int) -> Int:
        """Add the remainders of energies, shape (R, N), in place; return the whole parts. [uJ]"""
        if energy.size > self._scratch.shape[1]:
            self._scratch = np.empty((2, energy.size))
        whole, rest = (room[: energy.size].reshape(energy.shape) for room in self._scratch)
        np.multiply(energy, PER_JOULE, out=rest)
        np.add(rest, ROUND_WHOLE, out=whole)
        whole -= ROUND_WHOLE
        rest -= whole
        rest += ROUND_REMAINDER
        rest -= ROUND_REMAINDER
        ones = np.ones(energy.shape[1])
        remainder += (rest @ ones * 2.0**REMAINDER_BITS).astype(np.int64)
        return (whole @ ones).astype(np.int64)

    def add_sums(self, microjoule: Int, remainder: Int) -> None:
        """Add sums that were made elsewhere, such as those of a state file.

        Args:
            microjoule: Whole microjoules of each sum, shape (size,). [uJ]
            remainder: What each holds beyond them, shape (size,). [2^-40 uJ]
        """
        self._carry(microjoule, self.remainder + remainder, True)

    def reset(self) -> None:
        """Begin at zero; the remainder stays, so that nothing is lost in between."""
        self._microjoule, self.nearly_full = np.zeros_like(self.microjoule), False

    def _carry(self, microjoule: Int, remainder: Int, full: bool) -> None:
        """Add microjoules, and those that the remainders have grown to.

        Args:
            microjoule: To be added, shape (size,). [uJ]
            remainder: In place of those before, any size, shape (size,). [2^-40 uJ]
            full: Whether a counter may be near its end.
        """
        carried = remainder >> REMAINDER_BITS
        if full:
            total = self._microjoule.copy()
            add_saturating(total, microjoule)
            add_saturating(total, carried)
        else:
            total = self._microjoule + (microjoule + carried)
        self._microjoule, self._remainder = total, remainder & REMAINDER_MASK
        self.nearly_full = bool((np.abs(total) > NEAR_FULL).any())

    @property
    def joule(self) -> Float:
        """The sums, shape (size,). [J]"""
        return self.microjoule / PER_JOULE


class Standby:
    """Counts energy and time of every rest that has lasted `MIN_STANDBY`, from its beginning."""

    def __init__(self) -> None:
        self.energy = ExactSum(1)
        self.ns = 0  # time in standby [ns]
        self.rested_ns = 0  # time at rest, however long each rest is [ns]
        self.rest = ExactSum(1)  # of a rest that is not standby yet
        self._rest_ns = 0
        self._resting = False  # at the last sample

    def step(self, resting: NDArray[np.bool_], energy: Float, duration_ns: Int) -> None:
        """Take samples.

        Args:
            resting: Whether the robot rests at each sample, shape (N,), N >= 1.
            energy: Drawn from the grid up to each sample, shape (N,). [J]
            duration_ns: Observed time up to each sample; 0 ends a rest, shape (N,). [ns]
        """
        rest = np.empty(len(resting), dtype=bool)
        rest[0], rest[1:] = self._resting, resting[:-1]
        rest &= duration_ns > 0
        self._resting = bool(resting[-1])
        cuts = (np.flatnonzero(rest[1:] != rest[:-1]) + 1).tolist()
        for start, stop in zip([0, *cuts], [*cuts, len(rest)], strict=True):
            if rest[start]:
                self._add(energy[start:stop, None], int(duration_ns[start:stop].sum()))
            else:
                self.rest, self._rest_ns = ExactSum(1), 0

    def _add(self, energy: Float, ns: int) -> None:
        counted = self._rest_ns >= MIN_STANDBY * SECOND_NS
        self._rest_ns += ns
        self.rested_ns += ns
        if counted:
            self.energy.add(energy)
            self.ns = min(self.ns + ns, MAX_COUNTER)
            return
        self.rest.add(energy)
        if self._rest_ns >= MIN_STANDBY * SECOND_NS:
            self.energy.add_sums(self.rest.microjoule, self.rest.remainder)
            self.ns = min(self.ns + self._rest_ns, MAX_COUNTER)

    def add(self, ns: int, microjoule: int, remainder: int) -> None:
        """Add what was counted elsewhere, with a remainder [2^-40 uJ]."""
        self.energy.add_sums(np.array([microjoule]), np.array([remainder]))
        self.ns = min(self.ns + ns, MAX_COUNTER)

    def reset(self) -> None:
        """Begin at zero; a rest that is not standby yet begins, too."""
        self.energy.reset()
        self.ns = self.rested_ns = 0
        if self._rest_ns < MIN_STANDBY * SECOND_NS:
            self.rest, self._rest_ns = ExactSum(1), 0


BITS = tuple(int(bit) for bit in Quality)


class SampleCounts:
    """Counts power samples; one that is full stays so.

    Args:
        floor: Speed below which a motor rests, shape (n,); None: where it holds. [rad/s]
    """

    def __init__(self, floor: Float | None = None) -> None:
        self._floor = floor
        self._phase_energy, self._learned_energy = ExactSum(len(Phase)), ExactSum(1)
        self._standby = Standby()
        self._begin()

    def reset(self) -> None:
        """Begin at zero; the remainders of energies stay."""
        self._settle()
        self._begin()

    def _begin(self) -> None:
        self._waiting: tuple[tuple[PowerBlock, Float, Int], ...] = ()
        self._rows = 0
        self._samples = 0
        self._peak_power = nan
        self._quality: Counter[int] = Counter()  # replaced, never changed, as what follows
        self._phase_ns: Int = np.zeros(len(Phase), dtype=np.int64)
        self._phase_energy.reset()
        self._learned_energy.reset()
        self._standby.reset()

    @property
    def samples(self) -> int:
        """Number of power samples taken."""
        return min(self._samples + self._rows, MAX_COUNTER)

    @property
    def peak_power(self) -> float:
        """Highest predicted grid power, NaN before the first finite sample. [W]"""
        self._settle()
        return self._peak_power

    @property
    def quality(self) -> Counter[int]:
        """How many samples carried each quality bit, not to be written to."""
        self._settle()
        return self._quality

    @property
    def phase_ns(self) -> Int:
        """Observed time by phase, shape (phases,), not to be written to. [ns]"""
        self._settle()
        return self._phase_ns

    @property
    def phase_energy_sum(self) -> ExactSum:
        """Energy drawn from the grid by phase, exact."""
        self._settle()
        return self._phase_energy

    @property
    def learned_energy_sum(self) -> ExactSum:
        """Drawn from the grid as predicted with learned figures, exact."""
        self._settle()
        return self._learned_energy

    @property
    def standby(self) -> Standby:
        """Energy and time in standby."""
        self._settle()
        return self._standby

    def count(self, block: PowerBlock, energy: Float, duration_ns: Int) -> None:
        """Count samples.

        Args:
            energy: Drawn from the grid up to each sample, not written to afterwards, shape
                (N,). [J]
            duration_ns: Observed time up to each sample, likewise, shape (N,). [ns]
        """
        self._waiting = (*self._waiting, (block, energy, duration_ns))
        self._rows += len(block)
        if self._rows >= SETTLED:
            self._settle()

    def mark(self) -> list[Undo]:
        """Return what drops all that is counted from now on."""
        standby = self._standby
        sums = self._phase_energy, self._learned_energy, standby.energy, standby.rest
        return [
            partial(vars(self).update, vars(self).copy()),
            partial(vars(standby).update, vars(standby).copy()),
            *map(ExactSum.mark, sums),
        ]

    def add(
        self, samples: int, peak_power: float, quality: Mapping[int, int], phase_ns: Int
    ) -> None:
        """Add what was counted elsewhere, but for the energies.

        Args:
            peak_power: NaN for none. [W]
            phase_ns: Observed time by phase, shape (phases,). [ns]
        """
        self._settle()
        self._samples = min(self._samples + samples, MAX_COUNTER)
        if not isnan(peak_power):
            seen = self._peak_power
            self._peak_power = peak_power if isnan(seen) else max(seen, peak_power)
        self._quality = self._quality + Counter(quality)  # without those that are zero
        total = self._phase_ns.copy()
        add_saturating(total, phase_ns)
        self._phase_ns = total

    def _settle(self) -> None:
        """Count what waits."""
        if not self._waiting:
            return
        waiting, rows, self._waiting, self._rows = self._waiting, self._rows, (), 0
        quality, phase, power, energy, duration_ns = (
            each[0] if len(each) == 1 else np.concatenate(each)
            for each in zip(
                *((b.quality, b.phase, b.grid_power, joule, ns) for b, joule, ns in waiting),
                strict=True,
            )
        )
        met = int(np.bitwise_or.reduce(quality))
        found = {bit: int(((quality & np.uint32(bit)) > 0).sum()) for bit in BITS if met & bit}
        if self._floor is None:
            resting = phase == Phase.HOLD
        else:
            slow = [(np.abs(b.motor_velocity) <= self._floor).all(axis=1) for b, _, _ in waiting]
            resting = slow[0] if len(slow) == 1 else np.concatenate(slow)
        self._standby.step(np.asarray(resting, np.bool_), energy, duration_ns)
        split = np.zeros((rows, len(Phase)), order="F")
        split[np.arange(rows), phase] = energy
        self._phase_energy.add(split)
        if met & Quality.LEARNED:
            learned = quality & np.uint32(Quality.LEARNED) > 0
            self._learned_energy.add(np.where(learned, energy, 0.0)[:, None])
        durations = np.bincount(phase, weights=duration_ns, minlength=len(Phase))
        self.add(rows, greatest(power), found, durations.astype(np.int64))


def greatest(power: Float) -> float:
    """Return the greatest finite power; NaN if there is none. [W]

    Args:
        power: Shape (N,), N >= 1. [W]
    """
    peak = float(power.max())
    if isfinite(peak):
        return peak
    finite = power[np.isfinite(power)]
    return float(finite.max()) if len(finite) else nan
