"""What a long run measures: one figure, its goal, and whether it was reached."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np


class Figure(NamedTuple):
    """One line of the table.

    Attributes:
        what: What was measured, with its unit.
        value: The figure.
        goal: What it should be, in words.
        reached: Whether it is.
    """

    what: str
    value: float | int | str
    goal: str = ""
    reached: bool = True


class LongRun(Protocol):
    """A module of this folder that `run.py` lists."""

    MINUTES: tuple[float, float]
    """How long it takes: whole, and with ``--quick``. [min]"""

    @staticmethod
    def run(folder: str, quick: bool) -> list[Figure]:
        """Run in an empty folder and return the figures."""
        ...


def resident_kib() -> int:
    """Memory of this process that is in RAM. [KiB]"""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


def slope(times: Sequence[float], values: Sequence[float]) -> float:
    """Least-squares slope of values over times; 0 for fewer than two. [unit of value / of time]"""
    if len(times) < 2:
        return 0.0
    return float(np.polyfit(np.asarray(times), np.asarray(values, dtype=np.float64), 1)[0])
