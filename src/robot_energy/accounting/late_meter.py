"""What a meter shows late: how far its readings lie from a power that changes.

A meter with a low pass of time constant T shows y where p is drawn, ``T dy/dt = p - y``; a delay
T does nearly the same. T follows from the readings, see
`robot_energy.accounting.energy_calibration`; y is computed here from the predicted power. A
reading is that of a time some tenths of a second ago, so the greatest ``|p - y|`` of the newest
0.2 s counts.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from itertools import accumulate
from math import exp

import numpy as np

from robot_energy import kernels
from robot_energy.blocks import NANOSECOND, Float, Int, differences

SLOT_NS = 20_000_000  # between two samples of the power
RECENT_NS = 200_000_000
MAX_SLOTS = 20_000  # that wait for the meter: minutes
KEPT = 16  # time constants that an old sample may still ask for: a minute or more
NANOWATT = 1e9
MANY = 50  # powers that are worth the kernel
NO_STAMP = -(2**63)  # what the kernel takes where nothing was before


class LateMeter:
    """A predicted power as the meter shows it.

    All sums are integers, so the cutting of the input makes no difference.

    Args:
        constant: Time constant that is known from the beginning. [s]
    """

    def __init__(self, constant: float = 0.0) -> None:
        self._constants = [constant]
        self.jump()

    def jump(self) -> None:
        """Forget all power, as where stamps go back; the newest time constant stays."""
        self._since: list[int] = []  # from when on each is known but the first
        self._constants = self._constants[-1:]
        self._slot = -1
        self._waiting: list[tuple[Int, Float]] = []
        self._power = self._behind = 0.0  # at the newest slot, and what the meter shows beyond it
        self._recent: deque[tuple[int, int]] = deque()  # |p - y| that none exceeds later [nW]
        self._stamps: list[int] = []
        self._sums: list[int] = [0]  # of what counts, before each stamp and after the last [nW]
        self._read_ns = -1  # later readings begin here at the earliest
        self._asked_ns = -1  # later periods

    def learn(self, since_ns: int, constant: float) -> None:
        """Take a newer time constant.

        Args:
            since_ns: From when on it is known, not before that of the last. [ns]
            constant: The time constant. [s]
        """
        self._since.append(since_ns)
        self._constants.append(constant)
        del self._since[:-KEPT], self._constants[: -KEPT - 1]

    def take(self, stamp_ns: Int, power: Float) -> None:
        """Take predicted power; it counts with `follow`.

        Args:
            stamp_ns: In the order of time, shape (N,). [ns]
            power: Where the meter sits, NaN where unknown, shape (N,). [W]
        """
        needed = min(self._read_ns, self._asked_ns)
        drop = max(bisect_left(self._stamps, needed) - 1, len(self._stamps) - MAX_SLOTS, 0)
        del self._stamps[:drop], self._sums[:drop]
        slot = stamp_ns // SLOT_NS
        begins = (differences(slot, self._slot) != 0) & np.isfinite(power)
        self._slot = int(slot[-1])
        if begins.any():
            self._waiting.append((stamp_ns[begins], power[begins]))

    def follow(self) -> None:
        """Let the meter show what was taken, as all time constants until then are known."""
        if not self._waiting:
            return
        stamp, power = (np.concatenate(each) for each in zip(*self._waiting, strict=True))
        self._waiting.clear()
        constant = np.array(self._constants)[np.searchsorted(self._since, stamp, side="right")]
        if kernels.compiled is not None and len(stamp) >= MANY:
            most = self._followed(kernels.compiled, stamp, power, constant)
        else:
            most = self._follow(stamp, power, constant)
        self._stamps += stamp.tolist()
        self._sums += accumulate(most, initial=self._sums.pop())

    def _follow(self, stamp_ns: Int, power: Float, constant: Float) -> list[int]:
        """Follow powers one by one; return the greatest |p - y| of the newest at each. [nW]"""
        recent, last, behind, most = self._recent, self._power, self._behind, list[int]()
        before = self._stamps[-1] if self._stamps else None
        rows = zip(stamp_ns.tolist(), power.tolist(), constant.tolist(), strict=True)
        for stamp, now, slow in rows:
            if slow > 0.0 and before is not None:
                passed = (stamp - before) * NANOSECOND
                behind = behind * exp(-passed / slow) + (last - now)
            else:
                behind = 0.0
            last, before = now, stamp
            late = round(abs(behind) * NANOWATT)
            while recent and recent[-1][1] <= late:
                recent.pop()
            recent.append((stamp, late))
            while recent[0][0] <= stamp - RECENT_NS:
                recent.popleft()
            most.append(recent[0][1])
        self._power, self._behind = last, behind
        return most

    def _followed(
        self, compiled: kernels.Compiled, stamp_ns: Int, power: Float, constant: Float
    ) -> list[int]:
        """Return the same by the kernel."""
        state, kept = np.array([self._power, self._behind]), len(self._recent)
        most, span = np.empty(len(stamp_ns), dtype=np.int64), np.empty(2, dtype=np.int64)
        stamps, lates = np.empty((2, kept + len(stamp_ns)), dtype=np.int64)
        stamps[:kept], lates[:kept] = np.array(self._recent, dtype=np.int64).reshape(-1, 2).T
        before = self._stamps[-1] if self._stamps else NO_STAMP
        compiled.follow(
            stamp_ns, power, constant, before, RECENT_NS, kept, state, stamps, lates, most, span
        )
        stay = slice(*span.tolist())
        self._recent = deque(zip(stamps[stay].tolist(), lates[stay].tolist(), strict=True))
        self._power, self._behind = state.tolist()
        return most.tolist()

    def of_readings(self, end_ns: Int, duration_ns: Int) -> Float:
        """Return how far the meter may be off for its lateness alone.

        Args:
            end_ns: Of readings, in the order of time, shape (N,). [ns]
            duration_ns: Shape (N,). [ns]

        Returns:
            Mean of each; 0 where nothing is known, shape (N,). [W]
        """
        self._read_ns = int(end_ns[-1])
        return self._late(end_ns - duration_ns, end_ns)

    def of_periods(self, end_ns: Int, duration: Float) -> Float:
        """Return the same of periods that follow each other.

        Args:
            end_ns: Of the periods, shape (N,). [ns]
            duration: Shape (N,). [s]
        """
        if len(end_ns):
            self._asked_ns = int(end_ns[-1])
        return self._late(end_ns - np.rint(duration / NANOSECOND).astype(np.int64), end_ns)

    def _late(self, begin_ns: Int, end_ns: Int) -> Float:
        stamps, sums, late = self._stamps, self._sums, list[float]()
        for begin, end in zip(begin_ns.tolist(), end_ns.tolist(), strict=True):
            high = bisect_left(stamps, end)
            low = min(bisect_left(stamps, begin), high - 1)
            known = (sums[high] - sums[low]) / ((high - low) * NANOWATT) if low >= 0 else 0.0
            late.append(known)
        return np.array(late)
