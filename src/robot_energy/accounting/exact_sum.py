"""Sums of energies that lose nothing: integer microjoules with the remainder carried.

A remainder counts units of 2^-40 microjoule. Integer sums do not depend on how the input
is cut into blocks, and a year at 1 kHz loses nothing.
"""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float, Int

PER_JOULE = 1e6  # microjoules
REMAINDER_BITS = 40  # the remainder counts units of 2^-40 microjoule
BLOCK = 1 << 10  # rows whose remainders add up exactly in a float
ROUND_WHOLE = 1.5 * 2.0**52  # adding and subtracting this rounds to an integer,
ROUND_REMAINDER = 1.5 * 2.0 ** (52 - REMAINDER_BITS)  # and this to the remainder's unit


class ExactSum:
    """Sums of energies, exact in integers.

    Args:
        size: How many registers.

    Attributes:
        microjoule: Whole microjoules, shape (size,). [uJ]
        remainder: What is left, 0 to 2^40 - 1, shape (size,). [2^-40 uJ]
    """

    def __init__(self, size: int) -> None:
        self.microjoule: Int = np.zeros(size, dtype=np.int64)
        self.remainder: Int = np.zeros(size, dtype=np.int64)

    def add(self, energy: Float) -> None:
        """Add the energies of intervals.

        Whole microjoules and remainders are rounded to multiples of their units, whose
        sums are exact in floats as well, whatever the order.

        Args:
            energy: Finite, below 2 MJ each, shape (N, size). [J]
        """
        for start in range(0, len(energy), BLOCK):
            rest = energy[start : start + BLOCK] * PER_JOULE
            whole = rest + ROUND_WHOLE
            whole -= ROUND_WHOLE
            rest -= whole
            rest += ROUND_REMAINDER
            rest -= ROUND_REMAINDER
            ones = np.ones(len(rest))
            self.microjoule += (ones @ whole).astype(np.int64)
            self.remainder += (ones @ rest * 2.0**REMAINDER_BITS).astype(np.int64)
            self._carry()

    def add_sums(self, microjoule: Int, remainder: Int) -> None:
        """Add sums that were made elsewhere, such as those of a state file.

        Args:
            microjoule: Shape (size,). [uJ]
            remainder: Shape (size,). [2^-40 uJ]
        """
        self.microjoule += microjoule
        self.remainder += remainder
        self._carry()

    def reset(self) -> None:
        """Begin at zero; the remainder stays, so that nothing is lost in between."""
        self.microjoule[:] = 0

    def _carry(self) -> None:
        self.microjoule += self.remainder >> REMAINDER_BITS
        self.remainder &= (1 << REMAINDER_BITS) - 1

    @property
    def joule(self) -> Float:
        """The sums, shape (size,). [J]"""
        return self.microjoule / PER_JOULE
