"""Readings of a meter that step although the predicted power does not.

Another load, a fan or brakes on the same meter, or another scale or unit of it, spoil what is
identified from the whole recording. Means of a second on either side of each instant follow

    y = a + b p + d s

with p the predicted power as the meter shows it; s is 0 before the instant and, behind it, 1 for
another load, or p for another scale. A model that is off changes a and b, but not d.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND, Float
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.check.finding import WARNING, Finding

WIDTHS = (8, 16)  # means on either side: loads that switch every ten seconds, and scales
MAX_SPACING = 2.0  # s between readings; over minutes, a robot that warms up looks like a step
MIN_STEP = 0.15  # of the mean power: sound recordings show 0.02 with a model that is identified
MIN_DEVIATIONS = 7.0  # sound recordings show 3, up to 6 with a model that is far off
MAX_OFF = 0.2  # of the energy, that the model may miss on the better side of a step
QUARTERS = 4
LIKE = 0.05  # of the mean power, by which predicted powers of two quarters may differ,
MIN_LIKE = 5  # in this many seconds of each, or readings further apart than a second
ALIKE = 1e-3  # share of the variance of s that a and b p may leave, below which d is not known


def by_second(compared: Compared) -> Compared:
    """Return the sums of each second; those of a cut input differ from them by rounding alone."""
    second, place = np.unique(compared.stamp_ns // SECOND_NS, return_inverse=True)

    def total(values: Float) -> Float:
        return np.bincount(place, values, len(second)).astype(np.float64)

    return Compared(
        second * SECOND_NS,
        total(compared.duration_ns.astype(np.float64)).astype(np.int64),
        total(compared.measured),
        total(compared.predicted),
        total(compared.drawn),
    )


def step_of(compared: Compared, start_ns: int) -> Finding | None:
    """Return the surest step of the readings; None where they do not step.

    Args:
        compared: What meter and prediction gave, in the order of time.
        start_ns: Begin of the recording. [ns]
    """
    means = by_second(compared)
    second = means.stamp_ns // SECOND_NS
    if len(second) < 2 * WIDTHS[0] or float(np.median(np.diff(second))) > MAX_SPACING:
        return None
    time = means.duration_ns * NANOSECOND
    measured, predicted = means.measured / time, means.predicted / time
    off = float(np.sqrt(np.mean((measured - predicted) ** 2)))
    least = max(off, MIN_STEP * float(np.abs(measured).mean()))
    sums = np.cumsum([measured, predicted], axis=1)
    seen, drawn = np.stack([sums[:, :-1], sums[:, -1:] - sums[:, :-1]], axis=1)
    fits = (np.abs(drawn - seen) <= MAX_OFF * np.abs(seen)).any(axis=0)  # before or behind a row
    found: list[tuple[float, float, int]] = []
    for width in WIDTHS:
        if len(second) < 2 * width:
            continue
        around = partial(sliding_window_view, window_shape=2 * width)
        row = np.arange(width, len(second) - width + 1)
        near = np.ptp(around(second), axis=1) < 2 * width * MAX_SPACING
        behind = np.arange(2 * width) >= width
        for sure, step in _steps(around(measured), around(predicted), behind):
            is_step = near & fits[row - 1] & (np.abs(step) > least) & (sure > MIN_DEVIATIONS)
            columns = (values[is_step].tolist() for values in (sure, step, row))
            found += zip(*columns, strict=True)
    if not found:
        return None
    _, step, row = max(found)
    at = float(second[row] - start_ns / SECOND_NS)
    return Finding(
        "meter_step", WARNING, ("meter",),
        f"from {at:.0f} s on the meter reads {abs(step):.0f} W {'more' if step > 0 else 'less'} "
        "than before at the same predicted power: another load, a fan or brakes switch, or its "
        "scale changes",
        step,
        "leave this recording out or record again without it, or give the load a meter of its own",
    )  # fmt: skip


def drift_of(compared: Compared) -> Finding | None:
    """Return by how much readings drift from the prediction; None for little.

    Args:
        compared: What a meter and the prediction of a model that was identified from it gave.
    """
    means = by_second(compared)
    since = means.stamp_ns - means.stamp_ns[0]
    quarter = QUARTERS * since // (since[-1] + SECOND_NS)
    time = means.duration_ns * NANOSECOND
    measured, predicted = means.measured / time, means.predicted / time
    mean = float(np.abs(measured).mean())
    ends = [predicted[quarter == place] for place in (0, QUARTERS - 1)]
    if min(map(len, ends)) < MIN_LIKE:
        return None
    low, high = max(map(np.min, ends)) - LIKE * mean, min(map(np.max, ends)) + LIKE * mean
    like = (predicted >= low) & (predicted <= high) & (quarter % (QUARTERS - 1) == 0)
    later = quarter[like] > 0
    if min(later.sum(), (~later).sum()) < MIN_LIKE:
        return None
    sure, step = next(_steps(measured[None, like], predicted[None, like], later))
    drift, off = float(step[0]), float(np.sqrt(np.mean((measured - predicted) ** 2)))
    if not (abs(drift) > max(off, MIN_STEP * mean) and sure[0] > MIN_DEVIATIONS):
        return None
    return Finding(
        "meter_drift", WARNING, ("meter",),
        f"the meter reads {abs(drift):.0f} W {'more' if drift > 0.0 else 'less'} in the last "
        "quarter than in the first at the same predicted power: another load rises or falls, "
        "drives are switched off, or the robot warms up in a way that its model does not know",
        drift,
        "record again without other loads on the meter; of a warm-up record half an hour or more",
    )  # fmt: skip


def _steps(
    measured: Float, predicted: Float, behind: NDArray[np.bool_]
) -> Iterator[tuple[Float, Float]]:
    """Yield deviations and size of steps of rows, by a load, then by a scale. [W]"""
    power = predicted - predicted.mean(axis=1, keepdims=True)
    square = (power**2).sum(axis=1, keepdims=True)

    def left(values: Float) -> Float:
        values = values - values.mean(axis=1, keepdims=True)
        along = (power * values).sum(axis=1, keepdims=True)
        return values - power * np.divide(along, square, where=square > 0.0, out=0.0 * along)

    target = left(measured)
    load, scale = np.broadcast_to(behind, measured.shape).astype(np.float64), behind * predicted
    for column in (load, scale):
        rest = left(column)
        size = (rest**2).sum(axis=1)
        known = size > ALIKE * (column**2).sum(axis=1)
        slope = np.divide((rest * target).sum(axis=1), size, where=known, out=np.zeros(len(size)))
        error = ((target - slope[:, None] * rest) ** 2).sum(axis=1) / (measured.shape[1] - 3)
        with np.errstate(divide="ignore", invalid="ignore"):
            sure = np.abs(slope) / np.sqrt(error / size)
        yield sure, slope * column[:, behind].mean(axis=1)
