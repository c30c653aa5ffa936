"""Power of one load outside of the cabinet over time, as far as its meter and its states say it."""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.power_curve import MeterCurve, MeterLimits
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterBlock, MeterMeaning
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces

PATIENCE_NS = 60_000_000_000  # for a meter that has not reported yet
STATE_WAIT_NS = 1_000_000_000  # for a state that was set but has not arrived
UNKNOWN = -1  # number of a state that nobody has said
MAX_KEPT = 100_000  # pieces and changes that wait for the robot
HOLD_NS = 2_000_000_000  # a reading is the newest for so long, or for twice the time it covers [ns]
COLUMNS = ("state", "remarks", "model_power", "measured_power", "measurement_age", "power")
"""What `LoadCurve.shown` gives of a load."""


class Remark(IntFlag):
    """What is wrong with the power of a load; as in ``ros2_energy_msgs/LoadPower``."""

    OK = 0
    STATE_ASSUMED = 1
    STATE_UNKNOWN = 2
    METER_MISSING = 4
    METER_STALE = 8
    METER_REFUSED = 16


class LoadCurve:
    """Power of one load over time.

    Args:
        planned: Whether to go by states alone, as for a prediction.
        stale_after: Silence of its states after which that of the model file is in force; 0:
            a state holds until the next one. [s]
    """

    def __init__(
        self,
        load: AuxiliaryLoad,
        limits: MeterLimits | None = None,
        planned: bool = False,
        stale_after: float = 0.0,
    ) -> None:
        limits = limits or MeterLimits()
        self.load = load
        self.metered = load.metered and not planned
        self.switched = len(load.states) > 1
        self.curve = MeterCurve(limits.max_gap, limits.max_power, limits.wraps_at)
        self.bad_states = 0  # numbers that arrived and are those of no state
        self._max_power, self._stale_ns = limits.max_power, round(stale_after / NANOSECOND)
        self._power = np.array([figure.value for figure in load.states.values()] + [np.nan])
        self._pieces = NO_PIECES
        self._refused_ns: Int = np.empty(0, dtype=np.int64)
        known = load.initial is not None
        self._first = load.state_names.index(load.initial) if load.initial else UNKNOWN
        self._changed_ns: Int = np.array([np.iinfo(np.int64).min])
        self._state: Int = np.array([self._first])
        # Assumed only where there is a choice, and something to assume.
        self._default = int(Remark.STATE_ASSUMED if known else Remark.STATE_UNKNOWN)
        self._default *= self.switched
        self._remarks: Int = np.array([self._default])

    def measure(self, block: MeterBlock) -> None:
        """Take readings of the meter."""
        first, *later = self.curve.step(block)
        pieces = later[-1] if later else CoveredPieces.concatenate([self._pieces, first])
        self._pieces = pieces[slice(-MAX_KEPT, None)]
        counts = block.meaning is MeterMeaning.CUMULATIVE
        value = (
            block.energy
            if counts
            else np.where(np.abs(block.power) > self._max_power, np.nan, block.power)
        )
        refused = np.concatenate([self._refused_ns, block.stamp_ns[~np.isfinite(value)]])
        self._refused_ns = np.sort(refused[-MAX_KEPT:])

    def switch(self, stamp_ns: Int, state: Float) -> None:
        """Take states; a number that the load does not have makes its state unknown.

        Args:
            stamp_ns: Since when, shape (N,). [ns]
            state: Number of each, shape (N,). [-]
        """
        if not len(stamp_ns):
            return
        with np.errstate(invalid="ignore"):
            known = (state == np.floor(state)) & (state >= 0) & (state < len(self.load.states))
        self.bad_states += int((~known).sum())
        number = np.where(known, state, UNKNOWN).astype(np.int64)
        remark = np.where(known, Remark.OK, Remark.STATE_UNKNOWN).astype(np.int64)
        order = np.argsort(stamp_ns, kind="stable")
        stamp, number, remark = stamp_ns[order], number[order], remark[order]
        if self._stale_ns:
            ends = stamp + self._stale_ns
            silent = np.append(ends[:-1] < stamp[1:], True)
            size = int(silent.sum())
            stamp = np.concatenate([stamp, ends[silent]])
            number = np.concatenate([number, np.full(size, self._first)])
            remark = np.concatenate([remark, np.full(size, self._default)])
            order = np.argsort(stamp, kind="stable")
            stamp, number, remark = stamp[order], number[order], remark[order]
        earlier = self._changed_ns <= stamp[0]
        changed = np.concatenate([self._changed_ns[earlier], stamp])
        state_ = np.concatenate([self._state[earlier], number])
        remarks = np.concatenate([self._remarks[earlier], remark])
        news = np.append(True, (np.diff(state_) != 0) | (np.diff(remarks) != 0))
        rows = np.flatnonzero(news)[-MAX_KEPT:]
        self._changed_ns, self._state, self._remarks = changed[rows], state_[rows], remarks[rows]

    def known_until(self, newest_ns: int) -> int:
        """Return until when the power is known, though more may arrive. [ns]"""
        until = newest_ns - STATE_WAIT_NS if self.switched else newest_ns
        if not self.metered:
            return until
        reported = int(self._pieces.end_ns[-1]) if len(self._pieces) else newest_ns - PATIENCE_NS
        return min(until, max(reported, newest_ns - PATIENCE_NS))

    @property
    def edges(self) -> Int:
        """Where its power or its state may jump. [ns]"""
        pieces = self._pieces.edges if self.metered else np.empty(0, dtype=np.int64)
        return np.concatenate([pieces, self._changed_ns])

    def energy(self, low: Int, high: Int) -> tuple[Float, NDArray[np.bool_], Int]:
        """Return the energy of intervals without an edge inside.

        Args:
            low: Where each begins, shape (M,). [ns]
            high: Where each ends, shape (M,). [ns]

        Returns:
            Energy, 0 where it is not known [J]; whether it is known; number of the state,
            `UNKNOWN` where nobody said it; shape (M,) each.
        """
        state = self._state[self._row(low)]
        time = (high - low) * NANOSECOND
        if self.metered:
            if not len(self._pieces):
                return np.zeros(len(low)), np.zeros(len(low), dtype=np.bool_), state
            row, known = self._pieces.index(low, high)
            power = 0.5 * (self._pieces.value(row, low) + self._pieces.value(row, high))
        else:
            power = self._power[state]
            known = np.isfinite(power)
        return np.where(known, power * time, 0.0), known, state

    def shown(self, stamp_ns: Int) -> Float:
        """Return what is known of the load at instants, shape (W, ``COLUMNS``).

        Args:
            stamp_ns: The instants, shape (W,). [ns]
        """
        row = self._row(stamp_ns)
        state, remarks = self._state[row], self._remarks[row]
        model = self._power[state]
        measured, age = np.full((2, len(stamp_ns)), np.nan)
        if self.metered:
            measured, age, meter = self._newest(stamp_ns)
            remarks = remarks | meter
        power = measured if self.metered else model
        rows = [state.astype(float), remarks.astype(float), model, measured, age, power]
        return np.stack(rows, axis=1)

    def _newest(self, stamp_ns: Int) -> tuple[Float, Float, Int]:
        """Power of the newest reading, its age [s] and remarks at instants, shape (W,) each."""
        pieces = self._pieces
        place = np.searchsorted(pieces.end_ns, stamp_ns, side="right") - 1
        if not len(pieces):
            none = np.full(len(stamp_ns), np.nan)
            return none, none, np.full(len(stamp_ns), int(Remark.METER_MISSING))
        row = np.maximum(place, 0)
        end = pieces.end_ns[row]
        old = stamp_ns - end
        refused = np.append(np.iinfo(np.int64).min, self._refused_ns)
        newest = refused[np.searchsorted(refused, stamp_ns, side="right") - 1]
        remarks = np.where(newest > end, int(Remark.METER_REFUSED), 0)
        stale = old > np.maximum(HOLD_NS, 2 * (end - pieces.stamp_ns[row]))
        remarks = np.where(stale, remarks | int(Remark.METER_STALE), remarks)
        remarks = np.where(place < 0, int(Remark.METER_MISSING), remarks)
        power = np.where(remarks == 0, pieces.mean_power[row], np.nan)
        return power, np.where(place < 0, np.nan, old * NANOSECOND), remarks

    def forget(self, before_ns: int) -> None:
        """Drop what lies before an instant, but for the state and the reading in force then."""
        done = int(np.searchsorted(self._pieces.end_ns, before_ns, side="right")) - 1
        self._pieces = self._pieces[slice(max(done, 0), None)]
        gone = int(np.searchsorted(self._refused_ns, before_ns, side="right")) - 1
        self._refused_ns = self._refused_ns[max(gone, 0) :]
        first = max(int(self._row(np.array([before_ns]))[0]), 0)
        self._changed_ns, self._state = self._changed_ns[first:], self._state[first:]
        self._remarks = self._remarks[first:]

    def _row(self, stamp_ns: Int) -> Int:
        """Which change is in force at instants; the first kept one before all of them."""
        return np.maximum(np.searchsorted(self._changed_ns, stamp_ns, side="right") - 1, 0)
