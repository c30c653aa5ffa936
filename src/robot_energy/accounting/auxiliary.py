"""Energy of loads outside of the cabinet, and what the outlet gives to all of it together.

A load has a power by its own meter, or by the state it is in. Its energy is counted over the
observed time of the robot, cut where its meter's readings and its states change. Time for which
its power is not known is counted as missing, never as 0 W. The balance of the outlet holds over
the time in which every load is known: outlet = cabinet + loads, in exact integers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial

import numpy as np

from robot_energy.accounting.exact_sum import REMAINDER_BITS, ExactSum, Undo
from robot_energy.accounting.load_curve import UNKNOWN, LoadCurve
from robot_energy.accounting.registers import CLOCK_STEP_NS
from robot_energy.inputs.auxiliary import LoadTopics
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterBlock, PowerBlock
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces

_COUNTS = ("known_ns", "missing_ns", "missing_count", "state_ns", "together_ns", "observed_ns")


class AuxiliaryAccount:
    """Counts the loads outside of one cabinet.

    Args:
        topics: What is said of meter and states of each, by its name; usual by default.
        max_gap: Longest time between two readings of a meter that is bridged. [s]
        planned: Whether to go by states alone, as for a prediction.

    Attributes:
        curves: Power of each load, in the order of the model file.
        energy: Energy of each load while it is known, exact.
        known_ns: Time for which each is known, shape (n,). [ns]
        missing_ns: Observed time for which it is not, shape (n,). [ns]
        missing_count: How often a load ceased to be known, shape (n,).
        state_energy: By load and state, all in one row, exact.
        state_ns: Time in each of these states while the power is known. [ns]
        observed_ns: Observed time in all, decided so far. [ns]
    """

    def __init__(
        self,
        loads: Sequence[AuxiliaryLoad],
        topics: Mapping[str, LoadTopics] | None = None,
        max_gap: float = 2.0,
        planned: bool = False,
    ) -> None:
        given = {one.name: (topics or {}).get(one.name, LoadTopics(None, None)) for one in loads}
        self.curves = [
            LoadCurve(
                one,
                replace(given[one.name].limits, max_gap=max_gap),
                planned,
                given[one.name].stale_after,
            )
            for one in loads
        ]
        self.offset = np.cumsum([0, *(len(curve.load.states) for curve in self.curves)])
        self._was_known = np.ones(len(self.curves), dtype=np.bool_)
        self._waiting = NO_PIECES  # power of the cabinet
        self._last: tuple[int, int, float] | None = None  # stamp, segment, power
        self.begin()

    def begin(self) -> None:
        """Begin with all counts at zero; what readings and states say is kept."""
        n_loads, n_states = len(self.curves), int(self.offset[-1])
        self.energy, self.together = ExactSum(n_loads), ExactSum(1 + n_loads)
        self.state_energy = ExactSum(n_states)
        self._zero()

    def reset(self) -> None:
        """Set all counts to zero; what still waits is counted later."""
        for each in self._sums:
            each.reset()
        self._zero()

    def interrupt(self) -> None:
        """Count nothing from the last to the next sample."""
        self._last = None

    def _zero(self) -> None:
        # Replaced and never changed, as `mark` keeps them.
        self.known_ns, self.missing_ns, self.missing_count = np.zeros(
            (3, len(self.curves)), dtype=np.int64
        )
        self.state_ns: Int = np.zeros(int(self.offset[-1]), dtype=np.int64)
        self.together_ns = self.observed_ns = 0

    @property
    def _sums(self) -> tuple[ExactSum, ...]:
        return self.energy, self.together, self.state_energy

    def mark(self) -> list[Undo]:
        """Return what drops all that is counted from now on."""
        names = *_COUNTS, "_waiting", "_was_known"
        counts = {name: getattr(self, name) for name in names}
        return [partial(vars(self).update, counts), *map(ExactSum.mark, self._sums)]

    def add_times(self, counts: Int, state_ns: Int, together_ns: int, observed_ns: int) -> None:
        """Put what was counted earlier before these counts.

        Args:
            counts: Known and missing time [ns] and count of each load, shape (3, n).
            state_ns: Time in each state, shape (states,). [ns]
        """
        self.known_ns, self.missing_ns, self.missing_count = counts + np.stack(
            [self.known_ns, self.missing_ns, self.missing_count]
        )
        self.state_ns = self.state_ns + state_ns
        self.together_ns += together_ns
        self.observed_ns += observed_ns

    def flushed(self) -> AuxiliaryAccount:
        """Return a copy in which all that waits is decided, as it is if the process ends now."""
        done = deepcopy(self)
        done.flush()
        return done

    def shown(self, stamp_ns: Int) -> Float:
        """Return what is known of all loads at instants, shape (W, n, ``COLUMNS``).

        Args:
            stamp_ns: The instants, shape (W,). [ns]
        """
        return np.stack([curve.shown(stamp_ns) for curve in self.curves], axis=1)

    def __getitem__(self, name: str) -> LoadCurve:
        """Return the curve of a load."""
        return next(curve for curve in self.curves if curve.load.name == name)

    def take(self, name: str, readings: MeterBlock | None, states: MeterBlock | None) -> None:
        """Take what came from one load."""
        load = self[name]
        if readings is not None:
            load.measure(readings)
        if states is not None:
            load.switch(states.stamp_ns, states.power)

    def step(self, block: PowerBlock) -> None:
        """Take power of the cabinet."""
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
        keep = (np.diff(segment) == 0) & (elapsed > 0) & (elapsed <= CLOCK_STEP_NS)
        keep &= np.isfinite(power[1:]) & np.isfinite(power[:-1])
        pieces = CoveredPieces(stamp[:-1], stamp[1:], power[:-1], power[1:])[keep]
        self._waiting = CoveredPieces.concatenate([self._waiting, pieces])

    def _decide(self, until_ns: int) -> None:
        """Count what ends by an instant; more that concerns it does not come."""
        waiting = self._waiting
        done = waiting[waiting.end_ns <= until_ns]
        if not len(done):
            return
        self._waiting = waiting[waiting.end_ns > until_ns]
        start, end = int(done.stamp_ns[0]), int(done.end_ns[-1])
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
            held = np.zeros_like(self.state_ns)
            np.add.at(held, column, time[said])
            self.state_ns = self.state_ns + held
            curve.forget(end)
        every = known.all(axis=1)
        parts = np.stack(columns, axis=1)
        self.energy.add(np.ascontiguousarray(parts[:, 1:]))
        self.together.add(parts[every])
        self.state_energy.add(by_state)
        self.known_ns = self.known_ns + time @ known
        self.missing_ns = self.missing_ns + time @ ~known
        before = np.vstack([self._was_known, known[:-1]])
        self.missing_count = self.missing_count + (before & ~known).sum(axis=0)
        self._was_known = known[-1].copy()
        self.together_ns += int(time[every].sum())
        self.observed_ns += int(time.sum())


def _runs(stamp: Int) -> list[tuple[int, int]]:
    """First and last row behind each run of stamps that do not go back."""
    cuts = (np.flatnonzero(np.diff(stamp) < 0) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, len(stamp)], strict=True))
