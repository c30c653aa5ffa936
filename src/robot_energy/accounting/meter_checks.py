"""What the difference between meter and prediction says, in sentences."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from robot_energy.accounting.comparison import EARLY_NS, Comparison
from robot_energy.foundation.units import ENERGY_UNITS, NANOJOULE_PER_JOULE, POWER_UNITS, SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, MeterMeaning
from robot_energy.timeline.pieces import Compared

WINDOW = 60  # of the rolling residual [s]
MIN_COMPARED_TIME = 30.0  # compared time in it before a unit is doubted [s]
MIN_GROSS_TIME = 8.0  # the same of a unit a thousand times as large, or of a turned sign [s]
GROSS_FACTOR = 1000.0
MAX_RATIO = 1.8  # ratios this far from a unit's, either way, still point at it; 3.6 = 2 * 1.8
IDLE_NS = 10 * SECOND_NS  # prediction without comparison that is worth a sentence
SUSTAINED_NS = 30 * SECOND_NS  # readings from the future for so long are a wrong clock
READINGS = 3  # that must have arrived meanwhile
MIN_RETURNED = 0.02  # of the measured energy drawn, fed back without prediction, worth a sentence
REFUSED_SHARE = 0.1  # of readings beyond the greatest power that is worth a sentence
MAX_WAITING = 4096  # intervals whose sums are made together

Sums = list[int]  # compared time [ns], measured energy [nJ], predicted energy [nJ]


class MeterDiagnostics:
    """Watches the residual over the newest minute that was compared.

    Sums are integers, so that they do not depend on how the input is cut.

    Args:
        unit: Unit the meter was said to use; empty for W or J.
    """

    def __init__(self, unit: str = "") -> None:
        self._unit = unit
        self._seconds: deque[tuple[int, Sums]] = deque()
        self._total: Sums = [0, 0, 0]
        self._waiting: list[Compared] = []
        self._drawn = self._returned = self._predicted_returned = 0  # since the start [nJ]

    def step(self, compared: Compared) -> None:
        """Take what became comparable."""
        if not len(compared):
            return
        self._waiting.append(compared)
        if sum(map(len, self._waiting)) >= MAX_WAITING:
            self._settle()

    @property
    def _sum(self) -> Sums:
        """Over the newest minute."""
        self._settle()
        return self._total

    def _settle(self) -> None:
        """Count what waits; how it was cut makes no difference."""
        if not self._waiting:
            return
        compared = Compared.concatenate(self._waiting)
        self._waiting.clear()
        second = compared.stamp_ns // SECOND_NS
        measured = np.rint(compared.measured * NANOJOULE_PER_JOULE).astype(np.int64)
        predicted = np.rint(compared.drawn * NANOJOULE_PER_JOULE).astype(np.int64)
        self._drawn += int(measured[measured > 0].sum())
        self._returned -= int(measured[measured < 0].sum())
        self._predicted_returned -= int(predicted[predicted < 0].sum())
        starts = np.concatenate([[0], np.flatnonzero(np.diff(second)) + 1])
        table = np.stack([compared.duration_ns, measured, predicted], axis=1)
        sums = np.add.reduceat(table, starts, axis=0)
        for number, row in zip(second[starts].tolist(), sums.tolist(), strict=True):
            self._add(number, row)

    def _add(self, second: int, sums: Sums) -> None:
        seconds = self._seconds
        if seconds and second < seconds[-1][0]:
            seconds.clear()  # the recording loops
            self._total = [0, 0, 0]
        if seconds and second == seconds[-1][0]:
            seconds[-1][1][:] = [a + b for a, b in zip(seconds[-1][1], sums, strict=True)]
        else:
            seconds.append((second, list(sums)))
        self._total = [a + b for a, b in zip(self._total, sums, strict=True)]
        while seconds[0][0] <= second - WINDOW:
            _, old = seconds.popleft()
            self._total = [a - b for a, b in zip(self._total, old, strict=True)]

    @property
    def compared_time(self) -> float:
        """Compared time within the newest minute. [s]"""
        return self._sum[0] * NANOSECOND

    @property
    def residual_share(self) -> float:
        """Predicted minus measured energy of the newest minute, relative to measured. [-]

        NaN where nothing was compared or measured.
        """
        _, measured, predicted = self._sum
        return (predicted - measured) / abs(measured) if measured else math.nan

    def findings(self, comparison: Comparison) -> list[str]:
        """Return what is wrong with the meter, one sentence each."""
        scale = self._scale(comparison)
        found = (self._clock(comparison), scale or self._fed_back(), _refused(comparison))
        return [sentence for sentence in found if sentence]

    def _fed_back(self) -> str:
        """Whether the meter sees energy returned that the model cannot predict."""
        self._settle()
        share = self._returned / self._drawn if self._drawn else 0.0
        if self._predicted_returned or share < MIN_RETURNED:
            return ""
        return (
            f"by the meter, {100 * share:.0f} % of the energy drawn is fed back, but the model "
            "predicts none: if the supply or a battery takes energy back, state "
            "cabinet.regeneration_efficiency in the model file"
        )

    def _clock(self, comparison: Comparison) -> str:
        """Why nothing is compared although readings and predictions arrive."""
        idle, curve = comparison.idle, comparison.curve
        if idle is None or idle.ahead_ns is None:
            return ""
        readings = curve.rejections.accepted - idle.readings
        silent = idle.until_ns - idle.since_ns > IDLE_NS and readings >= READINGS
        period_ns = curve.spacing_ns or 0
        apart = silent and (idle.ahead_ns > EARLY_NS or -idle.ahead_ns > EARLY_NS + period_ns)
        early = comparison.early_since_ns
        if apart or (early is not None and idle.until_ns - early > SUSTAINED_NS):
            ahead = idle.ahead_ns * NANOSECOND
            way = "ahead of" if ahead > 0 else "behind"
            return (
                f"the stamps of the meter are {abs(ahead):.1f} s {way} those of the joint states: "
                f"synchronise the clocks, or set the meter's stamp_offset to {-ahead:.1f}"
            )
        if silent and curve.gaps - idle.gaps >= readings - 1:
            return (
                f"nothing is compared: readings of the meter are {period_ns * NANOSECOND:.1f} s "
                "apart, which is more than meter_max_gap: raise it"
            )
        still = curve.counter.still_since_ns
        newest = curve.newest_ns
        if silent and comparison.meaning is MeterMeaning.CUMULATIVE and still and newest:
            return (
                "nothing is compared: the counter of the meter has not moved for "
                f"{(newest - still) * NANOSECOND:.0f} s"
            )
        return ""

    def _scale(self, comparison: Comparison) -> str:
        """Whether the meter is off by a factor that only a unit or a sign explains."""
        _, measured, predicted = self._sum
        if self.compared_time < MIN_GROSS_TIME or not measured or not predicted:
            return ""
        settled = self.compared_time >= MIN_COMPARED_TIME
        ratio = measured / predicted
        if -MAX_RATIO < 1 / ratio < -1 / MAX_RATIO and (settled or self._turned()):
            return "the meter reads about minus the prediction: is its sign load_negative?"
        if ratio <= 0:
            return ""
        units = ENERGY_UNITS if comparison.meaning is MeterMeaning.CUMULATIVE else POWER_UNITS
        base = "J" if units is ENERGY_UNITS else "W"
        said = self._unit if self._unit in units else base
        # Read in `unit` instead of `said`, the meter would give measured * units[unit] / said.
        doubt = {
            unit: abs(math.log(ratio * factor / units[said])) for unit, factor in units.items()
        }
        unit = min(doubt, key=lambda name: doubt[name])
        if unit == said or doubt[unit] > math.log(MAX_RATIO) or doubt[said] <= math.log(MAX_RATIO):
            return ""
        factor = units[unit] / units[said]
        if not settled and max(factor, 1 / factor) < GROSS_FACTOR:
            return ""
        text = f"{ratio:.3g}" if ratio < 1 else f"{ratio:.0f}"
        return f"the meter reads about {text} times the prediction: is its unit {unit}?"

    def _turned(self) -> bool:
        """Whether power is drawn in every second, and returned by the meter."""
        return all(measured < 0 < predicted for _, (_, measured, predicted) in self._seconds)


def _refused(comparison: Comparison) -> str:
    """Whether many readings are beyond any power."""
    curve = comparison.curve
    count = curve.rejections.rejected["meter_implausible"]
    if count < READINGS or count < REFUSED_SHARE * curve.rejections.received:
        return ""
    return (
        f"{count} of {curve.rejections.received} readings of the meter state or imply more than "
        "max_power: check the unit of the meter"
    )
