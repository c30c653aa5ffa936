"""Part of a bag, by the times at which its messages were recorded."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.bag.mcap_records import LogTimes
from robot_energy.bag.reader import BagReader
from robot_energy.foundation.errors import BagError
from robot_energy.timeline.blocks import NANOSECOND


@dataclass(frozen=True)
class TimeRange:
    """From where to where a bag is read.

    Attributes:
        start: After the first message; negative: before the last one; None: from the first. [s]
        end: Likewise; None: to the last. [s]
    """

    start: float | None = None
    end: float | None = None

    def __bool__(self) -> bool:
        """Return whether anything is left out."""
        return self.start is not None or self.end is not None

    def span(self, bag: BagReader) -> LogTimes:
        """Return the log times of the part, both included. [ns]"""
        first, last = bag.start_ns, bag.end_ns
        if first is None or last is None:
            raise BagError(
                f"{bag.path} holds no message with a time, so no part of it can be named",
                remedy="leave out start and end",
            )

        def at(seconds: float | None, default: int) -> int:
            if seconds is None:
                return default
            return round(seconds / NANOSECOND) + (last if seconds < 0.0 else first)

        start, end = at(self.start, first), at(self.end, last)
        if start >= end or start >= last or end <= first:
            length = (last - first) * NANOSECOND
            raise BagError(
                f"nothing of {bag.path} lies from {(start - first) * NANOSECOND:g} to "
                f"{(end - first) * NANOSECOND:g} s after its start",
                f"a start before the end, both within its {length:g} s",
                "change start and end; negative ones count from the end of the bag",
            )
        return max(start, first), min(end, last)

    def sentence(self, bag: BagReader) -> str:
        """Return what was read, as a sentence."""
        start, end = (((at - (bag.start_ns or 0)) * NANOSECOND) for at in self.span(bag))
        whole = ((bag.end_ns or 0) - (bag.start_ns or 0)) * NANOSECOND
        return f"only a part of the bag was read: from {start:.6g} to {end:.6g} s of {whole:.6g} s"
