"""Does the power meter fit the prediction: sign, unit, clock, and what the shafts can explain?"""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, MeterMeaning
from robot_energy.check.evidence import Evidence
from robot_energy.check.finding import ERROR, WARNING, Finding

MIN_INTERVALS = 20
MIN_CORRELATION = 0.4
UNITS = {"kW instead of W, or kWh instead of Wh": 1e-3, "W instead of kW": 1e3,
         "Wh or J mixed up": 1 / 3600.0, "J instead of Wh": 3600.0}  # fmt: skip
NEAR = 0.7  # of the logarithm of a factor: a factor of two
MAX_LAG = 2.0  # s
MIN_SPAN = 10.0  # s of recording, below which no delay is told from the motion
MIN_LAG = 0.15  # s, below which a delay is the meter's own averaging
MIN_LAG_GAIN = 0.25  # share of the unexplained variance that a lag must take away


def check_meter(evidence: Evidence) -> tuple[list[Finding], str]:
    """Compare the meter with the predicted power at its place.

    Args:
        evidence: The recording.

    Returns:
        The findings, and why there are none where the check cannot be made.
    """
    if evidence.meter is None or evidence.power is None or evidence.replay is None:
        return [], "the recording has no power meter"
    time, measured = _measured(evidence)
    if len(time) < MIN_INTERVALS:
        return [], f"the meter has {len(time)} readings; {MIN_INTERVALS} are needed"
    ledger = evidence.replay.ledger
    notes = ledger.judgement.findings(ledger.comparison)
    findings = [
        Finding("meter", WARNING, ("meter",), note, float("nan"), float("nan")) for note in notes
    ]
    predicted = _predicted(evidence, time, 0.0)
    both = np.isfinite(measured) & np.isfinite(predicted)
    if int(both.sum()) < MIN_INTERVALS:
        return findings, ""
    measured_mean, predicted_mean = float(measured[both].mean()), float(predicted[both].mean())
    if measured_mean < 0.0 < predicted_mean:
        findings.append(
            Finding(
                "meter_sign", ERROR, ("meter",),
                f"the meter reads {measured_mean:.0f} W on average where the robot takes about "
                f"{predicted_mean:.0f} W: its sign is reversed",
                measured_mean, 0.95, "meter: {sign: load_negative}",
            )
        )  # fmt: skip
        measured = -measured
        measured_mean = -measured_mean
    ratio = measured_mean / predicted_mean if predicted_mean > 0.0 else float("nan")
    for words, factor in UNITS.items():
        if ratio > 0.0 and abs(np.log(ratio / factor)) < NEAR:
            unit = "kW" if factor < 1 else "W"
            findings.append(
                Finding(
                    "meter_unit", ERROR, ("meter",),
                    f"the meter reads {ratio:.2g} times the prediction, as with {words}",
                    ratio, 0.9, f"meter: {{unit: {unit}}} (or scale: {1 / factor:g})",
                )
            )  # fmt: skip
            measured = measured / factor
            ratio /= factor
            break
    findings += _lag(evidence, time, measured)
    findings += _shafts(evidence, measured[both])
    return findings, ""


def _measured(evidence: Evidence) -> tuple[Float, Float]:
    """Middle of each interval [s] and mean power in it [W]."""
    meter = evidence.meter
    assert meter is not None
    time = (meter.stamp_ns - evidence.stamp_ns[0]) * NANOSECOND
    if meter.meaning is MeterMeaning.CUMULATIVE:
        step = np.diff(time)
        good = step > 0
        return (0.5 * (time[1:] + time[:-1]))[good], (np.diff(meter.energy)[good] / step[good])
    half = np.where(np.isfinite(meter.interval), 0.5 * meter.interval, 0.0)
    return time - half, meter.power


def _predicted(evidence: Evidence, time: Float, lag: float) -> Float:
    """Predicted power at the meter, averaged over the spacing of the readings. [W]"""
    power, meter = evidence.power, evidence.meter
    assert power is not None
    assert meter is not None
    at = (power.stamp_ns - evidence.stamp_ns[0]) * NANOSECOND
    values = power.supply.power_at(meter.location)
    good = np.isfinite(values)
    at, values = at[good], values[good]
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(at))])
    spacing = float(np.median(np.diff(time))) if len(time) > 1 else 0.1
    width = 0.5 * (spacing if meter.meaning is not MeterMeaning.INSTANTANEOUS else 0.02)
    low, high = time - lag - width, time - lag + width
    mean = (np.interp(high, at, energy) - np.interp(low, at, energy)) / (2 * width)
    mean[(low < at[0]) | (high > at[-1])] = np.nan
    return np.asarray(mean)


def _unexplained(measured: Float, predicted: Float) -> float:
    """Share of the measured variance that a straight line through the prediction leaves."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    if int(both.sum()) < MIN_INTERVALS:
        return 1.0
    x, y = predicted[both] - predicted[both].mean(), measured[both] - measured[both].mean()
    if not (x @ x > 0.0 and y @ y > 0.0):
        return 1.0
    return 1.0 - float(x @ y) ** 2 / (float(x @ x) * float(y @ y))


def _lag(evidence: Evidence, time: Float, measured: Float) -> list[Finding]:
    if time[-1] - time[0] < MIN_SPAN:
        return []
    lags = np.arange(-MAX_LAG, MAX_LAG + 1e-9, 0.02)
    left = np.array([_unexplained(measured, _predicted(evidence, time, lag)) for lag in lags])
    best = int(np.argmin(left))
    now = float(left[int(np.argmin(np.abs(lags)))])
    lag, gain = float(lags[best]), 1.0 - float(left[best]) / now if now > 0.0 else 0.0
    if (
        best in (0, len(lags) - 1)
        or abs(lag) < MIN_LAG
        or gain < MIN_LAG_GAIN
        or left[best] > 1.0 - MIN_CORRELATION**2
    ):
        return []
    return [
        Finding(
            "meter_clock", ERROR, ("meter",),
            f"the meter is {abs(lag):.2f} s {'behind' if lag > 0 else 'ahead of'} the joint states "
            f"(shifted, the prediction explains {100 * gain:.0f} % of what is left unexplained)",
            lag, gain, f"meter: {{stamp_offset: {-lag:.2f}}}",
        )
    ]  # fmt: skip


def _shafts(evidence: Evidence, measured: Float) -> list[Finding]:
    """Whether the meter shows less than the measured shafts alone take."""
    power = evidence.power
    assert power is not None
    shaft = power.shaft_power_measured
    if not bool(np.isfinite(shaft).any()):
        return []
    taken = float(np.nansum(np.nanmean(shaft, axis=0)))
    mean = float(np.nanmean(measured))
    if taken > 1.1 * mean and taken > 5.0:
        return [
            Finding(
                "shafts_exceed_meter", ERROR, ("meter",),
                f"the shafts take {taken:.0f} W on average by the recorded torque, more than the "
                f"{mean:.0f} W of the meter",
                taken / mean if mean else float("inf"), float("nan"),
                "check the scale of the torque, the unit of the meter, and its place",
            )
        ]  # fmt: skip
    return []
