"""Does the power meter fit the prediction: sign, unit, clock, and what the shafts can explain?"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float, MeterBlock, MeterMeaning
from robot_energy.timeline.pieces import CoveredPieces
from robot_energy_identify.check import remedies
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.finding import ERROR, WARNING, Finding, unjudged
from robot_energy_identify.check.meter_step import step_of

MIN_INTERVALS = 20
MIN_CORRELATION = 0.4
UNITS = {"kW instead of W, or kWh instead of Wh": 1e-3, "W instead of kW": 1e3,
         "Wh or J mixed up": 1 / 3600.0, "J instead of Wh": 3600.0}  # fmt: skip
NEAR = 0.7  # of the logarithm of a factor: a factor of two
MAX_LAG = 2.0  # s
MIN_SPAN = 10.0  # s of recording, below which no delay can be found
MIN_LAG = 0.15  # s, below which a delay is the meter's own averaging
LEAST_LAG = 0.3  # s: the least delay that is to be found
LAG_STEP = 0.02  # s
FAR_LAG = 10.0  # s: clocks that are off by up to this are found
FAR_STEP = 0.1  # s
APART = 5.0  # times the usual step, beyond which samples or readings do not follow each other
LEAST_RATIO = 0.1  # of meter and prediction, below which one of them is wrong
MAX_EXCESS = 2.0  # of the meter over the prediction
BODIES = (
    "joint_sign",
    "zero_offset",
    "joint_order",
    "payload",
    "gear_ratio",
    "other_robot",
)  # spoil predictions
TORQUES = (
    *BODIES,
    "torque_sign",
    "torque_scale",
    "effort_meaning",
    "effort_held",
    "effort_late",
    "effort_unsigned",
)  # spoil shaft powers
MOST_HELD, REGULAR = 0.9, 0.7  # share of the runs of equal readings: two or more, as the usual
ONE_STEP = 1.5  # times the least change of a meter, below which a change is one step of it
LONGEST = 1.5  # usual intervals that a reading may stand for
MIN_LAG_GAIN = 0.25  # share of the unexplained variance that a lag must take away


class MeterLag(Described):
    """How far the readings of a meter are behind the joint states."""

    lag: Annotated[float, "Negative for readings that are ahead. [s]"]
    gain: Annotated[float, "Share of what is left unexplained that it takes away. [-]"]
    shown: Annotated[bool, "Whether that is enough for a lag."]


def check_meter(evidence: Evidence, wrong: Sequence[str] = ()) -> tuple[list[Finding], str]:
    """Return findings on the meter against the predicted power, and why there cannot be any."""
    if evidence.meter is None or evidence.supply is None:
        return [], "the recording has no power meter"
    time, measured = _measured(evidence)
    findings = [Finding("meter", WARNING, ("meter",), note) for note in evidence.remarks.meter]
    findings += _held(evidence)
    predicted = _predicted(evidence, time)(0.0)
    both = np.isfinite(measured) & np.isfinite(predicted)
    if int(both.sum()) < MIN_INTERVALS:
        why = f"{int(both.sum())} readings have a prediction; {MIN_INTERVALS} are needed"
        return findings, why
    measured_mean, predicted_mean = float(measured[both].mean()), float(predicted[both].mean())
    if measured_mean < 0.0 < predicted_mean:
        findings.append(
            Finding(
                "meter_sign", ERROR, ("meter",),
                f"the meter reads {measured_mean:.3g} W on average where the robot takes about "
                f"{predicted_mean:.3g} W: its sign is reversed",
                measured_mean, *remedies.meter(evidence, sign=True),
            )
        )  # fmt: skip
        measured, measured_mean = -measured, -measured_mean
    ratio = measured_mean / predicted_mean if predicted_mean > 0.0 else float("nan")
    for words, factor in UNITS.items():
        if ratio > 0.0 and abs(np.log(ratio / factor)) < NEAR:
            findings.append(
                Finding(
                    "meter_unit", ERROR, ("meter",),
                    f"the meter reads {ratio:.2g} times the prediction, as with {words}",
                    ratio, *remedies.meter(evidence, scale=1.0 / factor),
                )
            )  # fmt: skip
            measured = measured / factor
            break
    else:
        if 0.0 < ratio < LEAST_RATIO:
            why = f"it reads {ratio:.2g} times the prediction of {predicted_mean:.3g} W"
            findings.append(unjudged("meter_unit", ("meter",), "the unit of the meter", why))
    spoilt = [one for one in wrong if one in BODIES]
    lag = f"correct {spoilt[0]} first" if spoilt else _lag_of(evidence, time, measured)
    findings += _lag(evidence, lag)
    if not any(one in TORQUES for one in wrong):
        findings += _balance(evidence, measured[both], predicted[both])
        findings += _step(evidence, lag)
    return findings, ""


def _measured(evidence: Evidence) -> tuple[Float, Float]:
    """Middle of each interval [s] and mean power in it [W]."""
    meter = evidence.meter
    assert meter is not None
    time = (meter.stamp_ns - evidence.stamp_ns[0]) * NANOSECOND
    if meter.meaning is MeterMeaning.CUMULATIVE and len(meter) < 2:
        return time[:0], time[:0]
    if meter.meaning is MeterMeaning.CUMULATIVE:
        source, gap = evidence.inputs.meter, APART * float(np.median(np.diff(time)))
        limits = MeterLimits(
            max(gap, evidence.inputs.meter_max_gap), source.max_power, source.wraps_at_joule
        )
        pieces = CoveredPieces.concatenate(limits.pieces(meter))
        begin, end = (at - evidence.stamp_ns[0] for at in (pieces.stamp_ns, pieces.end_ns))
        return 0.5 * (begin + end) * NANOSECOND, pieces.mean_power
    half = np.where(np.isfinite(meter.interval), 0.5 * meter.interval, 0.0)
    return time - half, meter.power


def _predicted(evidence: Evidence, time: Float) -> Callable[[float], Float]:
    """Predicted power at the meter by their lag, averaged over the spacing of the readings. [W]"""
    power, meter = evidence.supply, evidence.meter
    assert power is not None
    assert meter is not None
    at = (power.stamp_ns - evidence.stamp_ns[0]) * NANOSECOND
    values = power.power_at(meter.location)
    good = np.isfinite(values)
    at, values = at[good], values[good]
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(at))])
    steps = np.diff(time)
    steps = steps[steps > 0.0]  # some meters repeat a stamp
    spacing = float(np.median(steps)) if len(steps) else 0.1
    width = 0.5 * (spacing if meter.meaning is not MeterMeaning.INSTANTANEOUS else 0.02)
    step = np.diff(at, prepend=at[:1])
    gaps = np.cumsum(step > APART * np.median(step) + width)  # between windows of a recording

    def behind(lag: float) -> Float:
        low, high = time - lag - width, time - lag + width
        mean = (np.interp(high, at, energy) - np.interp(low, at, energy)) / (2 * width)
        mean[(low < at[0]) | (high > at[-1])] = np.nan
        first, last = (np.searchsorted(at, low, "right") - 1, np.searchsorted(at, high))
        mean[gaps[np.maximum(first, 0)] != gaps[np.minimum(last, len(at) - 1)]] = np.nan
        return np.asarray(mean)

    return behind


def _unexplained(measured: Float, predicted: Float) -> float:
    """Share of the measured variance that a straight line through the prediction leaves."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    if int(both.sum()) < MIN_INTERVALS:
        return 1.0
    x, y = predicted[both] - predicted[both].mean(), measured[both] - measured[both].mean()
    if not (x @ x > 0.0 and y @ y > 0.0):
        return 1.0
    return 1.0 - float(x @ y) ** 2 / (float(x @ x) * float(y @ y))


