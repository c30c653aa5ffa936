"""History of powers in bounded memory: mean, minimum and maximum of equal time buckets."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float, Int

MAX_BUCKETS = 600  # of one ring; more than most screens have pixels for
LATEST = np.iinfo(np.int64).max
WAYS: dict[str, tuple[np.ufunc, float, type]] = {
    "energy": (np.add, 0.0, float), "time": (np.add, 0.0, float),
    "low": (np.minimum, np.inf, float), "high": (np.maximum, -np.inf, float),
    "begin": (np.minimum, LATEST, int), "end": (np.maximum, 0, int),
}  # fmt: skip
"""What is kept of each bucket: how two become one, of an empty one, and its kind."""


class HistoryRing:
    """The newest buckets of one length; older ones are dropped, or all are merged in pairs.

    The minimum and the maximum of every bucket are kept, so that no peak is lost to averaging.
    Stamps may step back, as clocks do; by more than the ring is long, they begin it again.

    Args:
        width: Length of a bucket. [s]
        whole: Whether buckets are merged in pairs when the ring is full, so that all of the time
            since the first sample stays in it.

    Attributes:
        width_ns: Length of a bucket. [ns]
        newest: Number of the newest bucket, its start over ``width_ns``; None before the first.
    """

    def __init__(self, width: float, channels: int, whole: bool = False) -> None:
        self._start_width_ns = self.width_ns = round(width * SECOND_NS)
        self._whole = whole
        self._channels = channels
        self._begin()

    def _begin(self) -> None:
        self.width_ns = self._start_width_ns
        self.newest: int | None = None
        self._first = 0
        self._number = np.full(MAX_BUCKETS, -1, dtype=np.int64)
        self._held = {
            name: np.full((MAX_BUCKETS, 1 if kind is int else self._channels), empty, kind)
            for name, (_, empty, kind) in WAYS.items()
        }

    def add(self, stamp_ns: Int, power: Float, period: Float) -> None:
        """Take means over periods, in order of their stamps.

        Args:
            stamp_ns: End of each period, shape (N,). [ns]
            power: Mean power of each, NaN where unknown, shape (N, channels). [W]
            period: Length of each, shape (N,). [s]
        """
        backward = np.flatnonzero(np.diff(stamp_ns) < 0) + 1
        cuts = [0, *backward.tolist(), len(stamp_ns)]
        for start, stop in pairwise(cuts):
            part = slice(start, stop)
            self._add(stamp_ns[part], power[part], period[part])

    def _add(self, stamp_ns: Int, power: Float, period: Float) -> None:
        if not len(stamp_ns):
            return
        # A period belongs to the bucket in which it ends: (start, end].
        first, last = int(stamp_ns[0] - 1), int(stamp_ns[-1] - 1)
        if self.newest is not None and first // self.width_ns <= self.newest - MAX_BUCKETS:
            self._begin()
        if self.newest is None:
            self._first = self.newest = first // self.width_ns
        self._first = min(self._first, first // self.width_ns)
        newest_ns = max(last, self.newest * self.width_ns)
        while self._whole and newest_ns // self.width_ns - self._first >= MAX_BUCKETS:
            self._merge()
        number = (stamp_ns - 1) // self.width_ns
        starts = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        known = np.isfinite(power)
        seconds = np.where(known, period[:, None], 0.0)
        each = {
            "energy": np.where(known, power, 0.0) * seconds,
            "time": seconds,
            "low": np.where(known, power, np.inf),
            "high": np.where(known, power, -np.inf),
            "begin": (stamp_ns - np.rint(period * SECOND_NS).astype(np.int64))[:, None],
            "end": stamp_ns[:, None],
        }
        keep = slice(max(0, len(starts) - MAX_BUCKETS), None)
        found = {name: WAYS[name][0].reduceat(each[name], starts)[keep] for name in WAYS}
        self._merge_into(number[starts][keep].tolist(), found)
        self.newest = newest_ns // self.width_ns

    def _merge_into(self, numbers: list[int], found: dict[str, NDArray[Any]]) -> None:
        for row, number in enumerate(numbers):
            slot = number % MAX_BUCKETS
            new, self._number[slot] = self._number[slot] != number, number
            for name, (way, empty, _) in WAYS.items():
                held = self._held[name]
                held[slot] = way(empty if new else held[slot], found[name][row])

    def _merge(self) -> None:
        rows = self._rows(MAX_BUCKETS)
        numbers = (self._number[rows] // 2).tolist()
        held = {name: values[rows] for name, values in self._held.items()}
        width_ns, first, newest = 2 * self.width_ns, self._first, self.newest
        self._begin()
        self.width_ns, self._first = width_ns, first // 2
        self.newest = None if newest is None else newest // 2
        self._merge_into(numbers, held)

    def _rows(self, count: int) -> NDArray[np.int64]:
        """Slots of the newest buckets that hold something, in order of time."""
        if self.newest is None:
            return np.zeros(0, dtype=np.int64)
        wanted = np.arange(self.newest - min(count, MAX_BUCKETS) + 1, self.newest + 1)
        wanted = wanted[wanted >= 0]
        slots = wanted % MAX_BUCKETS
        return slots[self._number[slots] == wanted]

    def energy(self) -> Float:
        """Energy of each channel over the time it was known, shape (channels,). [J]"""
        return np.asarray(self._held["energy"][self._rows(MAX_BUCKETS)].sum(axis=0))

    def seconds(self) -> Float:
        """Time over which each channel was known, shape (channels,). [s]"""
        return np.asarray(self._held["time"][self._rows(MAX_BUCKETS)].sum(axis=0))

    @property
    def length(self) -> float:
        """Time from the begin of the first period in it to the end of the last. [s]"""
        begin, end = (self._held[name][self._rows(MAX_BUCKETS)] for name in ("begin", "end"))
        return float(end[-1, 0] - begin[0, 0]) / SECOND_NS if len(end) else 0.0

    def table(self, count: int = MAX_BUCKETS) -> dict[str, Any]:
        """Return the newest buckets as plain values.

        Returns:
            ``width`` [s], ``number`` of each bucket (start over width), and ``mean``, ``low``,
            ``high`` [W] with one list per channel; None where unknown.
        """
        rows = self._rows(count)
        energy, time, low, high, *_ = (values[rows] for values in self._held.values())
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = energy / time
        known = time > 0

        def columns(values: Float) -> list[list[float | None]]:
            shown = np.where(known, np.round(values, 1), np.nan).T.tolist()
            return [[None if x != x else x for x in channel] for channel in shown]

        return {
            "width": self.width_ns / SECOND_NS,
            "number": self._number[rows].tolist(),
            "mean": columns(mean),
            "low": columns(low),
            "high": columns(high),
        }
