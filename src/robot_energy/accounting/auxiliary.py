"""Energy of loads outside of the cabinet, and what the outlet gives to all of it together.

A load has a power by its own meter, or by the state it is in. Its energy is counted over the
observed time of the robot, cut where its meter's readings and its states change. Time for which
its power is not known is counted as missing, never as 0 W. The balance of the outlet holds over
the time in which every load is known: outlet = cabinet + loads, in exact integers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.exact_sum import REMAINDER_BITS, ExactSum
from robot_energy.blocks import NANOSECOND, Float, Int, MeterBlock, PowerBlock
from robot_energy.inputs.meter.power_curve import MeterCurve, MeterLimits
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.coverage import MAX_GAP_NS
from robot_energy.timeline.pieces import CoveredPieces

PATIENCE_NS = 60_000_000_000  # for a meter that has not reported yet
STATE_WAIT_NS = 1_000_000_000  # for a state that was set but has not arrived
UNKNOWN = -1  # number of a state that nobody has said


class LoadCurve:
    """Power of one load over time, as far as its meter and its states say it.

    Args:
        load: The load.
        limits: Of the readings of its meter.
        planned: Whether to go by states alone, as for a prediction.

    Attributes:
        load: The load.
        metered: Whether its meter says its power.
        switched: Whether states arrive by messages.
        curve: What became of the readings of the meter.
    """

    def __init__(self, load: AuxiliaryLoad, limits: MeterLimits, planned: bool) -> None:
        self.load = load
        self.metered = load.metered and not planned
        self.switched = False
        self.curve = MeterCurve(limits.max_gap, limits.max_power, limits.wraps_at)
        self._power = np.array([figure.value for figure in load.states.values()] + [np.nan])
        self._pieces = CoveredPieces.empty()
        first = UNKNOWN if load.initial is None else load.state_names.index(load.initial)
        self._changed_ns: Int = np.array([np.iinfo(np.int64).min])
        self._state: Int = np.array([first])

    def measure(self, block: MeterBlock) -> None:
        """Take readings of the meter.

        Args:
            block: Readings in order of arrival.
        """
        first, *later = self.curve.step(block)
        self._pieces = later[-1] if later else self._pieces.join(first)

    def switch(self, stamp_ns: Int, state: Float) -> None:
        """Take states; a number that the load does not have makes its state unknown.

        Args:
            stamp_ns: Since when, shape (N,). [ns]
            state: Number of each, shape (N,). [-]
        """
        with np.errstate(invalid="ignore"):
            known = (state == np.floor(state)) & (state >= 0) & (state < len(self.load.states))
        number = np.where(known, state, UNKNOWN).astype(np.int64)
        order = np.argsort(stamp_ns, kind="stable")
        earlier = self._changed_ns <= stamp_ns[order[0]] if len(order) else slice(None)
        self.switched = True
        self._changed_ns = np.concatenate([self._changed_ns[earlier], stamp_ns[order]])
        self._state = np.concatenate([self._state[earlier], number[order]])

    def known_until(self, newest_ns: int) -> int:
        """Return until when the power is known, though more may arrive. [ns]

        Args:
            newest_ns: Newest sample of the robot. [ns]
        """
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
        state = self._state[np.searchsorted(self._changed_ns, low, side="right") - 1]
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

    def forget(self, before_ns: int) -> None:
        """Drop what lies before an instant, but for the state in force then.

        Args:
            before_ns: The instant. [ns]
        """
        self._pieces = self._pieces[self._pieces.end_ns > before_ns]
        first = int(np.searchsorted(self._changed_ns, before_ns, side="right")) - 1
        self._changed_ns, self._state = self._changed_ns[first:], self._state[first:]


class AuxiliaryAccount:
    """Counts the loads outside of one cabinet.

    Args:
        loads: Of the model file; at least one.
        limits: Of the readings of each meter, by the name of its load; usual ones by default.
        planned: Whether to go by states alone, as for a prediction.

    Attributes:
        curves: Power of each load, in the order of the model file.
        energy: Energy of each load while it is known, exact.
        known_ns: Time for which each is known, shape (n,). [ns]
        missing_ns: Observed time for which it is not, shape (n,). [ns]
        missing_count: How often a load ceased to be known, shape (n,).
        state_energy: By load and state, all in one row, exact.
        state_ns: Time in each of these states while the power is known. [ns]
        together: Cabinet and loads while all loads are known, exact.
        together_ns: That time. [ns]
        observed_ns: Observed time in all, decided so far. [ns]
    """

    def __init__(
        self,
        loads: Sequence[AuxiliaryLoad],
        limits: Mapping[str, MeterLimits] | None = None,
        planned: bool = False,
    ) -> None:
        usual = MeterLimits()
        self.curves = [
            LoadCurve(load, (limits or {}).get(load.name, usual), planned) for load in loads
        ]
        n_loads = len(self.curves)
        self.energy, self.together = ExactSum(n_loads), ExactSum(1 + n_loads)
        self.known_ns, self.missing_ns, self.missing_count = np.zeros((3, n_loads), dtype=np.int64)
        self.offset = np.cumsum([0, *(len(curve.load.states) for curve in self.curves)])
        self.state_energy = ExactSum(int(self.offset[-1]))
        self.state_ns: Int = np.zeros(int(self.offset[-1]), dtype=np.int64)
        self.together_ns = 0
        self.observed_ns = 0
        self._was_known = np.ones(n_loads, dtype=np.bool_)
        self._waiting = CoveredPieces.empty()  # power of the cabinet
        self._last: tuple[int, int, float] | None = None  # stamp, segment, power

    def __getitem__(self, name: str) -> LoadCurve:
        """Return the curve of a load."""
        return next(curve for curve in self.curves if curve.load.name == name)

    def step(self, block: PowerBlock) -> None:
        """Take power of the cabinet.

        Args:
            block: Samples in time order.
        """
        grid = block.grid_power
        first = self._last or (int(block.stamp_ns[0]), int(block.segment[0]), float(grid[0]))
        stamp = np.concatenate([[first[0]], block.stamp_ns])
        segment = np.concatenate([[first[1]], block.segment])
        power = np.concatenate([[first[2]], grid])
        self._last = int(stamp[-1]), int(segment[-1]), float(power[-1])
        for start, stop in _runs(stamp):
            rows = slice(start, stop)
            self._extend(stamp[rows], segment[rows], power[rows])
            if stop < len(stamp):  # the stamps go back: nothing more comes for what was before
                self.flush()
        self._decide(min(curve.known_until(int(stamp[-1])) for curve in self.curves))

    def flush(self) -> None:
        """Decide all that waits, as at the end of a bag."""
        if len(self._waiting):
            self._decide(int(self._waiting.end_ns[-1]))

    @property
    def outlet_microjoule(self) -> int:
        """Energy from the outlet while all loads are known: of the cabinet and of every load."""
        whole = sum(self.together.microjoule.tolist())
        return whole + (sum(self.together.remainder.tolist()) >> REMAINDER_BITS)

    def _extend(self, stamp: Int, segment: Int, power: Float) -> None:
        elapsed = np.diff(stamp)
        keep = (np.diff(segment) == 0) & (elapsed > 0) & (elapsed <= MAX_GAP_NS)
        keep &= np.isfinite(power[1:]) & np.isfinite(power[:-1])
        pieces = CoveredPieces(stamp[:-1], stamp[1:], power[:-1], power[1:])[keep]
        self._waiting = self._waiting.join(pieces)

    def _decide(self, until_ns: int) -> None:
        """Count what ends by an instant; more that concerns it does not come."""
        waiting = self._waiting
        done = waiting[waiting.end_ns <= until_ns]
        if not len(done):
            return
        self._waiting = waiting[waiting.end_ns > until_ns]
        start, end = int(done.start_ns[0]), int(done.end_ns[-1])
        edges = np.unique(np.concatenate([done.edges, *(curve.edges for curve in self.curves)]))
        edges = edges[(edges >= start) & (edges <= end)]
        low, high = edges[:-1], edges[1:]
        row, inside = done.index(low, high)
        low, high, row = low[inside], high[inside], row[inside]
        time = high - low
        half = 0.5 * NANOSECOND * time
        columns: list[Float] = [(done.value(row, low) + done.value(row, high)) * half]
        known = np.empty((len(low), len(self.curves)), dtype=np.bool_)
        by_state = np.zeros((len(low), len(self.state_ns)))
        for place, curve in enumerate(self.curves):
            energy, known[:, place], state = curve.energy(low, high)
            columns.append(energy)
            said = np.flatnonzero(known[:, place] & (state != UNKNOWN))
            column = int(self.offset[place]) + state[said]
            by_state[said, column] = energy[said]
            np.add.at(self.state_ns, column, time[said])
            curve.forget(end)
        every = known.all(axis=1)
        parts = np.stack(columns, axis=1)
        self.energy.add(np.ascontiguousarray(parts[:, 1:]))
        self.together.add(parts[every])
        self.state_energy.add(by_state)
        self.known_ns += time @ known
        self.missing_ns += time @ ~known
        before = np.vstack([self._was_known, known[:-1]])
        self.missing_count += (before & ~known).sum(axis=0)
        self._was_known = known[-1].copy()
        self.together_ns += int(time[every].sum())
        self.observed_ns += int(time.sum())


def _runs(stamp: Int) -> list[tuple[int, int]]:
    """First and last row behind each run of stamps that do not go back."""
    cuts = (np.flatnonzero(np.diff(stamp) < 0) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, len(stamp)], strict=True))