def lag_of(evidence: Evidence) -> MeterLag | str:
    """Return how far the readings are behind the joint states, or why that cannot be judged."""
    assert evidence.meter is not None
    return _lag_of(evidence, *_measured(evidence))


def _lag_of(evidence: Evidence, time: Float, measured: Float) -> MeterLag | str:
    if len(time) < MIN_INTERVALS or time[-1] - time[0] < MIN_SPAN:
        span = float(np.ptp(time)) if len(time) else 0.0
        return f"{span:.1f} s of readings, {MIN_SPAN:.0f} s are needed"

    behind = _predicted(evidence, time)

    def unexplained(lags: Float) -> Float:
        return np.array([_unexplained(measured, behind(lag)) for lag in lags])

    lags = np.arange(-MAX_LAG, MAX_LAG + 1e-9, LAG_STEP)
    left = unexplained(lags)
    now = float(left[int(np.argmin(np.abs(lags)))])
    best, most = int(np.argmin(left)), 1.0 - MIN_CORRELATION**2
    reach = min(FAR_LAG, float(time[-1] - time[0]) / 3.0)
    far = np.arange(-reach, reach + 1e-9, FAR_STEP)
    left_far = unexplained(far)
    least = float(left_far.min())
    nearer = 1.0 - least / float(left[best]) < MIN_LAG_GAIN + least
    if left[best] > most or best in (0, len(lags) - 1) or not nearer:  # a clock is further off
        lags = far[int(np.argmin(left_far))] + lags
        left = unexplained(lags)
        best = int(np.argmin(left))
    if left[best] > most or best in (0, len(lags) - 1):
        return f"the prediction explains {100 * (1 - left[best]):.0f} % of its readings"
    away = round(LEAST_LAG / LAG_STEP)
    near = [left[place] for place in (best - away, best + away) if 0 <= place < len(lags)]
    needed = MIN_LAG_GAIN + float(left[best])  # friction and losses that are off look like a lag
    if 1.0 - float(left[best]) / min(near) < needed:
        return f"a shift of {LEAST_LAG:g} s changes too little of what the prediction explains"
    gain = 1.0 - float(left[best]) / now if now > 0.0 else 0.0
    return MeterLag(float(lags[best]), gain, gain >= needed)


