"""Delay of the power meter behind the joint states, from the data.

A meter averages, filters and sends on a way of its own. Every delay in a range is tried on
blocks that the fit has not seen: the readings are moved, and shaft power and the columns of
the losses, summed over all drives, are averaged over the same time. All factors are free, so
losses need not be known yet. Readings while the drives brake, or the DC link gives what they
fed back, are left out at every delay: the meter then sees less, which would look like a delay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, MeterBlock
from robot_energy.comparison.curve import MeterCurve
from robot_energy.identify.drive_data import DriveData
from robot_energy.identify.drive_delay import PowerDelay, delay_of
from robot_energy.identify.losses import loss_columns
from robot_energy.identify.quality import folds_in_order
from robot_energy.identify.total_sums import MAX_GAP, piece_means
from robot_energy.identify.triangle import triangle_of

SPAN = 0.5  # s: delays up to this are tried,
SHARE = 0.01  # and up to this share of the recorded time: seconds of motion hide long ones
STEPS = 20  # on each side of zero,
FINE = 10  # then on each side of the best of them
FOLDS = 5
LEAST_ROWS = 100


def estimate_meter_delay(data: DriveData, span: float = SPAN) -> PowerDelay | None:
    """Estimate one delay for all recordings.

    Args:
        data: Samples of all drives, with meters.
        span: Delays from minus to plus this are tried, a hundredth of the recorded time at
            most. [s]

    Returns:
        The estimate; None where the readings are too few to tell.
    """
    if not np.isfinite(data.period) or data.period <= 0.0:
        return None
    span = min(span, SHARE * len(data) * data.period)
    columns = _columns(data)
    coarse = span * np.arange(-STEPS, STEPS + 1) / STEPS
    error = _errors(data, columns, coarse)
    if error is None:
        return None
    best = int(np.argmin(error.sum(axis=0)))
    found = delay_of(error, coarse, error[:, STEPS], span)
    if found.at_edge:
        return found
    fine = coarse[best] + span / STEPS * np.arange(-FINE, FINE + 1) / FINE
    error = _errors(data, columns, np.append(fine, 0.0))
    return None if error is None else delay_of(error[:, :-1], fine, error[:, -1], span)


def with_meters_earlier(data: DriveData, delay: float) -> DriveData:
    """Return the samples with the delay of the meters undone. [s]"""
    if delay == 0.0:
        return data
    moved = tuple(None if meter is None else _earlier(meter, delay) for meter in data.meters)
    return replace(data, meters=moved)


def _earlier(meter: MeterBlock, delay: float) -> MeterBlock:
    return replace(meter, stamp_ns=meter.stamp_ns - round(delay / NANOSECOND))


def _columns(data: DriveData) -> Float:
    """Shaft power, NaN where the supply does not pass it on, and losses, shape (N, 5)."""
    terms = np.zeros((len(data), 4))
    for k in range(len(data.names)):
        terms += loss_columns(
            data.motor_velocity[:, k], data.motor_torque[:, k], data.motor_temperature_degc[:, k]
        )
    shaft = data.shaft_power.sum(axis=1)
    shaft[data.braking] = np.nan
    return np.column_stack([shaft, terms])


def _moved(
    meter: MeterBlock, lag: float, data: DriveData, rows: Int, columns: Float
) -> tuple[Float, Float]:
    """Power of every piece, and means of the columns over it; NaN where not known."""
    power: list[Float] = []
    means: list[Float] = []
    stamp, stretch = data.stamp_ns[rows], data.stretch[rows]
    for pieces in MeterCurve(MAX_GAP).step(_earlier(meter, lag)):
        kept, mean = piece_means(pieces, stamp, stretch, columns)
        place = np.full((len(pieces), columns.shape[1]), np.nan)
        place[np.searchsorted(pieces.start_ns, kept.start_ns)] = mean
        power.append(0.5 * (pieces.start_power + pieces.end_power))
        means.append(place)
    return np.concatenate(power), np.concatenate(means)


def _errors(data: DriveData, columns: Float, lags: Float) -> Float | None:
    """Squared error of every fold, predicted from the others, shape (folds, lags).

    The same readings at all lags; None if they are too few.
    """
    parts: list[Float] = []
    targets: list[Float] = []
    for number, meter in enumerate(data.meters):
        rows = np.flatnonzero(data.recording == number)
        if meter is None or len(rows) < 2:
            continue
        tried = [_moved(meter, lag, data, rows, columns[rows]) for lag in lags.tolist()]
        same = np.logical_and.reduce([np.isfinite(mean[:, 0]) for _, mean in tried])
        parts.append(np.stack([mean[same] for _, mean in tried]))
        targets.append(tried[0][0][same])
    if sum(len(part) for part in targets) < LEAST_ROWS:
        return None
    means, measured = np.concatenate(parts, axis=1), np.concatenate(targets)
    fold = folds_in_order(len(measured), FOLDS)
    size = np.maximum(np.linalg.norm(means[0], axis=0), np.finfo(float).tiny)
    error = np.empty((FOLDS, len(lags)))
    for lag in range(len(lags)):
        part = means[lag] / size
        for number in range(FOLDS):
            test = fold == number
            triangle = triangle_of(np.column_stack([part[~test], measured[~test]]))
            values = np.linalg.lstsq(triangle[:, :-1], triangle[:, -1:], rcond=None)[0]
            error[number, lag] = ((part[test] @ values - measured[test][:, None]) ** 2).sum()
    return error
