"""Sums of energies that lose nothing: integer microjoules with the remainder carried.

A remainder counts units of 2^-40 microjoule. Integer sums do not depend on how the input
is cut into blocks, and a year at 1 kHz loses nothing.
"""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.physics import kernels
from robot_energy.physics.equations import CACHED
from robot_energy.timeline.blocks import Float, Int

PER_JOULE = 1e6  # microjoules
REMAINDER_BITS = 40  # the remainder counts units of 2^-40 microjoule
REMAINDER_MASK = (1 << REMAINDER_BITS) - 1
BLOCK = 1 << 12  # rows whose sums, of 2 MJ each, are exact in a float
NEAR_FULL = MAX_COUNTER - (1 << 60)  # beyond, rows are added one by one [uJ]
SETTLED = 512  # rows that wait to be added together: few calls for each of many short blocks
ROUND_WHOLE = 1.5 * 2.0**52  # adding and subtracting this rounds to an integer,
ROUND_REMAINDER = 1.5 * 2.0 ** (52 - REMAINDER_BITS)  # and this to the remainder's unit

SumMark = tuple[Int, Int, tuple[tuple[int, Float], ...], int]
"""Where sums stand: microjoules, remainders, energies that wait by first column, their rows."""


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
    """Sums of energies, exact in integers, that never pass ``MAX_COUNTER``."""

    def __init__(self, size: int) -> None:
        self._microjoule: Int = np.zeros(size, dtype=np.int64)  # replaced, never changed
        self._remainder: Int = np.zeros(size, dtype=np.int64)
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

    @property
    def nearly_full(self) -> bool:
        """Whether a sum is so near its end that energies must be added one by one."""
        return bool((np.abs(self._microjoule) > NEAR_FULL).any())

    def mark(self) -> SumMark:
        """Return where the sums stand, for `go_back`."""
        return self._microjoule, self._remainder, self._waiting, self._rows

    def go_back(self, mark: SumMark) -> None:
        """Drop what was added since."""
        self._microjoule, self._remainder, self._waiting, self._rows = mark

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
        self._microjoule = np.zeros_like(self.microjoule)

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

    @property
    def joule(self) -> Float:
        """The sums, shape (size,). [J]"""
        return self.microjoule / PER_JOULE
