"""Which readings of motor temperatures to believe: range, order, and no step without cause."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from robot_energy.timeline.blocks import NANOSECOND, PLAUSIBLE_DEGC, Float, Int, differences
from robot_energy.timeline.stamps import SLOW_NS

MAX_HEATING_RATE = 5.0  # K/s; a winding under its peak current stays below
RESOLUTION = 2.0  # K; a step that coarse sensors and their noise make at any rate
SUPPORT = 2  # agreeing readings behind a temperature, of which more would not count more


class ReadingStatus(IntEnum):
    """What becomes of one motor's value in one reading."""

    NOT_GIVEN = 0
    ACCEPTED = 1
    IMPLAUSIBLE = 2
    OLDER = 3
    STEP = 4


class TemperatureFilter:
    """Keeps the temperature of every motor that is believed.

    A value outside -40 to 200 degC is refused, and one older than the last. One that
    differs from the last by more than 5 K/s and 2 K is held: it replaces the last only
    when more readings in a row agree with it than stand behind the last, three at most.
    So a single outlier changes nothing, a first reading that was one is gone after two
    that agree, and a true step counts from its third reading.

    Attributes:
        temperature_degc: Believed, shape (n,); NaN where none is yet. [degC]
        stamp_ns: Stamp of each, shape (n,); 0 where none is, or of an epoch before. [ns]
        begin_ns: First stamp of the running epoch. [ns]
        doubted: Whether the last value given was refused for what it is, shape (n,).
    """

    def __init__(self, n_joints: int) -> None:
        self.temperature_degc: Float = np.full(n_joints, np.nan)
        self.stamp_ns: Int = np.zeros(n_joints, dtype=np.int64)
        self.newest_ns = self.begin_ns = 0
        self.doubted = np.zeros(n_joints, dtype=np.bool_)
        self._support: Int = np.zeros(n_joints, dtype=np.int64)
        self._other: Float = np.full(n_joints, np.nan)  # held, and readings that agree with it
        self._other_ns: Int = np.zeros(n_joints, dtype=np.int64)
        self._other_support: Int = np.zeros(n_joints, dtype=np.int64)

    def take_all(self, stamp_ns: Int, values: Float) -> bool:
        """Return whether readings of every motor could be taken at once; none is taken if not.

        Args:
            stamp_ns: Shape (N,). [ns]
            values: Shape (N, n). [degC]
        """
        low, high = PLAUSIBLE_DEGC
        elapsed = differences(stamp_ns, self.newest_ns)
        if self.doubted.any() or not (elapsed >= 0).all() or not (self.stamp_ns > 0).all():
            return False
        if (self.stamp_ns != self.newest_ns).any():
            return False  # several sources take turns
        if not ((values >= low) & (values <= high)).all():  # nor if NaN
            return False
        steps = np.diff(values, axis=0, prepend=self.temperature_degc[None])
        if not (np.abs(steps) <= _allowed(elapsed)[:, None]).all():
            return False
        self.newest_ns = int(stamp_ns[-1])
        self.temperature_degc = values[-1].copy()
        self.stamp_ns[:] = self.newest_ns
        self._support = np.minimum(self._support + len(stamp_ns), SUPPORT)
        return True

    def take(self, stamp_ns: int, values: Float) -> NDArray[np.uint8]:
        """Return the `ReadingStatus` of each motor in one reading, shape (n,).

        Args:
            values: Shape (n,); NaN where it says nothing. [degC]
        """
        if stamp_ns <= self.newest_ns - SLOW_NS:
            self.stamp_ns[:] = 0
            self._other_support[:] = 0
            self.newest_ns = self.begin_ns = stamp_ns
        self.newest_ns = max(self.newest_ns, stamp_ns)
        given = ~np.isnan(values)
        plausible = given & (values >= PLAUSIBLE_DEGC[0]) & (values <= PLAUSIBLE_DEGC[1])
        newer = plausible & (stamp_ns >= self.stamp_ns)
        settled = (self.stamp_ns == 0) | _agree(
            values, self.temperature_degc, stamp_ns - self.stamp_ns
        )
        near = newer & settled
        far = newer & ~settled
        again = (self._other_support > 0) & _agree(values, self._other, stamp_ns - self._other_ns)
        self._other_support = np.where(
            far, np.where(again, self._other_support + 1, 1), self._other_support
        )
        self._other = np.where(far, values, self._other)
        self._other_ns = np.where(far, stamp_ns, self._other_ns)
        turned = far & (self._other_support > self._support)
        taken = near | turned
        self._support = np.where(
            near,
            np.minimum(self._support + 1, SUPPORT),
            np.where(turned, np.minimum(self._other_support, SUPPORT), self._support),
        )
        self._other_support[taken] = 0
        self.temperature_degc = np.where(taken, values, self.temperature_degc)
        self.stamp_ns = np.where(taken, stamp_ns, self.stamp_ns)
        self.doubted = np.where(given, ~plausible | (far & ~turned), self.doubted)
        verdict = np.zeros(len(values), dtype=np.uint8)
        for rows, which in (
            (given & ~plausible, ReadingStatus.IMPLAUSIBLE),
            (plausible & ~newer, ReadingStatus.OLDER),
            (far & ~turned, ReadingStatus.STEP),
            (taken, ReadingStatus.ACCEPTED),
        ):
            verdict[rows] = which
        return verdict


def _allowed(elapsed_ns: Int) -> Float:
    return MAX_HEATING_RATE * NANOSECOND * elapsed_ns + RESOLUTION


def _agree(values: Float, other: Float, elapsed_ns: Int) -> NDArray[np.bool_]:
    """Whether values may follow others; also where there is no other."""
    return np.isnan(other) | (np.abs(values - other) <= _allowed(elapsed_ns))
