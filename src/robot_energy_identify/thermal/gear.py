"""Fit of the temperature of one gear, which its friction follows.

``C dT_g/dt = P_f - G_m (T_g - T_m) - G_a (T_g - T_a)``, and viscous friction is
``a + b exp(-T_g / c)``. Friction power P_f and motor temperature T_m are measured; what T_g has to
explain is the measured friction torque. The samples of each window of 10 s are summed up in a
triangle, so that an hour costs as little as a minute, and a, b and the Coulomb torque are
linear for given rates. The law itself is fitted afterwards, as without a gear, on the temperatures
found here (`robot_energy_identify.friction`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.condition.thermal_state import GEAR_START_SHARE, GEAR_START_STD, WINDOW
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.joint import JointGear
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.bounds import identified
from robot_energy_identify.friction.samples import AVERAGED, FrictionData, moving_rows
from robot_energy_identify.stats.cross_validation import FOLDS, GAIN
from robot_energy_identify.thermal.network import CORRELATED, with_ambient

MIN_WINDOWS = 60  # of 10 s with motion, in one recording
MIN_RISE = 3.0  # K that a motor warms in it
START = np.array([np.log(1800.0), 0.5, np.log(15.0), np.log(30.0)])
SPREAD = np.array([1.0, 0.3, 1.0, 0.7])
LOWEST = np.array([np.log(60.0), 0.0, np.log(0.05), np.log(4.0)])
HIGHEST = np.array([np.log(36000.0), 1.0, np.log(300.0), np.log(150.0)])
"""Middle, spread and bounds of the figures: logarithm of the time constant [s]; G_m / (G_m + G_a);
logarithm of the rise by the mean friction power [K]; logarithm of c [K]."""
MAX_START = 40.0  # K of a gear from its motor, at the start of a recording
MAX_OFFSET = 6.0  # K between two thermometers, three of their usual deviations
SURE = 4.0  # standard deviations by which a temperature must show in the work of minutes
SOAKED_SHARE = 0.0
"""`_Axis.share` of recordings of a soaked robot. Whether they are is for the data to say: in short
ones a free start makes up for what the law of friction lacks."""


class GearRun(Described):
    """One axis during one recording, in windows of 10 s."""

    friction_power: Annotated[Float, "Mean, shape (N,). [W]"]
    motor_temperature_degc: Annotated[Float, "Last reading by the end of each, shape (N,). [degC]"]
    window: Annotated[Int, "Of each sample of the axis that belongs to the recording, shape (M,)."]
    triangles: Annotated[
        Float,
        "Of sign, speed, 1 and friction torque of the samples, shape (N, 3, 4); what no law can "
        "explain within a window is left out.",
    ]

    def __len__(self) -> int:
        return len(self.friction_power)

    @property
    def moving(self) -> int:
        """Windows with motion."""
        return int((self.triangles[:, 0, 0] != 0.0).sum())

    @property
    def warms_up(self) -> bool:
        """Whether it shows a warm-up."""
        return self.moving >= MIN_WINDOWS and float(np.ptp(self.motor_temperature_degc)) >= MIN_RISE

    def without(self, rows: NDArray[np.bool_]) -> GearRun:
        """Return the run without the friction of some windows; the temperatures stay.

        Args:
            rows: Which windows, shape (N,).
        """
        return replace(self, triangles=np.where(rows[:, None, None], 0.0, self.triangles))


class GearFit(Described):
    """Temperature of one gear."""

    name: Annotated[str, "Of the joint."]
    gear: Annotated[JointGear, "As in a model file."]
    error: Annotated[
        float, "Of the friction work per minute that the fit has not seen, share of it (RMS). [-]"
    ]
    motor_error: Annotated[float, "The same where friction follows the motor temperature. [-]"]
    time_constant: Annotated[
        tuple[float, float], "C / (G_m + G_a), with its standard deviation. [s]"
    ]
    rise: Annotated[
        tuple[float, float],
        "Of the gear by the mean friction power of the recordings, with its deviation. [K]",
    ]
    hours: Annotated[float, "Of the recordings. [h]"]


@dataclass(frozen=True)
class _Figures:
    """Fitted figures: those of `START`, the start of each run [K], and what is linear."""

    values: Float
    starts: Float
    covariance: Float
    linear: Float


def lagged(target: Float, time: float, start: Float) -> Float:
    """Return what follows a target with a first-order lag, at the start of each window.

    Args:
        target: Held over each window, shape (N,) or (N, n). [degC]
        time: Time constant. [s]
        start: At the start of the first, shape (1,) or (1, n). [degC]
    """
    from scipy.signal import lfilter

    kept = float(np.exp(-WINDOW / time))
    ends = lfilter([1.0 - kept], [1.0, -kept], target, axis=0, zi=kept * start)[0]
    return np.concatenate([start, np.asarray(ends, dtype=np.float64)[:-1]])


class _Axis:
    """The runs of one axis, and what a law on their temperatures leaves of the torque.

    Args:
        share: Deviation of the start of a gear, over how far its motor is from the air. [-]
    """

    def __init__(self, runs: Sequence[GearRun], ambient: float, share: float) -> None:
        self.runs, self.ambient = runs, ambient
        self.mean_power = max(
            float(np.mean(np.concatenate([r.friction_power for r in runs]))), 1e-6
        )
        self.middle = float(np.mean(np.concatenate([r.motor_temperature_degc for r in runs])))
        above = np.array([abs(run.motor_temperature_degc[0] - ambient) for run in runs])
        self.start_std = GEAR_START_STD + share * above

    def degc(self, values: Float, starts: Float) -> list[Float]:
        """Temperature of the gear in each window of each run."""
        time, to_motor, rise = np.exp(values[0]), values[1], np.exp(values[2])
        found: list[Float] = []
        for run, start in zip(self.runs, starts, strict=True):
            degc = run.motor_temperature_degc
            target = rise / self.mean_power * run.friction_power
            target += to_motor * degc + (1.0 - to_motor) * self.ambient
            found.append(lagged(target, float(time), degc[:1] + start))
        return found

    def residual(self, degc: Sequence[Float], scale: float) -> tuple[Float, Float]:
        """Linear figures, and what they leave of every triangle's rows."""
        parts: list[Float] = []
        for run, own in zip(self.runs, degc, strict=True):
            decay = np.exp(-(own - self.middle) / scale)[:, None, None]
            columns = run.triangles[:, :, :3]
            both = np.concatenate([columns, columns[:, :, 1:2] * decay], axis=2)
            parts.append(both.reshape(-1, 4))
        table = np.concatenate(parts)
        target = np.concatenate([run.triangles[:, :, 3].reshape(-1) for run in self.runs])
        linear = np.linalg.lstsq(table, target, rcond=None)[0]
        if linear[3] < 0.0:  # friction does not rise with the temperature
            linear = np.append(np.linalg.lstsq(table[:, :3], target, rcond=None)[0], 0.0)
        return linear, target - table @ linear

    def work(self, run: GearRun, degc: Float, scale: float, linear: Float) -> tuple[Float, Float]:
        """Measured and predicted friction work of each window of a run. [J]"""
        products = (run.triangles[:, :, 1:2].swapaxes(1, 2) @ run.triangles)[:, 0]  # with the speed
        decay = np.exp(-(degc - self.middle) / scale)
        table = np.column_stack([products[:, :3], products[:, 1] * decay])
        return AVERAGED * products[:, 3], AVERAGED * (table @ linear)

    def fit(self) -> _Figures:
        """Figures by least squares with their priors."""
        from scipy.optimize import least_squares

        count, noise = max(sum(run.moving for run in self.runs), 1), 1.0

        def errors(x: Float) -> Float:
            left = self.residual(self.degc(x[:4], x[4:]), np.exp(x[3]))[1]
            return np.concatenate([left / noise, (x[:4] - START) / SPREAD, x[4:] / self.start_std])

        free = np.full(len(self.runs), MAX_START)
        bounds = np.append(LOWEST, -free), np.append(HIGHEST, free)
        x, jacobian = np.append(START, np.zeros(len(free))), np.zeros((0, 0))
        for _ in range(3):  # the noise is that of the fit before
            left = self.residual(self.degc(x[:4], x[4:]), np.exp(x[3]))[1]
            noise = max(float(np.sqrt(CORRELATED * (left @ left) / (3 * count))), 1e-12)
            found = least_squares(errors, x, bounds=bounds, x_scale="jac", max_nfev=30)
            x, jacobian = found.x, np.asarray(found.jac)
        linear, _ = self.residual(self.degc(x[:4], x[4:]), np.exp(x[3]))
        return _Figures(x[:4], x[4:], np.linalg.pinv(jacobian.T @ jacobian), linear)

    def fit_motor(self) -> tuple[float, Float]:
        """The same with the temperature of the motor: its scale [K] and the linear figures."""
        degc = [run.motor_temperature_degc for run in self.runs]
        scales: list[float] = np.exp(np.linspace(float(LOWEST[3]), float(HIGHEST[3]), 18)).tolist()
        left = [self.residual(degc, scale)[1] for scale in scales]
        costs = [float(each @ each) for each in left]
        best = scales[costs.index(min(costs))]
        return best, self.residual(degc, best)[0]