def _lag(evidence: Evidence, found: MeterLag | str) -> list[Finding]:
    """Whether the readings are behind or ahead, or why that cannot be judged."""
    if isinstance(found, str):
        return [unjudged("meter_clock", ("meter",), "the clock of the meter", found)]
    lag, gain = found.lag, found.gain
    stated = MeterResponse.of(evidence.model) or MeterResponse()
    late = lag - stated.time_constant - stated.delay
    if min(abs(lag), abs(late)) < MIN_LAG or not found.shown:
        return []
    return [
        Finding(
            "meter_clock", ERROR, ("meter",),
            f"the meter is {abs(lag):.2f} s {'behind' if lag > 0 else 'ahead of'} the joint states "
            f"(shifted, the prediction explains {100 * gain:.0f} % of what is left unexplained)",
            lag, *remedies.meter(evidence, delay=late),
        )
    ]  # fmt: skip


def readings_once(meter: MeterBlock) -> tuple[MeterBlock, str]:
    """Return each reading once where all of them are repeated, and a sentence that says so.

    They stand for the time since the one before. The slope of readings that are held is a
    staircase, which no low pass of a meter is. Changes by the least step do not count: by the
    resolution of a meter, power that hardly changes is a staircase, too.
    """
    size = np.abs(np.diff(meter.power))
    changes = np.flatnonzero(size != 0.0) + 1
    size = size[changes - 1]
    runs = np.diff(changes)[size[:-1] > ONE_STEP * np.nanmin(size, initial=np.inf)]
    if meter.meaning is MeterMeaning.CUMULATIVE or len(runs) < MIN_INTERVALS:
        return meter, ""
    usual = int(np.median(runs))
    if (runs > 1).mean() < MOST_HELD or (np.abs(runs - usual) <= 1).mean() < REGULAR:
        return meter, ""
    step_ns = int(np.median(np.diff(meter.stamp_ns)))
    since = np.arange(int(changes[0]), len(meter))
    run = np.searchsorted(changes, since, "right") - 1
    since -= changes[run]
    times = np.maximum(np.rint(np.diff(changes, append=len(meter)) / usual), 1.0)[run]
    once = meter[changes[0] :][(since % usual == 0) & (since < times * usual)]
    if once.meaning is MeterMeaning.MEAN_OVER_INTERVAL:
        apart = np.diff(once.stamp_ns, prepend=once.stamp_ns[0] - usual * step_ns)
        longest = round(LONGEST * usual * step_ns)
        once = replace(once, interval=np.minimum(apart, longest) * NANOSECOND)
    every = step_ns * NANOSECOND
    return once, (
        f"readings of the meter come every {every:.2g} s, but change every {usual * every:.2g} s"
    )


def _held(evidence: Evidence) -> Iterator[Finding]:
    assert evidence.meter is not None
    _, held = readings_once(evidence.meter)
    if held:
        yield Finding(
            "meter_held", WARNING, ("meter",), held,
            remedy="record each reading once, with the interval that it stands for",
        )  # fmt: skip


def _step(evidence: Evidence, lag: MeterLag | str) -> list[Finding]:
    """Whether the readings step at the same predicted power."""
    meter, power = evidence.meter, evidence.supply
    assert meter is not None
    assert power is not None
    response = MeterResponse.of(evidence.model)
    if response is None:
        response = MeterResponse(0.0 if isinstance(lag, str) else max(lag.lag, 0.0))
    comparison = Comparison(evidence.inputs.meter_max_gap, response=response)
    comparison.measure(meter)
    compared = comparison.predict(power.stamp_ns, power.segment, power.power_at(meter.location))
    found = step_of(compared, int(evidence.stamp_ns[0]))
    return [] if found is None else [found]


def _balance(evidence: Evidence, measured: Float, predicted: Float) -> Iterator[Finding]:
    """Whether the meter shows less than the shafts take, or far more than the model explains."""
    mean, expected = float(measured.mean()), float(predicted.mean())
    shaft = evidence.shaft_power
    taken = 0.0
    if evidence.effort is not EffortMeaning.NONE and shaft is not None:
        known = shaft[:, np.isfinite(shaft).any(axis=0)]
        taken = float(np.nanmean(known, axis=0).sum())
    if taken > 1.1 * mean and taken > 5.0:
        yield Finding(
            "shafts_exceed_meter", ERROR, ("meter",),
            f"the shafts take {taken:.0f} W on average by the recorded torque, more than the "
            f"{mean:.0f} W of the meter",
            taken / mean if mean else float("inf"),
            "check the scale of the torque, and the unit, the place and the phases of the meter: "
            "one of three shows a third",
        )  # fmt: skip
    elif mean > MAX_EXCESS * expected > 0.0:
        yield Finding(
            "meter_exceeds", WARNING, ("meter",),
            f"the meter reads {mean:.0f} W on average, {mean / expected:.2g} times the "
            f"{expected:.0f} W that shafts, friction and losses of the model explain",
            mean / expected,
            "identify the constant losses (robot-energy identify cabinet), or look for another "
            "load on the meter",
        )  # fmt: skip
