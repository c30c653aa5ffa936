"""Messages that overtook each other: sorted within a window of their stamps."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Int
from robot_energy.inputs.joint_states.decode import JointReadings


class ReorderBuffer:
    """Puts messages of the same joints into the order of their stamps.

    A message waits until the stamps of its joints have passed it by the window. One that
    arrives later than that is late; it is dropped.

    Args:
        window_ns: How far a stamp may lie behind the newest one of the same joints. [ns]

    Attributes:
        late: Messages dropped.
    """

    def __init__(self, window_ns: int) -> None:
        self.late = 0
        self._window_ns = window_ns
        self._newest: dict[bytes, int] = {}
        self._held: JointReadings | None = None

    @property
    def waiting(self) -> int:
        """Messages that wait for the window to pass."""
        return 0 if self._held is None else len(self._held)

    def step(self, readings: JointReadings) -> JointReadings | None:
        """Take messages of one epoch in order of arrival; return those that are in order."""
        if not self._window_ns:
            return readings
        known = self.waiting
        whole = readings if self._held is None else JointReadings.joined([self._held, readings])
        release = np.full(len(whole), -1, dtype=np.int64)  # row whose arrival lets it go
        keep = np.ones(len(whole), dtype=np.bool_)
        for key, rows in _by_joints(whole).items():
            fresh = rows[rows >= known]
            stamp = whole.stamp_ns[fresh]
            before = self._newest.get(key)
            newest = np.maximum.accumulate(stamp if before is None else np.append(before, stamp))
            if before is None:
                late = stamp < np.append(stamp[:1], newest[:-1]) - self._window_ns
            else:
                late = stamp < newest[:-1] - self._window_ns
                newest = newest[1:]
            keep[fresh[late]] = False
            if len(newest):
                self._newest[key] = int(newest[-1])
            at = np.searchsorted(newest, whole.stamp_ns[rows] + self._window_ns, side="left")
            free = at < len(newest)
            release[rows[free]] = fresh[at[free]]
        self.late += int((~keep).sum())
        free = np.flatnonzero(keep & (release >= 0))
        order = np.lexsort((whole.stamp_ns[free], release[free]))
        left = keep & (release < 0)
        self._held = whole[left] if bool(left.any()) else None
        return whole[free[order]] if len(free) else None

    def flush(self) -> JointReadings | None:
        """Return what still waits, as at the end of an epoch, and forget its stamps."""
        held, self._held = self._held, None
        self._newest.clear()
        return None if held is None else held[np.argsort(held.stamp_ns, kind="stable")]


def _by_joints(readings: JointReadings) -> dict[bytes, Int]:
    """Rows of the messages that have the same joints."""
    if readings.present is None:
        return {b"": np.arange(len(readings))}
    kinds, which = np.unique(readings.present, axis=0, return_inverse=True)
    return {
        b"" if kinds[kind].all() else kinds[kind].tobytes(): np.flatnonzero(which.ravel() == kind)
        for kind in range(len(kinds))
    }
