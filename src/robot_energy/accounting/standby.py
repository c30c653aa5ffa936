"""Standby: at rest with drives on, for so long that it could be switched off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.exact_sum import ExactSum, SumMark
from robot_energy.foundation.units import MAX_COUNTER, SECOND_NS
from robot_energy.timeline.blocks import Float, Int

MIN_STANDBY = 60.0  # at rest, from which on it is standby [s]
StandbyMark = tuple[SumMark, int, SumMark, int, bool]
"""Where the counters stand."""


class Standby:
    """Counts energy and time of every rest that has lasted `MIN_STANDBY`, from its beginning.

    Attributes:
        ns: Time in standby. [ns]
    """

    def __init__(self) -> None:
        self.energy = ExactSum(1)
        self.ns = 0
        self._rest = ExactSum(1)  # of a rest that is not standby yet
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
                self._rest, self._rest_ns = ExactSum(1), 0

    def _add(self, energy: Float, ns: int) -> None:
        counted = self._rest_ns >= MIN_STANDBY * SECOND_NS
        self._rest_ns += ns
        if counted:
            self.energy.add(energy)
            self.ns = min(self.ns + ns, MAX_COUNTER)
            return
        self._rest.add(energy)
        if self._rest_ns >= MIN_STANDBY * SECOND_NS:
            self.energy.add_sums(self._rest.microjoule, self._rest.remainder)
            self.ns = min(self.ns + self._rest_ns, MAX_COUNTER)

    def add(self, ns: int, microjoule: int, remainder: int) -> None:
        """Add what was counted elsewhere.

        Args:
            ns: Time. [ns]
            microjoule: Energy. [uJ]
            remainder: What it holds beyond. [2^-40 uJ]
        """
        self.energy.add_sums(np.array([microjoule]), np.array([remainder]))
        self.ns = min(self.ns + ns, MAX_COUNTER)

    def mark(self) -> StandbyMark:
        """Return where the counters stand, for `go_back`."""
        return self.energy.mark(), self.ns, self._rest.mark(), self._rest_ns, self._resting

    def go_back(self, mark: StandbyMark) -> None:
        """Drop what was counted since."""
        energy, self.ns, rest, self._rest_ns, self._resting = mark
        self.energy.go_back(energy)
        self._rest = ExactSum(1)
        self._rest.go_back(rest)

    def reset(self) -> None:
        """Begin at zero; a rest that is not standby yet begins, too."""
        self.energy.reset()
        self.ns = 0
        if self._rest_ns < MIN_STANDBY * SECOND_NS:
            self._rest, self._rest_ns = ExactSum(1), 0
