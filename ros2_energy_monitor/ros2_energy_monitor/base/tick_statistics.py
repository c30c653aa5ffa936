# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""How long the ticks of a node take and how late they come, on the steady clock."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

STATM = Path("/proc/self/statm")  # Linux


class TickStatistics:
    """Collects the ticks between two reports.

    Args:
        period: Time from tick to tick. [s]
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._since = time.monotonic()
        self._due: float | None = None
        self._busy = self._longest = self._latest = 0.0
        self._ticks = 0

    @contextmanager
    def tick(self) -> Iterator[None]:
        """Measure one tick, the `with` block."""
        begin = time.monotonic()
        if self._due is not None:
            self._latest = max(self._latest, begin - self._due)
        self._due = begin + self._period
        yield
        duration = time.monotonic() - begin
        self._busy += duration
        self._longest = max(self._longest, duration)
        self._ticks += 1

    def take(self) -> dict[str, float]:
        """Return what was collected since the last call, and start again.

        Returns:
            ``busy_share`` of the time [-], ``tick_rate`` [1/s], ``longest_tick_s`` [s] and
            ``latest_tick_s``, the greatest delay of a tick [s].
        """
        now = time.monotonic()
        elapsed = now - self._since
        found = {
            "busy_share": self._busy / elapsed if elapsed else float("nan"),
            "tick_rate": self._ticks / elapsed if elapsed else float("nan"),
            "longest_tick_s": self._longest,
            "latest_tick_s": self._latest,
        }
        self._since = now
        self._busy = self._longest = self._latest = 0.0
        self._ticks = 0
        return found


def resident_memory() -> float:
    """Memory this process holds, NaN where the system does not say. [bytes]"""
    try:
        pages = int(STATM.read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return float("nan")
    return float(pages * os.sysconf("SC_PAGE_SIZE"))