def gear_runs(data: FrictionData) -> list[GearRun]:
    """Return the recordings of one axis in windows, without those that know no temperature."""
    assert data.stamp_ns is not None
    moving = moving_rows(data)
    known = np.isfinite(data.motor_temperature_degc)
    work = np.nan_to_num(data.friction_torque * data.motor_velocity) * AVERAGED
    columns = np.column_stack(
        [data.sign, data.motor_velocity, np.ones(len(data)), data.friction_torque]
    )
    runs: list[GearRun] = []
    for number in np.unique(data.run):
        rows = np.flatnonzero(data.run == number)
        since = (data.stamp_ns[rows] - data.stamp_ns[rows[0]]) * NANOSECOND
        window = (since // WINDOW).astype(np.int64)
        count = int(window[-1]) + 1
        length = np.full(count, WINDOW)
        length[-1] = max(float(since[-1]) - WINDOW * (count - 1), AVERAGED)
        power = np.bincount(window, np.maximum(work[rows], 0.0), count) / length
        degc = np.full(count, np.nan)
        read = known[rows]
        degc[window[read]] = data.motor_temperature_degc[rows][read]  # the last one stays
        places = np.flatnonzero(np.isfinite(degc))
        if not len(places):
            continue
        degc = degc[places[np.maximum(np.searchsorted(places, np.arange(count), "right") - 1, 0)]]
        triangles = np.zeros((count, 3, 4))
        used = moving[rows]
        own, bounds = window[used], np.arange(count + 1)
        edges = np.searchsorted(own, bounds)
        part = columns[rows][used]
        for place, (first, last) in enumerate(pairwise(edges.tolist())):
            if last - first >= columns.shape[1]:
                triangles[place] = np.linalg.qr(part[first:last], mode="r")[:3]
        runs.append(GearRun(power, degc, window, triangles))
    return runs


@one_thread
def fit_gear(
    data: FrictionData, ambient_degc: float, source: str = ""
) -> tuple[GearFit, FrictionData]:
    """Return the temperature of one gear, and the samples with it in place of that of the motor.

    Args:
        data: Samples of the axis in all recordings, motor side, in N m.
        ambient_degc: Of the air. [degC]

    Raises:
        NotIdentifiableError: If no recording shows a warm-up, or friction that follows the motor
            temperature predicts as well what the fit has not seen.
    """
    runs = gear_runs(data)
    if not any(run.warms_up for run in runs):
        raise NotIdentifiableError(
            f"{data.name}: no recording shows its gear warming up",
            f"{MIN_WINDOWS * WINDOW / 60.0:.0f} min of work in which its motor warms by "
            f"{MIN_RISE:g} K",
            "record one warm-up of half an hour or more from a cold start",
        )
    share = GEAR_START_SHARE
    error, motor_error = _held_out(runs, ambient_degc, share)
    soaked, _ = _held_out(runs, ambient_degc, SOAKED_SHARE)
    if soaked < GAIN * error:
        error, share = soaked, SOAKED_SHARE
    if not error < GAIN * motor_error:
        raise NotIdentifiableError(
            f"{data.name}: friction that follows a gear predicts the friction work of a minute "
            f"that it has not seen within {100 * error:.1f} %, and one that follows the motor "
            f"within {100 * motor_error:.1f} %",
            "a gear that predicts better",
            "its friction follows the motor temperature",
        )
    axis = _Axis(runs, ambient_degc, share)
    found = axis.fit()
    followed = np.full(len(data), np.nan)
    numbers = np.unique(data.run[np.isfinite(data.motor_temperature_degc)])
    for number, run, own in zip(numbers, runs, axis.degc(found.values, found.starts), strict=True):
        followed[data.run == number] = own[run.window]
    followed[np.isnan(data.motor_temperature_degc)] = np.nan
    deviation = np.sqrt(np.maximum(np.diag(found.covariance)[:4], 0.0))
    time, rise = float(np.exp(found.values[0])), float(np.exp(found.values[2]))
    fit = GearFit(
        data.name,
        _entry(axis, found, source),
        error,
        motor_error,
        (time, time * float(deviation[0])),
        (rise, rise * float(deviation[2])),
        sum(map(len, runs)) * WINDOW / 3600.0,
    )
    # Weights would prefer the many calm samples of a long recording, and miss the work.
    return fit, replace(data, motor_temperature_degc=followed, method="ols")


def follows_temperature(data: FrictionData) -> bool:
    """Return whether a warm-up shows that friction follows the temperature of the motor.

    The work of unseen minutes is predicted better than by constant friction, by more than one
    figure gains by chance. Single samples may scatter too much to show it.
    """
    runs = gear_runs(data)
    if not any(run.warms_up for run in runs):
        return False
    constant_error, motor_error = _held_out(runs, 0.0, None)
    chance = 1.0 + SURE**2 * CORRELATED / sum(run.moving for run in runs)
    return motor_error < min(GAIN, chance**-0.5) * constant_error


def _held_out(runs: Sequence[GearRun], ambient: float, share: float | None) -> tuple[float, float]:
    """Error of the friction work per minute, with gear and with motor, that the fits have not seen.

    Minutes of all recordings are left out in turn. The temperature of a gear does not need the
    torque of the minute that is predicted, but all work before it.

    Args:
        share: As of `_Axis`; None: with constant friction in place of the gear.
    """
    number, minutes = 0, list[Int]()
    for run in runs:
        minutes.append(number + np.arange(len(run)) // CORRELATED)
        number = int(minutes[-1][-1]) + 1
    squares = np.zeros(3)
    for fold in range(FOLDS):
        left_out = [minute % FOLDS == fold for minute in minutes]
        train = _Axis(
            [run.without(rows) for run, rows in zip(runs, left_out, strict=True)],
            ambient,
            share or 0.0,
        )
        gears = [run.motor_temperature_degc for run in runs]
        scale, linear = np.inf, train.residual(gears, np.inf)[0]
        if share is not None:
            found = train.fit()
            gears = train.degc(found.values, found.starts)
            scale, linear = float(np.exp(found.values[3])), found.linear
        motor_scale, motor_linear = train.fit_motor()
        for run, gear, minute, rows in zip(runs, gears, minutes, left_out, strict=True):
            seen = run.without(~rows)
            measured, own = train.work(seen, gear, scale, linear)
            _, motor = train.work(seen, run.motor_temperature_degc, motor_scale, motor_linear)
            sums = [np.bincount(minute - minute[0], each) for each in (measured, own, motor)]
            squares += [((each - sums[0]) ** 2).sum() for each in sums[1:]] + [sums[0] @ sums[0]]
    error, motor_error = np.sqrt(squares[:2] / max(squares[2], 1e-30)).tolist()
    return error, motor_error


def _entry(axis: _Axis, found: _Figures, source: str) -> JointGear:
    """The entry of a model file, its deviations by the slopes of each figure."""

    def figures(values: Float) -> Float:
        time, to_motor = np.exp(values[0]), values[1]
        total = axis.mean_power / np.exp(values[2])
        return np.array([time * total, to_motor * total, (1.0 - to_motor) * total])

    def ends(values: Float) -> Float:
        return np.concatenate([own[-1:] for own in axis.degc(values, found.starts)])

    def deviations(function: Callable[[Float], Float]) -> list[float]:
        steps = 1e-4 * np.eye(4)
        pairs = [(function(found.values + step), function(found.values - step)) for step in steps]
        slopes = np.stack([(high - low) / 2e-4 for high, low in pairs], axis=1)
        variance = np.diag(slopes @ found.covariance[:4, :4] @ slopes.T)
        return np.sqrt(np.maximum(variance, 0.0)).tolist()

    capacity, motor, ambient = (
        identified(value, std, source)
        for value, std in zip(figures(found.values).tolist(), deviations(figures), strict=True)
    )
    return JointGear(
        capacity=capacity,
        motor_conductance=motor,
        ambient_conductance=ambient,
        std=max(deviations(ends)),
    )


class GearsFound(Described):
    """Temperatures of gears."""

    ambient_degc: Annotated[
        float | None, "Temperature of the air that was taken; None without any. [degC]"
    ] = None
    fits: Annotated[tuple[GearFit, ...], "One per gear that was found."] = ()
    refused: Annotated[tuple[str, ...], "Why the others were not, one sentence each."] = ()

    def write(self, model: RobotModel, names: Sequence[str]) -> RobotModel:
        """Return a model in which the friction of some joints follows their gears.

        Args:
            names: Joints whose friction was identified: those without a fit follow their motors.
        """
        found = {fit.name: fit.gear for fit in self.fits}
        before = [joint.name for joint in model.joints if joint.gear is not None]
        changed = {name: found.get(name) for name in names if name in found or name in before}
        model = model.with_joints("gear", changed)
        return with_ambient(model, self.ambient_degc) if self.fits else model


def ambient_offset(data: FrictionData, coldest_degc: float) -> float:
    """Return what the thermometer of one motor shows of cold air, above the coldest of all. [K]

    After a long rest all are as warm as the air, and differ by what their thermometers are off. It
    is 0 for a motor that no recording began with that cold.

    Args:
        coldest_degc: Reading of all motors. [degC]
    """
    known = np.isfinite(data.motor_temperature_degc)
    first = np.unique(data.run[known], return_index=True)[1]
    offset = max(float(data.motor_temperature_degc[known][first].min()) - coldest_degc, 0.0)
    return offset if offset <= MAX_OFFSET else 0.0


def fit_gears(
    axes: Sequence[FrictionData], ambient_degc: float | None = None, source: str = ""
) -> tuple[GearsFound, list[FrictionData]]:
    """Return the gears, and the samples of all axes, each with what its friction follows.

    Args:
        ambient_degc: Of the air; None: the coldest reading of all motors. [degC]
    """
    used, fits, refused = list(axes), list[GearFit](), list[str]()
    warm = [
        np.isfinite(axis.motor_temperature_degc).any() and np.isfinite(axis.friction_torque).any()
        for axis in axes
    ]
    if not any(warm):
        return GearsFound(), used
    coldest = min(
        float(np.nanmin(axis.motor_temperature_degc))
        for axis, known in zip(axes, warm, strict=True)
        if known
    )
    ambient = coldest if ambient_degc is None else ambient_degc
    for place, axis in enumerate(axes):
        if not warm[place]:
            continue
        try:
            offset = 0.0 if ambient_degc is not None else ambient_offset(axis, ambient)
            used[place] = axis = replace(axis, follows_temperature=follows_temperature(axis))
            fit, used[place] = fit_gear(axis, ambient + offset, source)
            gear = fit.gear.model_copy(update={"ambient_offset": offset or None})
            fits.append(replace(fit, gear=gear))
        except NotIdentifiableError as error:
            refused.append(str(error))
    return GearsFound(ambient, tuple(fits), tuple(refused)), used
