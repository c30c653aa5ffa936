"""Delay between the measured power of the drives and the joint states, from the data.

A drive reports its power on another way than its position: filtered, or in a message of its
own that counts from when it was recorded. The fit is shaft power and the columns of the
losses (`identify.losses`), all with free factors, of each drive. Shifts are whole samples
of the joint states, so that no interpolation smooths the noise of some of them only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int
from robot_energy.identify.drives.drive_data import DriveData
from robot_energy.identify.stats.cross_validation import contiguous_folds, splits
from robot_energy.identify.stats.lag import Delay, best_delay, held_out_errors
from robot_energy.identify.stats.regression import qr_r

SPAN = 0.1  # s: delays up to this are tried,
SHARE = 0.01  # and up to this share of the recorded time: seconds of motion hide long ones
STEPS = 25  # on each side of zero, at most
MIN_GAIN = 0.05  # of the held-out error: a second of motion has 1 % for chance delays
MIN_ROWS = 200
CHUNK = 50_000  # rows compressed at once, so that memory does not grow with the recording


def estimate_power_delay(data: DriveData) -> Delay | None:
    """Return one delay for all drives; None where the samples are too few to tell.

    Args:
        data: Samples of all drives, power as recorded.
    """
    period = data.period
    if not np.isfinite(period) or period <= 0.0:
        return None
    reach = max(3, round(min(SPAN, SHARE * len(data) * period) / period))
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
    undelayed = error[:, len(lags) // 2]
    return best_delay(lags * period, error, undelayed, float(lags[-1]) * period, MIN_GAIN)


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
    if len(rows) < MIN_ROWS:
        return None
    triangles: list[Float] = []
    for _, test in splits(contiguous_folds(len(rows))):
        part = rows[test]
        triangle = np.zeros((0, 5 + len(lags)))
        for first in range(0, len(part), CHUNK):
            some = part[first : first + CHUNK]
            columns = data.loss_columns(some, joint)
            target = data.drive_power[some[:, None] + lags, joint]
            both = np.column_stack([columns, data.shaft_power[some, joint], target])
            triangle = qr_r(np.concatenate([triangle, both]))
        triangles.append(triangle)
    return held_out_errors(triangles, 5)


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
