"""The trace of the registers: resets, restarts, changes of the model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from robot_energy.accounting.record import TraceEntry

KEPT = 16  # latest entries of each kind, so that restarts never push out a reset


class EventLog:
    """What happened to the registers, oldest first; bounded for each kind.

    Args:
        entries: Where to begin.
    """

    def __init__(self, entries: Iterable[TraceEntry] = ()) -> None:
        self._entries: list[TraceEntry] = []
        for entry in entries:
            self.add(entry)

    @property
    def entries(self) -> tuple[TraceEntry, ...]:
        """All entries, oldest first."""
        return tuple(self._entries)

    def add(self, entry: TraceEntry) -> None:
        """Note an entry; the oldest of its kind beyond 16 is dropped.

        Args:
            entry: What happened.
        """
        self._entries.append(entry)
        count = Counter(one.kind for one in self._entries)[entry.kind]
        if count > KEPT:
            oldest = next(one for one in self._entries if one.kind == entry.kind)
            self._entries.remove(oldest)
