"""An energy counter: what its readings have counted, and which of them to leave out.

Between two changes the count says nothing of the power, so a piece of the curve reaches
from one change to the next: a counter of coarse steps that is read often gives its mean
power, not zeros with a spike at every step. The first reading is only a base.

A reading that no consumption explains, one that is lower than the last or implies more
power than `max_power`, is held and not used. A reading that continues the old count
ends the doubt: the held ones were wrong, and nothing of them is counted. If instead the
readings go on from the new value, `CONFIRM_READINGS` of them over `CONFIRM_TIME_NS` and
rising, the counter was reset: a new base, and nothing is counted across. A counter that
wraps at a known value continues exactly instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import CoveredPieces

CONFIRM_READINGS = 3
CONFIRM_TIME_NS = 5 * SECOND_NS

Level = tuple[int, int, float]  # start, end [ns], power [W]


@dataclass
class _Doubt:
    """Readings that do not continue the count."""

    high: bool
    first_ns: int
    first: Annotated[float, "The first reading. [J]"]
    last: Annotated[float, "The newest reading. [J]"]
    count: int
    unbroken: Annotated[bool, "Whether no gap lies between the count and them."]


class EnergyCounterDecoder:
    """Turns the readings of one counter into levels of power.

    Args:
        max_power: Power that no step between two readings can imply. [W]
        wraps_at: Reading at which the counter starts again from zero; None: it never does. [J]

    Attributes:
        reset_ns: Stamp of the first reading after the last reset; None if there was none. [ns]
    """

    def __init__(self, max_gap_ns: int, max_power: float, wraps_at: float | None = None) -> None:
        self.resets = 0
        self.reset_ns: int | None = None
        self.wraps = 0
        self.low = 0
        self.high = 0
        self._max_gap_ns = max_gap_ns
        self._per_ns = max_power * NANOSECOND
        self._wraps_at = wraps_at
        self.restart()

    def restart(self) -> None:
        """Forget the count: the next reading is a base, as at the start of a new epoch."""
        self._edge: tuple[int, float] | None = None  # stamp and count of the last change
        # Whether the change happened within one reading of that stamp: None for a base that
        # the next reading may still show to be one.
        self._sharp: bool | None = None
        self._good_ns = 0  # newest reading that was used
        self._heard_ns = 0  # newest reading
        self._doubt: _Doubt | None = None

    @property
    def still_since_ns(self) -> int | None:
        """Stamp since which the count has not changed; None before the first reading. [ns]"""
        return None if self._edge is None else self._edge[0]

    def step(self, stamp_ns: Int, energy: Float) -> CoveredPieces:
        """Return levels between changes of the count, each ending at one of the readings taken.

        Args:
            stamp_ns: Strictly increasing, shape (N,). [ns]
            energy: Finite counts, shape (N,). [J]
        """
        pieces = self._together(stamp_ns, energy)
        if pieces is not None:
            return pieces
        levels = [
            level
            for stamp, count in zip(stamp_ns.tolist(), energy.tolist(), strict=True)
            if (level := self._take(stamp, count)) is not None
        ]
        start, end, power = zip(*levels, strict=True) if levels else ((), (), ())
        level = np.asarray(power, dtype=np.float64)
        return CoveredPieces(np.asarray(start, np.int64), np.asarray(end, np.int64), level, level)

    def _together(self, stamp: Int, energy: Float) -> CoveredPieces | None:
        """All readings at once where nothing is doubtful, as nearly always; else None."""
        if self._edge is None or self._doubt is not None or len(stamp) < 2:
            return None
        edge_ns, count = self._edge
        if bool((np.diff(stamp, prepend=self._heard_ns) > self._max_gap_ns).any()):
            return None
        rise = np.diff(energy, prepend=count)
        if bool((rise < 0).any()):
            return None
        changed = np.flatnonzero(rise)
        sharp = self._sharp if self._sharp is not None else bool(rise[0] > 0)
        if not sharp and len(changed):
            return None
        end = stamp[changed]
        start = np.concatenate([[edge_ns], end])[:-1]
        elapsed, rise = end - start, rise[changed]
        if bool((rise > self._per_ns * elapsed).any()):
            return None
        if len(changed):
            self._edge = (int(end[-1]), float(energy[-1]))
        self._sharp = sharp
        self._good_ns = self._heard_ns = int(stamp[-1])
        power = rise / (elapsed * NANOSECOND)
        return CoveredPieces(start, end, power, power)

    def _take(self, stamp: int, count: float) -> Level | None:
        """Take one reading and return the level that it ends."""
        unbroken = stamp - self._heard_ns <= self._max_gap_ns
        self._heard_ns = stamp
        if self._edge is None:
            return self._base(stamp, count)
        edge_ns, edge = self._edge
        explained = 0 <= count - edge <= self._per_ns * (stamp - edge_ns)
        doubt = self._doubt
        if doubt is not None:
            if not explained or (doubt.high and count >= doubt.first):
                return self._go_on_doubting(doubt, self._edge, (stamp, count), unbroken)
            self._doubt = None
            held_ns = stamp - self._good_ns
            unbroken &= doubt.unbroken and held_ns <= self._max_gap_ns + CONFIRM_TIME_NS
        if not explained and (count < edge or self._sharp):
            self._hold(_Doubt(count > edge, stamp, count, count, 1, unbroken))
            return None
        if not unbroken:
            return self._base(stamp, count)
        self._good_ns = stamp
        if count == edge:
            self._sharp = bool(self._sharp)
            return None
        sharp = explained and self._sharp is not False
        self._edge, self._sharp = (stamp, count), True
        return _level(edge_ns, stamp, count - edge) if sharp else None

    def _base(self, stamp: int, count: float) -> None:
        self._edge, self._sharp, self._good_ns = (stamp, count), None, stamp

    def _hold(self, doubt: _Doubt) -> None:
        self._doubt = doubt
        self.high += doubt.high
        self.low += not doubt.high

    def _go_on_doubting(
        self, doubt: _Doubt, edge: tuple[int, float], reading: tuple[int, float], unbroken: bool
    ) -> Level | None:
        """Take a reading that does not continue the count; it may end the doubt."""
        (edge_ns, before), (stamp, count) = edge, reading
        if count < doubt.last or not unbroken:
            still = doubt.unbroken and unbroken
            self._hold(_Doubt(count > before, stamp, count, count, 1, still))
            return None
        rose, doubt.last = count > doubt.last, count
        doubt.count += 1
        long = stamp - doubt.first_ns >= CONFIRM_TIME_NS
        if not (rose and long and doubt.count >= CONFIRM_READINGS):
            self._hold(doubt)
            return None
        sharp, self._doubt = self._sharp, None
        self._edge, self._sharp, self._good_ns = reading, True, stamp
        step = count - before + (self._wraps_at or 0.0)
        plausible = 0 <= step <= self._per_ns * (stamp - edge_ns)
        if self._wraps_at and not doubt.high and plausible and step < self._wraps_at / 2:
            self.wraps += 1
            return _level(edge_ns, stamp, step) if doubt.unbroken and sharp else None
        self.resets += 1
        self.reset_ns = doubt.first_ns
        return None


def _level(start_ns: int, end_ns: int, energy: float) -> Level:
    return start_ns, end_ns, energy / ((end_ns - start_ns) * NANOSECOND)
