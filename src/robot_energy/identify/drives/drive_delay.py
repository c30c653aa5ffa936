"""Delay between the measured power of the drives and the joint states, from the data.

A drive reports its power on another way than its position: filtered, or in a message of its
own that counts from when it was recorded. As with torque (`identify.delay`), every delay in a
range is tried on blocks that the fit has not seen; the fit is shaft power and the columns of
the losses (`identify.losses`), all with free factors, of each drive. Shifts are whole samples
of the joint states, so that no interpolation smooths the noise of some of them only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int
from robot_energy.identify.drive_data import DriveData
from robot_energy.identify.losses import loss_columns
from robot_energy.identify.quality import folds_in_order
from robot_energy.identify.triangle import triangle_of

SPAN = 0.1  # s: delays up to this are tried,
SHARE = 0.01  # and up to this share of the recorded time: seconds of motion hide long ones
STEPS = 25  # on each side of zero, at most
FOLDS = 5
LEAST_GAIN = 0.05  # of the held-out error: a second of motion has 1 % for chance delays
SIGNIFICANT = 3.0  # standard deviations
LEAST_ROWS = 200
CHUNK = 50_000  # rows compressed at once, so that memory does not grow with the recording


@dataclass(frozen=True)
class PowerDelay:
    """The estimate and what it rests on.

    Attributes:
        value: By which the power lags the joint states, at the least held-out error. [s]
        std: From leaving out each block in turn. [s]
        gain: Share of the held-out error it takes away. [-]
        applied: The value where it is significant: a gain of 5 % or more, three standard
            deviations from 0, and not at the end of the range; else 0. [s]
        at_edge: Whether the least error is at the end of the range.
        span: Delays up to this were tried. [s]
    """

    value: float
    std: float
    gain: float
    applied: float
    at_edge: bool
    span: float


def estimate_power_delay(data: DriveData, span: float = SPAN) -> PowerDelay | None:
    """Estimate one delay for all drives.

    Args:
        data: Samples of all drives, power as recorded.
        span: Delays from minus to plus this are tried, a hundredth of the recorded time at
            most. [s]

    Returns:
        The estimate; None where the samples are too few to tell.
    """
    period = data.period
    if not np.isfinite(period) or period <= 0.0:
        return None
    reach = max(3, round(min(span, SHARE * len(data) * period) / period))
    stride = -(-reach // STEPS)
    lags = stride * np.arange(-(reach // stride), reach // stride + 1)
    curves = [
        curve
        for joint in range(len(data.names))
        if (curve := _curve(data, joint, lags)) is not None
    ]
    if not curves:
        return None
    # Every drive counts by its noise: what is left at its own best delay.
    error = np.zeros_like(curves[0])
    for curve in curves:
        error += curve / max(float(curve.sum(axis=0).min()), np.finfo(float).tiny)
    middle = len(lags) // 2
    return delay_of(error, lags * period, error[:, middle], float(lags[-1]) * period)


def delay_of(error: Float, delays: Float, undelayed: Float, span: float) -> PowerDelay:
    """Return the delay of least error and whether to believe it.

    Args:
        error: Squared held-out error by block and delay, shape (blocks, delays).
        delays: Evenly spaced, shape (delays,). [s]
        undelayed: Squared held-out error without a delay, shape (blocks,).
        span: Delays up to this were tried. [s]
    """
    count, step = len(error), float(delays[1] - delays[0])
    place, least = _least(error.sum(axis=0))
    value = float(delays[0]) + place * step
    left_out = [_least(error.sum(axis=0) - part)[0] * step for part in error]
    std = float(np.sqrt((count - 1) * np.var(left_out)))
    gain = 1.0 - float(np.sqrt(max(least, 0.0) / float(undelayed.sum())))
    at_edge = place in (0.0, len(delays) - 1.0)
    believed = gain >= LEAST_GAIN and abs(value) > SIGNIFICANT * std and not at_edge
    return PowerDelay(value, std, gain, value if believed else 0.0, at_edge, span)


def with_delay_undone(data: DriveData, delay: float) -> DriveData:
    """Return the samples with the power of the drives as it is a while later.

    Args:
        data: Samples of all drives.
        delay: By which the power lags. [s]

    Returns:
        The same rows; NaN where a stretch ends before the power arrives.
    """
    if delay == 0.0:
        return data
    power = np.full_like(data.drive_power, np.nan)
    wanted = data.stamp_ns + round(delay / NANOSECOND)
    for number in np.unique(data.stretch):
        rows = np.flatnonzero(data.stretch == number)
        origin = data.stamp_ns[rows[0]]
        time, later = data.stamp_ns[rows] - origin, wanted[rows] - origin
        for joint in range(power.shape[1]):
            # NaN beside an instant makes its interpolation NaN: nothing is bridged.
            power[rows, joint] = np.interp(
                later, time, data.drive_power[rows, joint], left=np.nan, right=np.nan
            )
    return replace(data, drive_power=power)


def _curve(data: DriveData, joint: int, lags: Int) -> Float | None:
    """Squared held-out error of one drive, by fold and lag, shape (folds, lags)."""
    rows = _rows(data, joint, lags)
    if len(rows) < LEAST_ROWS:
        return None
    fold = folds_in_order(len(rows), FOLDS)
    triangles: list[Float] = []
    for number in range(FOLDS):
        part = rows[fold == number]
        triangle = np.zeros((0, 5 + len(lags)))
        for first in range(0, len(part), CHUNK):
            some = part[first : first + CHUNK]
            columns = loss_columns(
                data.motor_velocity[some, joint],
                data.motor_torque[some, joint],
                data.motor_temperature_degc[some, joint],
            )
            target = data.drive_power[some[:, None] + lags, joint]
            both = np.column_stack([columns, data.shaft_power[some, joint], target])
            triangle = triangle_of(np.concatenate([triangle, both]))
        triangles.append(triangle)
    curve = np.zeros((FOLDS, len(lags)))
    for number, held in enumerate(triangles):
        train = np.concatenate([part for other, part in enumerate(triangles) if other != number])
        triangle = triangle_of(train)
        values = np.linalg.lstsq(triangle[:5, :5], triangle[:5, 5:], rcond=None)[0]
        curve[number] = ((held[:, :5] @ values - held[:, 5:]) ** 2).sum(axis=0)
    return curve


def _rows(data: DriveData, joint: int, lags: Int) -> Int:
    """Rows with torque, speed and, at every lag, power; the same rows for all lags."""
    row = np.arange(len(data))
    first = np.searchsorted(data.stretch, data.stretch, side="left")
    last = np.searchsorted(data.stretch, data.stretch, side="right") - 1
    inside = (row + lags[0] >= first) & (row + lags[-1] <= last)
    rows = row[inside & np.isfinite(data.shaft_power[:, joint])]
    known = np.concatenate([[0], np.cumsum(np.isfinite(data.drive_power[:, joint]))])
    whole = known[rows + lags[-1] + 1] - known[rows + lags[0]] == lags[-1] - lags[0] + 1
    return rows[whole]


def _least(error: Float) -> tuple[float, float]:
    """Place of the least error and the error there, by the parabola through its neighbours."""
    best = int(np.argmin(error))
    if best in (0, len(error) - 1):
        return float(best), float(error[best])
    before, here, after = error[best - 1 : best + 2].tolist()
    bend = before - 2.0 * here + after
    part = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return best + part, here - 0.25 * (before - after) * part
