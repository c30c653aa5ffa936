"""How far a meter shows another power than is drawn, for it is late.

A response that is not exactly that of the model moves the readings most where the meter is far behind
the power: by ``dT dy/dt = (p - y) dT / T``. A reading is that of a time some tenths of a second
ago, so the greatest ``|p - y|`` of the newest 0.2 s counts. What the meter shows is followed in
`robot_energy.accounting.meter_response`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, differences

SLOT_NS = 20_000_000  # between two samples of the power
RECENT_NS = 200_000_000
MAX_SLOTS = 20_000  # that wait for the meter: minutes
NANOWATT = 1e9


class LateMeter:
    """Keeps what a meter shows beyond the power that is drawn.

    All sums are integers, so the cutting of the input makes no difference.
    """

    def __init__(self) -> None:
        self.jump()

    def jump(self) -> None:
        """Forget all power, as where stamps go back."""
        self._slot = -1
        self._recent: deque[tuple[int, int]] = deque()  # |p - y| that none exceeds later [nW]
        self._stamps: list[int] = []
        self._sums: list[int] = [0]  # of what counts, before each stamp and after the last [nW]
        self._read_ns = -1  # later readings begin here at the earliest
        self._asked_ns = -1  # later periods

    def take(self, stamp_ns: Int, behind: Float) -> None:
        """Take what the meter shows beyond the power.

        Args:
            stamp_ns: In the order of time, shape (N,). [ns]
            behind: Shape (N,). [W]
        """
        needed = min(self._read_ns, self._asked_ns)
        drop = max(bisect_left(self._stamps, needed) - 1, len(self._stamps) - MAX_SLOTS, 0)
        del self._stamps[:drop], self._sums[:drop]
        slot = stamp_ns // SLOT_NS
        begins = np.flatnonzero(differences(slot, self._slot))
        self._slot = int(slot[-1])
        recent, total = self._recent, self._sums[-1]
        lates = np.rint(np.abs(behind[begins]) * NANOWATT).astype(np.int64)
        for stamp, late in zip(stamp_ns[begins].tolist(), lates.tolist(), strict=True):
            while recent and recent[-1][1] <= late:
                recent.pop()
            recent.append((stamp, late))
            while recent[0][0] <= stamp - RECENT_NS:
                recent.popleft()
            total += recent[0][1]
            self._stamps.append(stamp)
            self._sums.append(total)

    def of_readings(self, end_ns: Int, duration_ns: Int) -> Float:
        """Return how far the meter is behind the power in readings.

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
