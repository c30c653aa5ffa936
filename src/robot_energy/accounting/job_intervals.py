"""Intervals of energy: per job, per cycle; several at once, and none is lost by a reset."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from robot_energy.accounting.plain_text import MAX_NAME, require_plain_text
from robot_energy.accounting.record import EnergyInterval, OpenInterval
from robot_energy.accounting.totals import Totals
from robot_energy.foundation.errors import RegisterError
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.units import MAX_COUNTER

MAX_OPEN = 16
MAX_CLOSED = 16


class JobIntervals:
    """The open intervals and the latest closed ones.

    An interval is the difference of two totals, so adjacent ones add up to the
    microjoule. Its bounds are stamps of counted samples.
    """

    def __init__(self) -> None:
        self.next_id = 1
        self.open_entries: dict[int, OpenInterval] = {}  # those that are open, by their numbers
        self._peaks: dict[int, float] = {}
        self._closed: deque[EnergyInterval] = deque(maxlen=MAX_CLOSED)

    def open(self, name: str, stamp_ns: int | None, totals: Totals) -> EnergyInterval:
        """Return a new interval of a name that is not open, from the newest counted sample on."""
        require_plain_text("an interval name", name, MAX_NAME, RegisterError)
        if any(entry.name == name for entry in self.open_entries.values()):
            raise RegisterError(
                f"an interval '{name}' is open already", "another name", "close it first"
            )
        if len(self.open_entries) >= MAX_OPEN:
            raise RegisterError(
                f"{MAX_OPEN} intervals are open", f"at most {MAX_OPEN}", "close one first"
            )
        if stamp_ns is None:
            raise RegisterError("no sample has been counted yet", "a first joint state")
        if self.next_id >= MAX_COUNTER:
            raise RegisterError("the numbers of intervals are used up", f"below {MAX_COUNTER}")
        entry = OpenInterval(
            interval_id=self.next_id,
            name=name,
            start_ns=stamp_ns,
            base=totals,
            peak_power_watt=None,
        )
        self.open_entries[self.next_id] = entry
        self.next_id += 1
        return self._report(entry, stamp_ns, totals, is_open=True)

    def close(self, name: str, interval_id: int, stamp_ns: int, totals: Totals) -> EnergyInterval:
        """Return what an interval counted up to now; its name is used where the number is 0."""
        found = [
            entry
            for entry in self.open_entries.values()
            if (entry.interval_id == interval_id if interval_id else entry.name == name)
        ]
        if not found:
            names = ", ".join(f"'{entry.name}'" for entry in self.open_entries.values())
            what = f"number {interval_id}" if interval_id else f"'{shown(name)}'"
            raise RegisterError(f"no interval {what} is open", names or "an open interval; none is")
        closed = self._report(found[0], stamp_ns, totals, is_open=False)
        del self.open_entries[closed.interval_id]
        self._peaks.pop(closed.interval_id, None)
        self._closed.append(closed)
        return closed

    def listed(self, stamp_ns: int | None, totals: Totals) -> list[EnergyInterval]:
        """Return the closed intervals, oldest first, then the open ones as they stand."""
        now = [
            self._report(entry, entry.start_ns if stamp_ns is None else stamp_ns, totals, True)
            for entry in self.open_entries.values()
        ]
        return [*self._closed, *now]

    def step(self, peak_power: float) -> None:
        """Note the highest grid power of new samples.

        Args:
            peak_power: NaN for none. [W]
        """
        for number in self.open_entries:
            self._peaks[number] = float(np.fmax(self._peaks.get(number, np.nan), peak_power))

    def rebase(self, totals: Totals) -> None:
        """Keep what open intervals have counted while the counters go back to zero."""
        for number, entry in self.open_entries.items():
            self.open_entries[number] = entry.model_copy(update={"base": entry.base - totals})

    def state(self) -> tuple[tuple[OpenInterval, ...], tuple[EnergyInterval, ...]]:
        """Return the open and the closed intervals."""
        entries = [
            entry.model_copy(update={"peak_power_watt": self._peak(entry)})
            for entry in self.open_entries.values()
        ]
        return tuple(entries), tuple(self._closed)

    def restore(
        self, entries: Sequence[OpenInterval], closed: Sequence[EnergyInterval], next_id: int
    ) -> None:
        """Take over intervals of a state file; there must be none yet."""
        self.open_entries = {entry.interval_id: entry for entry in entries}
        self._closed.extend(closed)
        used = max(self.open_entries, default=0)
        self.next_id = min(max(next_id, used + 1), MAX_COUNTER)

    def _report(
        self, entry: OpenInterval, stamp_ns: int, totals: Totals, is_open: bool
    ) -> EnergyInterval:
        return EnergyInterval(
            interval_id=entry.interval_id,
            name=entry.name,
            start_ns=entry.start_ns,
            end_ns=stamp_ns,
            is_open=is_open,
            counted=totals - entry.base,
            peak_power_watt=self._peak(entry),
        )

    def _peak(self, entry: OpenInterval) -> float | None:
        stored = np.nan if entry.peak_power_watt is None else entry.peak_power_watt
        peak = float(np.fmax(self._peaks.get(entry.interval_id, np.nan), stored))
        return peak if np.isfinite(peak) else None
