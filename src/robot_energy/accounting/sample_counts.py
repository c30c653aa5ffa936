"""Counters of samples: by quality and phase, and the greatest power.

What is counted does not depend on the cutting of the input, so short blocks wait until a counter
is read, or until they are worth a pass.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from math import isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.exact_sum import SETTLED, ExactSum, SumMark, add_saturating
from robot_energy.foundation.units import MAX_COUNTER, SECOND_NS
from robot_energy.timeline.blocks import Float, Int, Phase, PowerBlock, Quality

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


BITS = tuple(int(bit) for bit in Quality)
CountMark = tuple[list[SumMark], StandbyMark, dict[str, object]]
"""Where the counters stand."""


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

    def mark(self) -> CountMark:
        """Return where the counters stand, for `go_back`."""
        values = dict(self.__dict__)
        sums = [values.pop("_phase_energy").mark(), values.pop("_learned_energy").mark()]
        return sums, values.pop("_standby").mark(), values

    def go_back(self, mark: CountMark) -> None:
        """Drop what was counted since."""
        (phases, learned), standby, values = mark
        self._standby.go_back(standby)
        self._phase_energy.go_back(phases)
        self._learned_energy.go_back(learned)
        self.__dict__.update(values)

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
