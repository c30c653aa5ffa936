"""Sums of one bag: time and energy by clock hours, errors against the meter by temperature."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.foundation.units import HOUR_NS, SECOND_NS
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import Compared

SUMS = (
    "observed_ns", "motion_ns", "predicted_import_microjoule", "standby_ns", "standby_microjoule"
)  # fmt: skip
LAST_NS = 2**62  # behind all stamps
BIN = 5.0  # width of a bin of temperature [K]


class HourSums:
    """What the account of one bag counts in each UTC hour.

    Motion is what is not rest, as of standby: so noise of a reported velocity is not motion.
    """

    def __init__(self) -> None:
        self._hours: dict[int, Int] = {}
        self._before: Int = np.zeros(len(SUMS), dtype=np.int64)

    def take(self, account: EnergyAccount) -> None:
        """Take the registers as they stand: they count in the hour of their newest sample."""
        end_ns, registers, standby = account.end_ns, account.registers, account.counts.standby
        if end_ns is None:
            return
        observed = registers.time.observed_ns
        imported, used = int(registers.microjoule[0]), int(standby.energy.microjoule[0])
        now = np.array([observed, observed - standby.rested_ns, imported, standby.ns, used])
        hour = (end_ns - 1) // HOUR_NS * HOUR_NS
        self._hours[hour] = self._hours.get(hour, 0) + now - self._before
        self._before = now

    def table(self) -> list[dict[str, int]]:
        """Return one row for each hour."""
        return [
            {"hour_ns": hour, **dict(zip(SUMS, sums.tolist(), strict=True))}
            for hour, sums in sorted(self._hours.items())
        ]


class MeterErrors:
    """Remembers how warm the motors were, once a second, and sums the errors by it."""

    def __init__(self) -> None:
        self._stamp_ns: Int = np.empty(0, dtype=np.int64)
        self._degc: Float = np.empty(0)
        self._second = -1
        self._waiting: list[Compared] = []
        self._sums: dict[int, Float] = {}  # by bin: time [ns], measured, error, squares of it

    def compare(self, compared: Compared) -> None:
        """Take what became comparable with the meter, before the step of the same samples."""
        self._waiting.append(compared)

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        if (block := output.power) is None or not len(block):
            return
        second = block.stamp_ns // SECOND_NS
        new = np.flatnonzero(np.diff(second, prepend=self._second))
        self._second = int(second[-1])
        if len(new):
            warm = block.motor_temperature_degc[new].mean(axis=1)
            self._stamp_ns = np.concatenate([self._stamp_ns, block.stamp_ns[new]])
            self._degc = np.concatenate([self._degc, warm])
        self._sum(int(block.stamp_ns[-1]))

    def table(self) -> list[dict[str, Any]]:
        """Return one row for each bin with errors, of plain values, after the last step."""
        self._sum()
        return [
            {
                "degc": (number + 0.5) * BIN,
                "compared_ns": int(sums[0]),
                "measured": float(sums[1]),
                "error": float(sums[2]),
                "error_squares": float(sums[3]),
            }
            for number, sums in sorted(self._sums.items())
        ]

    def _sum(self, until_ns: int = LAST_NS) -> None:
        """Sum what the meter had reported by a time; the temperature of the rest is to come."""
        if not self._waiting or not len(self._stamp_ns):
            return
        whole = Compared.concatenate(self._waiting)
        later = whole.stamp_ns > until_ns
        self._waiting = [whole[later]] if later.any() else []
        order = np.argsort(self._stamp_ns, kind="stable")  # stamps may jump back
        place = np.searchsorted(self._stamp_ns[order], whole.stamp_ns, side="right") - 1
        warm = self._degc[order][np.maximum(place, 0)]
        used = np.isfinite(warm) & (whole.duration_ns > 0) & ~later
        number = np.floor(warm[used] / BIN).astype(np.int64)
        pieces = whole[used]
        error = pieces.predicted - pieces.measured
        squares = error**2 / (pieces.duration_ns * NANOSECOND)
        sums = np.stack([pieces.duration_ns, pieces.measured, error, squares])
        for one in np.unique(number).tolist():
            self._sums[one] = self._sums.get(one, 0.0) + sums[:, number == one].sum(axis=1)
