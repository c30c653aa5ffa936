"""Delays behind the joint states, from the data: of the power of the drives, of the power meter.

A drive reports its power on another way than its position: filtered, or in a message of its
own that counts from when it was recorded. The fit is shaft power and the columns of the
losses (`identify.drives.losses`), all with free factors, of each drive. Shifts are whole samples
of the joint states, so that no interpolation smooths the noise of some of them only.

A meter averages, filters and sends on a way of its own. For every delay the readings are
moved, and shaft power and the columns of the losses, summed over all drives, are averaged
over the same time. All factors are free, so
losses need not be known yet. Readings while the drives brake, or the DC link gives what they
fed back, are left out at every delay: the meter then sees less, which would look like a delay.

A first-order low pass ``T dy/dt = x - y`` is found in the same way, with low-passed columns, and
the delay is free meanwhile; what the drives feed back counts as 0 in it, and the DC link as empty.
Copper losses have a factor for each drive, and power counts from its mean over some seconds:
a level that is off, as friction of another temperature is, would be taken up by the low pass.
A low pass also averages the noise of the torque. One that runs backwards in time averages it as
well, and no meter is one: a low pass is applied only where it explains the readings better.
It is undone in `robot_energy_identify.data.recordings`. An energy counter has none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.model.schema import Meter
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterBlock, MeterMeaning
from robot_energy_identify.bounds import identified
from robot_energy_identify.data.recordings import undone
from robot_energy_identify.data.thinned import few
from robot_energy_identify.drives.drive_data import BLOCK, DriveData
from robot_energy_identify.drives.total_sums import InsidePieces, Integrals
from robot_energy_identify.stats.cross_validation import (
    averaged,
    contiguous_blocks,
    contiguous_folds,
    splits,
)
from robot_energy_identify.stats.lag import Delay, applied, best_delay, held_out_errors
from robot_energy_identify.stats.regression import qr_r

DRIVE_SPAN = 0.1  # s: delays of drives up to this are tried,
DRIVE_STEPS = 25  # on each side of zero, at most
MIN_GAIN = 0.05  # of the held-out error: a second of motion has 1 % for chance delays
MIN_DRIVE_ROWS = 200
SAME_PERIOD = 0.1  # of the period, by which those of two recordings may differ
CHUNK = 50_000  # rows compressed at once, so that memory does not grow with the recording
SPAN = 0.5  # s: delays of meters up to this are tried,
SHARE = 0.01  # and up to this share of the recorded time: seconds of motion hide long ones
STEPS = 20  # on each side of zero,
FINE = 10  # then on each side of the best of them
WIDE = 2  # steps of low passes to each side: the least error may lie beyond the next
MIN_ROWS = 100
FEWEST = 20  # readings in the time over which their mean is taken
AHEAD = 0.03  # s by which no meter is ahead of what it measures; a model that is off makes 0.01
MAX_TIME_CONSTANT = 1.0  # s: low passes up to this are tried
SPEED_LAG = 0.015  # s by which speeds that a controller has filtered may be late


def estimate_meter_delay(data: DriveData) -> Delay | None:
    """Return one delay for all recordings; None where the readings are too few to decide."""
    if not np.isfinite(data.period) or data.period <= 0.0:
        return None
    span = min(SPAN, SHARE * len(data) * data.period)
    columns = _columns(data)
    coarse = span * np.arange(-STEPS, STEPS + 1) / STEPS
    error = _errors(data, coarse, [columns])
    if error is None:
        return None
    best = int(np.argmin(error.sum(axis=0)))
    found = best_delay(coarse, error, error[:, STEPS], span, MIN_GAIN)
    if found.at_edge:
        return found
    fine = coarse[best] + span / STEPS * np.arange(-FINE, FINE + 1) / FINE
    error = _errors(data, np.append(fine, 0.0), [columns])
    return None if error is None else best_delay(fine, error[:, :-1], error[:, -1], span, MIN_GAIN)


def estimate_time_constant(data: DriveData, ahead: bool = False) -> Delay | None:
    """Return the time constant of a low pass in the meters of all recordings but counters.

    The delay is free at each constant: at a fixed one the constant would take it up, and a low pass
    that is undone by too much shows less than the grid gives while the drives brake. The constant
    is applied only where it explains the readings better than a delay alone. None where the
    readings are too few to decide.

    Args:
        ahead: Whether readings may be ahead of the samples, as by a clock.
    """
    if not np.isfinite(data.period) or data.period <= 0.0:
        return None
    data = replace(data, meters=tuple(map(_without_counter, data.meters)))
    span = min(MAX_TIME_CONSTANT, SHARE * len(data) * data.period)
    grid = span * np.arange(STEPS + 1) / STEPS
    lags = grid[::2] * SPAN / MAX_TIME_CONSTANT
    step = lags[1]
    lags = np.append(-lags[:0:-1], lags) if ahead else lags
    least = lags[0] - SPEED_LAG
    error = _errors_of_both(data, grid, lags)
    if error is None:
        return None
    coarse = _at_best_lags(error)
    found = best_delay(grid, coarse, coarse[:, 0], span, MIN_GAIN)
    if found.applied == 0.0:
        return found
    total = error.sum(axis=0)
    row, column = divmod(int(total.argmin()), total.shape[1])
    fine = np.arange(-FINE, FINE + 1) / FINE
    near, late = grid[row] + WIDE * grid[1] * fine, lags[column] + step * fine
    near, late = near[near > 0.0], late[late >= least]
    # First a delay alone, at its best, on the same readings.
    alone = lags[total[0].argmin()]
    error = _errors_of_both(data, np.append(0.0, near), np.append(alone, late))
    if error is None:
        return found
    closer = _at_best_lags(error)
    finer = best_delay(near, closer[:, 1:], closer[:, 0], span, MIN_GAIN)
    found = found if finer.at_edge else finer
    best = int(error.sum(axis=0)[1:].min(axis=0).argmin())
    lag = float(np.append(alone, late)[best])
    if found.applied > 0.0 and _averages_noise(data, found.applied, lag + step * fine[::2]):
        return replace(found, applied=0.0)
    return found


def _averages_noise(data: DriveData, constant: float, lags: Float) -> bool:
    """Whether a low pass [s] explains the readings no better than one backwards in time.

    Backwards the columns are earlier by twice the constant. False where the readings are too few.
    """
    columns = _columns_of_low_pass(data)
    passed = (_low_passed(data, columns, constant, backwards) for backwards in (False, True))
    error = _errors(data, np.append(lags, lags + 2.0 * constant), passed, about_mean=True)
    if error is None:
        return False
    ours, backwards = error.sum(axis=0).reshape(2, -1).min(axis=1).tolist()
    return np.sqrt(ours) > (1.0 - MIN_GAIN) * np.sqrt(backwards)


def _without_counter(meter: MeterBlock | None) -> MeterBlock | None:
    counts = meter is not None and meter.meaning is MeterMeaning.CUMULATIVE
    return None if counts else meter


def _at_best_lags(error: Float) -> Float:
    """Errors of each low pass with its best lag, (folds, constants)."""
    best = error.sum(axis=0).argmin(axis=1)
    return error[:, np.arange(len(best)), best]


def _errors_of_both(data: DriveData, constants: Float, lags: Float) -> Float | None:
    """Squared error of every fold with each low pass [s] and lag [s], (folds, constants, lags)."""
    columns = _columns_of_low_pass(data)
    passed = (_low_passed(data, columns, constant) for constant in constants.tolist())
    error = _errors(data, lags, passed, about_mean=True)
    return None if error is None else error.reshape(-1, len(constants), len(lags))


def _columns_of_low_pass(data: DriveData) -> Float:
    """Shaft power, copper losses of each drive and other losses of all, shape (N, 3 + n)."""
    _, copper, *others = np.moveaxis(data.loss_columns(), -1, 0)
    summed = [column.sum(axis=1) for column in others]
    return np.column_stack([data.supplied_power, copper, *summed])


def _low_passed(data: DriveData, columns: Float, constant: float, backwards: bool = False) -> Float:
    """The columns behind a low pass [s] that starts settled in every stretch."""
    from scipy.signal import lfilter

    if constant == 0.0:
        return columns
    known = np.isfinite(columns[:, :1])
    shaft = data.shaft_power.sum(axis=1)[:, None]
    passed = np.where(shaft > 0.0, np.column_stack([shaft, columns[:, 1:]]), 0.0)
    drawn = np.where(known, columns, passed)
    edges = np.flatnonzero(np.diff(data.stretch)) + 1
    parts: list[Float] = []
    for part, periods in zip(
        np.split(np.nan_to_num(drawn), edges), np.split(data.periods, edges), strict=True
    ):
        part = part[::-1] if backwards else part
        kept = float(np.exp(-periods[0] / constant))
        before = (1.0 - kept) * constant / float(periods[0])  # of straight lines between samples
        ends = [1.0 - before, before - kept]
        passed = lfilter(ends, [1.0, -kept], part, axis=0, zi=before * part[:1])[0]
        parts.append(np.asarray(passed)[::-1] if backwards else np.asarray(passed))
    return np.where(known, np.concatenate(parts), np.nan)


def meter_lags(read: Callable[[float], DriveData]) -> tuple[Delay | None, Delay | None]:
    """Return low pass and delay of meters, None if unknown; the delay without the low pass.

    Args:
        read: Gives the samples of all drives with a low pass [s] of the meters undone.
    """
    data = read(0.0)
    if all(meter is None for meter in data.meters):
        return None, None
    low_pass = estimate_time_constant(data)
    delay = estimate_meter_delay(read(applied(low_pass)))
    if applied(delay) < -AHEAD:  # a clock is ahead, and the delay was not free
        low_pass = estimate_time_constant(data, ahead=True)
        delay = estimate_meter_delay(read(applied(low_pass)))
    return low_pass, delay


def with_response(
    model: RobotModel, low_pass: Delay | None, delay: Delay | None, source: str
) -> RobotModel:
    """Return a model with what is sure of the response of its meter.

    Args:
        low_pass: Time constant of a low pass; None where it cannot be determined.
        delay: Of the readings; a negative one is a clock and not a meter.

    Returns:
        The model itself where nothing is sure.
    """
    sure = {
        name: identified(one.applied, one.std, source)
        for name, one in (("time_constant", low_pass), ("delay", delay))
        if one is not None and one.applied > 0.0
    }
    return model.changed(meter=Meter(**sure)) if sure else model


def with_meters_earlier(data: DriveData, delay: float, time_constant: float = 0.0) -> DriveData:
    """Return the samples with delay and low pass of the meters undone.

    Args:
        delay: Of the readings behind the samples. [s]
        time_constant: Of the low pass. [s]
    """
    if delay == 0.0 and time_constant == 0.0:
        return data
    return replace(
        data,
        meters=tuple(
            None if meter is None else undone(meter, delay, time_constant) for meter in data.meters
        ),
    )


def _columns(data: DriveData) -> Float:
    """Shaft power, NaN where the supply does not pass it on, and losses, shape (N, 5)."""
    return np.column_stack([data.supplied_power, data.loss_columns().sum(axis=1)])


class _Moved(Described):
    """The readings of a meter with a lag, as pieces; some of them, evenly taken."""

    stamp_ns: Annotated[Int, "Of every piece. [ns]"]
    power: Annotated[Float, "Of every piece. [W]"]
    parts: Annotated[
        list[tuple[InsidePieces, Int, int]],
        "Those inside the samples, their places among all that are taken, and how many these are.",
    ]

    @classmethod
    def of(cls, meter: MeterBlock, limits: MeterLimits, lag: float, integrals: Integrals) -> _Moved:
        stamp: list[Int] = []
        power: list[Float] = []
        parts: list[tuple[InsidePieces, Int, int]] = []
        for every in limits.pieces(undone(meter, lag)):
            pieces = every[few(len(every))]
            inside = integrals.inside(pieces)
            place = np.searchsorted(pieces.stamp_ns, inside.pieces.stamp_ns)
            stamp.append(pieces.stamp_ns)
            power.append(pieces.mean_power)
            parts.append((inside, place, len(pieces)))
        return cls(np.concatenate(stamp), np.concatenate(power), parts)

    def means(self, integrals: Integrals) -> Float:
        """Means of the columns over every piece; NaN where not known."""
        found: list[Float] = []
        for inside, place, count in self.parts:
            mean = integrals.means_of(inside)
            found.append(np.full((count, mean.shape[1]), np.nan))
            found[-1][place] = mean
        return np.concatenate(found)


def _errors(
    data: DriveData, lags: Float, columns: Iterable[Float], about_mean: bool = False
) -> Float | None:
    """Squared error of every fold, predicted from the others, shape (folds, tries).

    Each of the columns, unknown in the same places, with each lag [s]; the same readings in all;
    None if they are too few.

    Args:
        about_mean: Whether columns and readings count from their means over some seconds.
    """
    errors: list[Float] = []
    same: list[NDArray[np.bool_]] = []
    moved: dict[int, list[_Moved]] = {}
    measured = size = np.empty(0)
    for each in columns:
        parts: list[Float] = []
        targets: list[Float] = []
        for number, meter in enumerate(data.meters):
            rows = data.samples_of(number)
            if meter is None or len(each[rows]) < 2:
                continue
            integrals = Integrals(data.stamp_ns[rows], data.stretch[rows], each[rows])
            if number not in moved:  # the same for all columns
                limits = data.limits[number]
                moved[number] = [_Moved.of(meter, limits, lag, integrals) for lag in lags.tolist()]
            tried = [one.means(integrals) for one in moved[number]]
            if not errors:
                same.append(np.logical_and.reduce([np.isfinite(mean[:, 0]) for mean in tried]))
            used = same[len(parts)]
            first = moved[number][0]
            power, every = first.power[used], [mean[used] for mean in tried]
            if about_mean and used.any():
                block = _some_seconds(first.stamp_ns[used])
                power, *every = (one - averaged(one, block)[block] for one in (power, *every))
            parts.append(np.stack(every))
            targets.append(power)
        if sum(len(part) for part in targets) < MIN_ROWS:
            return None
        means = np.concatenate(parts, axis=1)
        if not errors:
            measured = np.concatenate(targets)
            size = np.maximum(np.linalg.norm(means[0], axis=0), np.finfo(float).tiny)
        folds = [test for _, test in splits(contiguous_folds(len(measured)))]
        width = means.shape[-1]
        errors += [
            held_out_errors([qr_r(np.column_stack([part[f], measured[f]])) for f in folds], width)
            for part in (mean / size for mean in means)
        ]
    return np.concatenate(errors, axis=1)


def _some_seconds(stamp_ns: Int) -> Int:
    """Block of some seconds that each reading lies in, rising from 0, shape (K,)."""
    period = float(np.median(np.diff(stamp_ns))) * NANOSECOND if len(stamp_ns) > 1 else 0.0
    return contiguous_blocks(stamp_ns, np.zeros_like(stamp_ns), max(BLOCK, FEWEST * period))


def estimate_power_delay(data: DriveData) -> Delay | None:
    """Return one delay for all drives; None where the samples are too few to decide.

    Recordings whose samples come faster or slower than most are left out: a shift is in samples.
    """
    period = data.period
    if not np.isfinite(period) or period <= 0.0:
        return None
    reach = max(3, round(min(DRIVE_SPAN, SHARE * len(data) * period) / period))
    stride = -(-reach // DRIVE_STEPS)
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
            # NaN next to an instant makes its interpolation NaN: nothing is bridged.
            power[rows, joint] = np.interp(
                later, time, data.drive_power[rows, joint], left=np.nan, right=np.nan
            )
    return replace(data, drive_power=power)


def _curve(data: DriveData, joint: int, lags: Int) -> Float | None:
    """Squared held-out error of one drive, by fold and lag, shape (folds, lags)."""
    rows = _rows(data, joint, lags)
    if len(rows) < MIN_DRIVE_ROWS:
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
    inside &= np.abs(data.periods / data.period - 1.0) < SAME_PERIOD
    rows = row[inside & np.isfinite(data.shaft_power[:, joint])]
    known = np.concatenate([[0], np.cumsum(np.isfinite(data.drive_power[:, joint]))])
    whole = known[rows + lags[-1] + 1] - known[rows + lags[0]] == lags[-1] - lags[0] + 1
    return rows[whole]
