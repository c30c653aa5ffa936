"""Temperatures of all gears of a robot by its power meter, where no torque is measured.

One meter cannot distinguish six gears. Two figures hold for all of them: the time constant towards
the motors, ``tau dT_g/dt = T_m - T_g + R P_f / mean(P_f)``, and the rise R by the mean friction
power of each gear. The law of friction stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.condition.thermal_state import WINDOW
from robot_energy.foundation.described import Described
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.model.joint import JointGear
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import NANOSECOND, Float, Phase
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.bounds import at_bound, identified
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.stats.cross_validation import FOLDS, GAIN
from robot_energy_identify.thermal.gear import (
    CORRELATED,
    HIGHEST,
    LOWEST,
    MIN_RISE,
    MIN_WINDOWS,
    SPREAD,
    START,
    GearFit,
    GearsFound,
    lagged,
)

PASSES = 3
OFFSET_SHARE = 0.03  # of the measured power, by which the constants of the model may be off


class _Metered(Described):
    """One recording of a robot with a power meter, in windows of 10 s."""

    friction_power: Annotated[Float, "Mean of each joint, by the model, shape (N, n). [W]"]
    motor_temperature_degc: Annotated[Float, "Shape (N, n). [degC]"]
    squares: Annotated[
        Float,
        "Integral of the motor velocity times what viscous friction is in proportion to, where "
        "the meter sees it, shape (N, n).",
    ]
    residual: Annotated[Float, "Measured less predicted energy, shape (N,). [J]"]
    measured: Annotated[Float, "Measured energy, shape (N,). [J]"]


class _Robot:
    """Recordings with a meter, and what gears that all warm alike leave of its residual."""

    def __init__(self, parts: Sequence[_Metered], friction: FrictionModel, ambient: float) -> None:
        self.parts, self.friction, self.ambient = parts, friction, ambient
        powers = np.concatenate([part.friction_power for part in parts])
        self.mean_power = np.maximum(powers.mean(axis=0), 1e-6)

    def change(self, values: Float) -> list[Float]:
        """Energy of each window that gears add to friction at motor temperature. [J]"""
        time, rise = np.exp(values[:2]).tolist()  # the third is an offset
        found: list[Float] = []
        for part in self.parts:
            degc, more = part.motor_temperature_degc, np.zeros_like(part.squares)
            for _ in range(PASSES):  # a warmer gear has less friction, which warms it less
                power = part.friction_power + more / WINDOW
                gear = lagged(degc + rise * power / self.mean_power, time, degc[:1])
                more = self.friction.viscous(gear) - self.friction.viscous(degc)
                more *= part.squares
            found.append(more.sum(axis=1))
        return found

    def minutes(self, windows: Sequence[Float]) -> Float:
        """Sums over minutes of every recording."""
        starts = [np.arange(0, len(each), CORRELATED) for each in windows]
        return np.concatenate(
            [np.add.reduceat(each, rows) for each, rows in zip(windows, starts, strict=True)]
        )

    def fit(self, used: NDArray[np.bool_] | slice) -> tuple[Float, Float, float]:
        """Time constant and rise as logarithms, their covariance, and the offset of a minute."""
        from scipy.optimize import least_squares

        residual = self.minutes([part.residual for part in self.parts])[used]
        power = self.minutes([part.measured for part in self.parts])[used]
        middle, spread = START[[0, 2]], SPREAD[[0, 2]]
        offset_std = OFFSET_SHARE * float(np.abs(power).mean())
        noise = 1.0

        def errors(x: Float) -> Float:
            left = residual - self.minutes(self.change(x))[used] - x[2] * offset_std
            return np.concatenate([left / noise, (x[:2] - middle) / spread, x[2:]])

        x, jacobian = np.append(middle, 0.0), np.zeros((0, 0))
        low, high = LOWEST[[0, 2]], HIGHEST[[0, 2]]
        bounds = np.append(low, -10.0), np.append(high, 10.0)
        for _ in range(3):
            left = errors(x)[: len(residual)] * noise
            noise = max(float(np.sqrt(np.mean(left**2))), 1e-9) * np.sqrt(2.0)
            found = least_squares(errors, x, bounds=bounds, x_scale="jac", max_nfev=30)
            x, jacobian = found.x, np.asarray(found.jac)
        return x[:2], np.linalg.pinv(jacobian.T @ jacobian)[:2, :2], float(x[2] * offset_std)


@one_thread
def gears_by_meter(
    recordings: Sequence[Recording], ambient_degc: float, source: str = ""
) -> GearsFound:
    """Return gears of a robot whose torque is not measured: two figures for all, from the meter.

    All gears have one time constant towards their motors, and rise alike above them by their mean
    friction power.

    Args:
        ambient_degc: Of the air. [degC]
    """
    model = recordings[0].model
    follows = np.array(
        [FRICTION_LAWS[joint.friction.viscous.law].follows_temperature for joint in model.joints]
    )
    parts = [_metered(part) for part in recordings if part.compared]
    parts = [part for part in parts if np.isfinite(part.motor_temperature_degc).all()]
    warm = any(
        len(part.residual) >= MIN_WINDOWS
        and np.ptp(part.motor_temperature_degc, axis=0).max() >= MIN_RISE
        for part in parts
    )
    if not warm or not follows.any():
        return GearsFound(
            refused=(
                "gears: no recording with a power meter shows a warm-up; record half an hour of "
                "work or more from a cold start, with motor temperatures",
            )
        )
    robot = _Robot(parts, FrictionModel.from_model(model), ambient_degc)
    residual = robot.minutes([part.residual for part in parts])
    measured = robot.minutes([part.measured for part in parts])
    fold = np.arange(len(residual)) % FOLDS
    squares = np.zeros(2)
    for number in range(FOLDS):
        values, _, offset = robot.fit(fold != number)
        test = fold == number
        own = (residual - robot.minutes(robot.change(values)))[test] - offset
        plain = residual[test] - float(residual[~test].mean())
        squares += [own @ own, plain @ plain]
    error, plain_error = np.sqrt(squares / max(float(measured @ measured), 1e-30)).tolist()
    if not error < GAIN * plain_error:
        return GearsFound(
            ambient_degc,
            refused=(
                f"gears: they predict the energy of a minute that they have not seen within "
                f"{100 * error:.1f} %, and motor temperatures alone within {100 * plain_error:.1f} "
                "%; friction follows the motor temperatures",
            ),
        )
    values, covariance, _ = robot.fit(slice(None))
    time, rise = np.exp(values).tolist()
    time_std, rise_std = (np.exp(values) * np.sqrt(np.diag(covariance))).tolist()
    hours = sum(len(part.residual) for part in parts) * WINDOW / 3600.0
    fits: list[GearFit] = []
    for joint, power, has in zip(model.joints, robot.mean_power.tolist(), follows, strict=True):
        if not has:
            continue
        total = power / rise
        share = rise_std / rise
        gear = JointGear(
            capacity=identified(
                time * total, time * total * np.hypot(share, time_std / time), source
            ),
            motor_conductance=identified(total, total * share, source),
            ambient_conductance=at_bound(source),
            std=rise_std,
        )
        fits.append(
            GearFit(joint.name, gear, error, plain_error, (time, time_std), (rise, rise_std), hours)
        )
    return GearsFound(ambient_degc, tuple(fits))


def _metered(recording: Recording) -> _Metered:
    """Sums of a recording over windows of 10 s, where predicted and measured energy are known."""
    power, friction = recording.power, FrictionModel.from_model(recording.model)
    origin = int(power.stamp_ns[0])
    window = ((power.stamp_ns - origin) * NANOSECOND // WINDOW).astype(np.int64)
    count = int(window[-1]) + 1
    step = np.minimum(np.diff(power.stamp_ns, append=power.stamp_ns[-1]) * NANOSECOND, 1.0)
    seen = np.where(power.phase == Phase.GENERATING, 0.0, step)

    def sums(values: Float, weight: Float) -> Float:
        weighed = np.nan_to_num(values) * weight[:, None]
        columns = [np.bincount(window, column, count) for column in weighed.T]
        return np.stack(columns, axis=1).astype(np.float64)

    degc = np.full((count, power.motor_velocity.shape[1]), np.nan)
    degc[window] = power.motor_temperature_degc  # the last one of each stays
    rows = np.isfinite(degc).all(axis=1)
    places = np.flatnonzero(rows)
    if len(places):
        last = np.searchsorted(places, np.arange(count), side="right") - 1
        degc = degc[places[np.maximum(last, 0)]]
    measured, predicted = np.zeros(count), np.zeros(count)
    for part in recording.compared:
        place = ((part.stamp_ns - 1 - origin) * NANOSECOND // WINDOW).astype(np.int64)
        place = np.clip(place, 0, count - 1)
        measured += np.bincount(place, part.measured, count)
        predicted += np.bincount(place, part.drawn, count)
    return _Metered(
        sums(power.friction_power, step) / WINDOW,
        degc,
        sums(power.motor_velocity * friction.viscous_velocity(power.motor_velocity), seen),
        measured - predicted,
        measured,
    )
