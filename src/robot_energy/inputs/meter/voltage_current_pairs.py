"""Voltage and current of two topics -> power at the instants of the current."""

from __future__ import annotations

import numpy as np

from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.stamps import BACKWARD_JUMP_NS, first_needed, held_rows

Values = tuple[Int, Float]  # times of receipt [ns] and what was received then, each (N,)


def _nothing() -> Values:
    return np.empty(0, dtype=np.int64), np.empty(0)


class Pairing:
    """Multiplies each current by the voltage that was valid when it was received.

    A current waits until a later message of either topic has come, so that the order in
    which messages of one instant are handed over does not matter. Its voltage is the
    newest one not later than itself, and at most ``max_age`` old: power never comes from
    a voltage that may long have changed. Where the clock steps back, what waits is refused.

    Args:
        max_age: Longest time from the voltage to its current. [s]
        rejections: Where messages are counted; a current that waits counts as accepted until
            it turns out to be without a voltage.
    """

    def __init__(self, max_age: float, rejections: RejectionLog) -> None:
        self._max_age_ns = round(max_age / NANOSECOND)
        self._rejections = rejections
        self._voltage, self._current = _nothing(), _nothing()
        self._newest_ns: int | None = None

    def step(self, voltage: Values, current: Values) -> Values:
        """Return times [ns] and powers [W] of the currents that found their voltage by now."""
        times = np.concatenate([voltage[0], current[0]])
        if not len(times):
            return _nothing()
        if self._newest_ns is not None and times.min() < self._newest_ns - BACKWARD_JUMP_NS:
            self._refuse(len(self._current[0]))
            self._voltage, self._current, self._newest_ns = _nothing(), _nothing(), None
        self._rejections.received += len(times)
        self._rejections.accepted += len(times)
        self._voltage = _joined(self._voltage, voltage)
        self._current = _joined(self._current, current)
        newest = int(times.max())
        if self._newest_ns is not None:
            newest = max(newest, self._newest_ns)
        self._newest_ns = newest
        ready = int(np.searchsorted(self._current[0], newest))
        stamp, ampere = self._current[0][:ready], self._current[1][:ready]
        self._current = self._current[0][ready:], self._current[1][ready:]
        times, values = self._voltage
        volt = np.full(len(stamp), np.nan)  # none, or too old
        if len(times):
            row = held_rows(times, stamp, self._max_age_ns)
            volt = np.where(row >= 0, values[row], np.nan)
        with np.errstate(over="ignore"):  # beyond all numbers: refused below
            power = ampere * volt
        found = np.isfinite(power)
        self._refuse(int((~found).sum()))
        waiting = self._current[0]  # forget voltages before that of what waits, or of now
        first = first_needed(times, int(waiting[0]) if len(waiting) else newest)
        self._voltage = times[first:], values[first:]
        return stamp[found], power[found]

    def _refuse(self, unpaired: int) -> None:
        self._rejections.accepted -= unpaired
        self._rejections.reject("unpaired", unpaired)


def _joined(held: Values, new: Values) -> Values:
    """Both in order of time."""
    if not len(new[0]):
        return held
    times, values = np.concatenate([held[0], new[0]]), np.concatenate([held[1], new[1]])
    if bool((times[1:] >= times[:-1]).all()):
        return times, values
    order = np.argsort(times, kind="stable")
    return times[order], values[order]
