"""Time and energy of the phases, up to the instant of the newest registers."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Phase
from robot_energy_report.page.json_numbers import json_number

MAX_BEHIND_NS = 5_000_000_000  # registers older than that have ceased to arrive
SAME_NS = 1000  # both began at one sample


class PhaseTotals:
    """Sums power states by phase; what came after the newest registers waits.

    Registers come once a second, power states several times. Shown together they must agree, so
    all totals are those of the instant of the registers. A period that this instant divides is
    divided by what the registers counted, which its mean does not say. Before the first registers
    nothing waits.
    """

    def __init__(self) -> None:
        self._counted: Float = np.zeros((len(Phase), 3))  # time, energy, known time
        self._stamp: Int = np.empty(0, dtype=np.int64)
        self._waiting: Float = np.empty((0, 3))  # covered time, energy, known time
        self._phase: Int = np.empty(0, dtype=np.int64)
        self._registers: Float | None = None  # time and energy that they had counted
        self._begun_ns: int | None = None

    def rows(self) -> list[dict[str, Any]]:
        """Return name, seconds, energy [J] and mean power [W] of each phase that was met."""
        rows = 0 if self._registers is not None else len(self._stamp)
        return [
            {
                "name": phase.name,
                "seconds": round(seconds, 6),
                "energy": round(joule, 6) if known else None,
                "mean": json_number(joule / known, 5) if known else None,
            }
            for phase, (seconds, joule, known) in zip(Phase, self._with(rows).tolist(), strict=True)
            if seconds > 0
        ]

    @property
    def waiting(self) -> tuple[float, float]:
        """Time and energy of the power states after the newest registers. [s], [J]"""
        if self._registers is None:
            return 0.0, 0.0
        seconds, joule, _ = self._waiting.sum(axis=0).tolist()
        return seconds, joule

    def add(self, stamp_ns: Int, covered: Float, energy: Float, known: Float, phase: Int) -> None:
        """Take power states.

        Args:
            stamp_ns: End of each period, shape (N,). [ns]
            covered: Covered time of each, shape (N,). [s]
            energy: Of each, while its power was known, shape (N,). [J]
            known: Time of each with a known power, shape (N,). [s]
            phase: Of each, shape (N,).
        """
        if self._begun_ns is None:
            self._begun_ns = int(stamp_ns[0]) - round(float(covered[0]) / NANOSECOND)
        self._stamp = np.concatenate([self._stamp, stamp_ns])
        self._waiting = np.concatenate([self._waiting, np.stack([covered, energy, known], axis=1)])
        self._phase = np.concatenate([self._phase, phase.astype(np.int64)])
        backward = bool((np.diff(self._stamp) < 0).any())
        if backward or np.ptp(self._stamp) > MAX_BEHIND_NS:
            self._count(len(self._stamp))
            self._registers = None

    def settle(self, stamp_ns: int, start_ns: int, seconds: float, joule: float) -> None:
        """Count what waits up to the instant of new registers.

        Args:
            seconds: Time that they observed. [s]
            joule: Net energy from the grid that they counted. [J]
        """
        before, self._registers = self._registers, np.array([seconds, joule])
        whole = int(np.searchsorted(self._stamp, stamp_ns, side="right"))
        since = self._waiting[:whole, :2].sum(axis=0)
        if self._begun_ns is not None and abs(self._begun_ns - start_ns) < SAME_NS:
            before, since = np.zeros(2), since + self._counted[:, :2].sum(axis=0)
        known = None if before is None else self._registers - before - since
        self._count(whole)
        if not len(self._stamp):
            return
        period = self._waiting[0]
        begin_ns = int(self._stamp[0]) - round(float(period[0]) / NANOSECOND)
        if begin_ns >= stamp_ns:
            return
        part = period * ((stamp_ns - begin_ns) * NANOSECOND / period[0])
        if known is not None and 0.0 <= known[0] <= period[0]:
            if abs(known[1] - part[1]) <= abs(period[1]):
                part[:2] = known
                part[2] = known[0] if period[2] > 0.0 else 0.0
        rest = period - part
        self._waiting[0] = part
        stamp, phase = self._stamp[0], self._phase[0]
        self._count(1)
        self._stamp = np.concatenate([[stamp], self._stamp])
        self._phase = np.concatenate([[phase], self._phase])
        self._waiting = np.concatenate([rest[None, :], self._waiting])

    def _with(self, rows: int) -> Float:
        """What is counted with the first rows that wait."""
        found = self._counted.copy()
        np.add.at(found, self._phase[:rows], self._waiting[:rows])
        return found

    def _count(self, rows: int) -> None:
        self._counted = self._with(rows)
        self._stamp, self._phase = self._stamp[rows:], self._phase[rows:]
        self._waiting = self._waiting[rows:]
