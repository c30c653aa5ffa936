"""What the difference between meter and prediction says, in sentences."""

from __future__ import annotations

import math

from robot_energy.accounting.comparison import EARLY_NS, Comparison
from robot_energy.foundation.units import ENERGY_UNITS, POWER_UNITS, SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, MeterMeaning

MIN_COMPARED_TIME = 30.0  # compared time in it before a unit is doubted [s]
MIN_GROSS_TIME = 8.0  # the same of a unit a thousand times as large, or of a turned sign [s]
GROSS_FACTOR = 1000.0
MAX_RATIO = 1.8  # ratios this far from a unit's, either way, still point at it; 3.6 = 2 * 1.8
IDLE_NS = 10 * SECOND_NS  # prediction without comparison that is worth a sentence
SUSTAINED_NS = 30 * SECOND_NS  # readings from the future for so long are a wrong clock
READINGS = 3  # that must have arrived meanwhile
MIN_RETURNED = 0.02  # of the measured energy drawn, fed back without prediction, worth a sentence
REFUSED_SHARE = 0.1  # of readings beyond the greatest power that is worth a sentence


class MeterDiagnostics:
    """Says what is wrong with the meter; an empty unit is W or J."""

    def __init__(self, unit: str = "") -> None:
        self._unit = unit

    def findings(self, comparison: Comparison, ended: bool = False) -> list[str]:
        """Return what is wrong with the meter, one sentence each.

        Args:
            ended: Whether what was wrong for a time only is named as well, as of a recording.
        """
        scale = self._scale(comparison)
        found = (
            self._clock(comparison), scale or _fed_back(comparison), _refused(comparison),
            _still(comparison, ended),
        )  # fmt: skip
        return [sentence for sentence in found if sentence]

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
        minute = comparison.minute
        _, measured, predicted = minute.sums
        if minute.time < MIN_GROSS_TIME or not measured or not predicted:
            return ""
        settled = minute.time >= MIN_COMPARED_TIME
        # whether power is drawn in every second, and returned by the meter
        turned = all(given < 0 < drawn for _, (_, given, drawn) in minute.seconds)
        if -MAX_RATIO < predicted / measured < -1 / MAX_RATIO and (settled or turned):
            return "the meter reads about minus the prediction: is its sign load_negative?"
        found = self._unit_asked(measured / predicted, comparison.meaning, gross=not settled)
        if found or not settled:
            return found
        _, measured, predicted = minute.newest(MIN_GROSS_TIME)  # it may have changed its unit
        ratio = measured / predicted if predicted else 0.0
        return self._unit_asked(ratio, comparison.meaning, gross=True)

    def _unit_asked(self, ratio: float, meaning: MeterMeaning, gross: bool) -> str:
        """Ask for the unit that explains how many times the prediction the meter reads."""
        if ratio <= 0:
            return ""
        units = ENERGY_UNITS if meaning is MeterMeaning.CUMULATIVE else POWER_UNITS
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
        if gross and max(factor, 1 / factor) < GROSS_FACTOR:
            return ""
        text = f"{ratio:.3g}" if ratio < 1 else f"{ratio:.0f}"
        return f"the meter reads about {text} times the prediction: is its unit {unit}?"


def _fed_back(comparison: Comparison) -> str:
    """Whether the meter sees energy returned that the model cannot predict."""
    share = comparison.minute.returned_share
    if share < MIN_RETURNED:
        return ""
    return (
        f"by the meter, {100 * share:.0f} % of the energy drawn is fed back, but the model "
        "predicts none: if the supply or a battery takes energy back, state "
        "cabinet.regeneration_efficiency in the model file"
    )


def _still(comparison: Comparison, ended: bool) -> str:
    """Whether the meter repeats a reading while the robot works."""
    if comparison.meaning is MeterMeaning.CUMULATIVE:  # level between two changes of its counter
        return ""
    still = comparison.minute.still
    seconds, power = max(still.open, still.longest) if ended else still.open
    if not seconds:
        return ""
    return (
        f"the meter reads the same {power:.6g} W for {seconds:.0f} s while the predicted power "
        "changes: does its driver repeat an old reading?"
    )


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
