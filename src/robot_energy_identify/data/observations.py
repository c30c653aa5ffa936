"""Measured channels -> rows of the identification model, both sides filtered alike.

``joint_torque = regressor . parameters`` at every row: the observation matrix of paper B,
eq. 18. Positions and torques pass the same filter before (zero-phase Butterworth; velocities and
accelerations are central differences, paper B, section 4.3.3), and both sides of the equation
the same low-pass after, so that no filter shifts one against the other. Whatever is cut off is cut
off all channels with the same rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import blake2b
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError, ShapeError
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_identify.dynamics.torque_model import TorqueModel
from robot_energy_plan.motion import Trajectory
from robot_energy_plan.motion.sampled_motion import MEMORY, low_pass, motion_from_position, uniform

MIN_DURATION = 1.0  # s: shorter stretches are left out


class Channels(Described):
    """What one stretch of a recording gives, on a uniform grid in model joint order."""

    rate: Annotated[float, "Samples per second. [Hz]"]
    joint_position: Annotated[Float, "Shape (N, n). [rad] or [m]"]
    motor_torque: Annotated[Float, "Measured, motor side, shape (N, n). [N m]"]

    def __post_init__(self) -> None:
        if self.joint_position.shape != self.motor_torque.shape:
            raise ShapeError(
                f"positions have shape {self.joint_position.shape} and torques "
                f"{self.motor_torque.shape}",
                "one torque for every position",
            )


def later(values: Float, rate: float, delay: float) -> Float:
    """Return a channel, same shape, as it is a while later: undoes a delay of that length.

    Beyond the end the last value stands; cut it off with `inside`.

    Args:
        values: Shape (N, n), uniform in time, smooth. [any unit]
        rate: [Hz]
        delay: Not a whole number of samples; may be negative. [s]
    """
    if delay == 0.0:
        return values
    from scipy.interpolate import CubicSpline

    at = np.arange(len(values), dtype=np.float64)
    wanted = np.clip(at + delay * rate, 0.0, at[-1])
    return np.asarray(CubicSpline(at, values, axis=0)(wanted))


def inside(count: int, margin: int) -> NDArray[np.bool_]:
    """Return a mask of the samples that are not within a margin of either end, shape (count,).

    One for all channels, so that both sides of an equation lose the same rows at both ends.
    """
    row = np.arange(count)
    return (row >= margin) & (row < count - margin)


def standing(speed: Float, threshold: float, window: int) -> NDArray[np.bool_]:
    """Return where something stands still for longer than a moment, shape (N, n).

    Args:
        speed: Shape (N, n), any sign. [rad/s] or [m/s]
        threshold: Below it nothing moves; same unit. [rad/s] or [m/s]
        window: Samples around each one that must stand too, so that the instant of a
            reversal is not a standstill.
    """
    from scipy.ndimage import maximum_filter1d

    size = 2 * window + 1
    return np.asarray(maximum_filter1d(np.abs(speed), size, axis=0, mode="nearest")) < threshold


def stretches(
    stamp_ns: Int,
    segment: Int,
    joint_position: Float,
    motor_torque: Float,
    rate: float | None = None,
) -> list[Channels]:
    """Return the stretches between gaps that are long enough, all on one uniform grid.

    Args:
        stamp_ns: Shape (N,). [ns]
        segment: Changes at every gap or jump of the stamps, shape (N,).
        joint_position: Shape (N, n). [rad] or [m]
        motor_torque: Shape (N, n). [N m]
        rate: Of the grid; default the median rate of the recording. [Hz]
    """
    cuts = np.flatnonzero(np.diff(segment) != 0) + 1
    parts = np.split(np.arange(len(stamp_ns)), cuts)
    steps = np.diff(stamp_ns)[np.diff(segment) == 0]
    if len(steps):
        grid = float(1.0 / (np.median(steps) * NANOSECOND)) if rate is None else rate
        result = [
            Channels(
                grid,
                uniform(stamp_ns[rows], joint_position[rows], grid),
                uniform(stamp_ns[rows], motor_torque[rows], grid),
            )
            for rows in parts
            if (stamp_ns[rows[-1]] - stamp_ns[rows[0]]) * NANOSECOND >= MIN_DURATION
        ]
        if result:
            return result
    raise NotIdentifiableError(
        f"the recording has no stretch of {MIN_DURATION:g} s without gaps",
        "continuous motion for several seconds",
        "record again at a steady rate",
    )


MOTION_PER_RATE = 5.0  # samples per period of the filter of the positions
ROWS_PER_RATE = 10.0  # rows per period of the filter of both sides
PART = 5_000  # samples whose regressor is filtered at once
OVERLAP = 3  # of parts, in times that the filter remembers: what is left of an end is 1e-9
BY_ROW = ("regressor", "joint_torque", "used", "compared", "segment", "payload_torque")
SHARE_OF_RATE = 0.2  # of the recording's rate that the filter of the positions may pass


class Filters(Described):
    """How the channels are filtered."""

    cutoff: Annotated[float, "Of both sides of the equation. [Hz]"] = 10.0
    motion_cutoff: Annotated[
        float, "Of positions and torques before, at most a fifth of the recording's rate. [Hz]"
    ] = 100.0
    standing_velocity: Annotated[
        float, "Of a joint; below it friction is undetermined. [rad/s] or [m/s]"
    ] = 0.02


class Observations(Described):
    """Rows of the identification model, joint side."""

    names: tuple[str, ...]
    regressor: Annotated[Float, "Torque per unit of each parameter, shape (N, n, P)."]
    joint_torque: Annotated[Float, "Measured, payload taken off, shape (N, n). [N m] or [N]"]
    used: Annotated[NDArray[np.bool_], "Rows to fit: not standing, not at an end, shape (N, n)."]
    compared: Annotated[NDArray[np.bool_], "Rows away from the ends, standing or not, shape (N,)."]
    segment: Annotated[Int, "Which stretch of the recording a row is of, shape (N,)."]
    rate: Annotated[float, "Rows per second. [Hz]"]
    motion: Annotated[Trajectory, "The motion behind the rows, before the low-pass of both sides."]
    payload_torque: Annotated[Float, "Taken off the measured torque, shape (N, n). [N m] or [N]"]

    @property
    def duration(self) -> float:
        """Time that the rows cover. [s]"""
        return len(self.segment) / self.rate

    @property
    def equation(self) -> tuple[Float, Float]:
        return self.regressor, self.joint_torque

    def advanced(self, delay: float) -> Observations:
        """Return the observations with a delay of the torque undone.

        Args:
            delay: By which the torque channel lags the positions; may be negative. [s]
        """
        torque = self.joint_torque.copy()
        for number in np.unique(self.segment):
            rows = self.segment == number
            torque[rows] = later(self.joint_torque[rows], self.rate, delay)
        return replace(self, joint_torque=torque)

    def with_columns(self, keep: Sequence[int] | Int) -> Observations:
        """Return the observations with some of the parameters only.

        Args:
            keep: Places of these parameters, shape (K,).
        """
        columns = np.ascontiguousarray(self.regressor[:, :, np.asarray(keep, dtype=np.int64)])
        return replace(self, names=tuple(self.names[int(k)] for k in keep), regressor=columns)

    def without_rows(self) -> Observations:
        """Return the observations with no row, which is next to no memory."""
        none = slice(0, 0)
        kept = {name: getattr(self, name)[none].copy() for name in BY_ROW}
        return replace(self, **kept, motion=self.motion[none])

    def with_names(self, names: Sequence[str]) -> Observations:
        if tuple(names) == self.names:
            return self
        return self.with_columns([self.names.index(name) for name in names])


Rows = dict[tuple[bytes, float, tuple[str, ...], Filters], tuple[Trajectory, Float, Float]]
"""By positions, rate, parameters and filters: motion, regressor and torque of the payload."""


def observe(
    channels: Sequence[Channels],
    torque_model: TorqueModel,
    filters: Filters,
    seen: Rows | None = None,
) -> Observations:
    """Return the rows of recorded channels without gaps, of one rate, in the order of recording.

    The payload is known and taken off the torque. Rows of the same motion of the same robot that
    were ``seen`` are not made again; more are added.
    """
    made: Rows = {} if seen is None else seen
    known = set(made)
    parts = [
        _observe(part, number, torque_model, filters, made) for number, part in enumerate(channels)
    ]
    if len(parts) == 1:
        return parts[0]
    whole = replace(
        parts[0],
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in BY_ROW},
        motion=Trajectory.concatenate([part.motion for part in parts]),
    )
    if not known and len(made) == len(
        parts
    ):  # all rows are new, and no other fit has them: they are kept once
        edges = np.flatnonzero(np.diff(whole.segment)) + 1
        regressors = iter(np.split(whole.regressor, edges))
        for key, (motion, _, payload) in made.items():
            made[key] = motion, next(regressors), payload
    return whole


def _observe(
    channels: Channels, number: int, torque_model: TorqueModel, filters: Filters, seen: Rows
) -> Observations:
    rate, transmission = channels.rate, torque_model.transmission
    position = np.ascontiguousarray(channels.joint_position)
    key = (blake2b(position.tobytes()).digest(), rate, torque_model.names, filters)
    cutoff = min(filters.motion_cutoff, SHARE_OF_RATE * rate)
    torque = low_pass(channels.motor_torque @ transmission, rate, cutoff)
    step = max(1, int(rate / (MOTION_PER_RATE * cutoff)))
    rate /= step
    if (known := seen.get(key)) is None:
        motion = motion_from_position(position, channels.rate, cutoff)[::step]
    else:
        motion = known[0]
    used, compared = usable(motion.joint_velocity, rate, transmission, filters)
    torque = low_pass(torque[::step], rate, filters.cutoff)
    step = max(1, int(rate / (ROWS_PER_RATE * filters.cutoff)))
    rows = slice(None, None, step)
    if known is None:
        known = seen[key] = motion, *_filtered(motion, rate, step, torque_model, filters.cutoff)
    _, regressor, payload = known
    return Observations(
        names=torque_model.names,
        regressor=regressor,
        joint_torque=torque[rows] - payload,
        used=used[rows],
        compared=compared[rows],
        segment=np.full(len(payload), number, dtype=np.int64),
        rate=rate / step,
        motion=motion[rows],
        payload_torque=payload,
    )


def _filtered(
    motion: Trajectory, rate: float, step: int, torque_model: TorqueModel, cutoff: float
) -> tuple[Float, Float]:
    """Regressor and torque of the payload behind the filter, every so many samples.

    Made part by part, so that only what is kept takes memory; parts overlap for as long as the
    filter remembers.
    """
    margin = OVERLAP * int(np.ceil(MEMORY * rate / cutoff))
    size = -(-max(PART, margin) // step) * step
    regressors, payloads = list[Float](), list[Float]()
    for first in range(0, len(motion), size):
        begin, end = max(0, first - margin), min(first + size, len(motion))
        part = motion[begin : end + margin]
        regressor = torque_model.regressor(part)
        payload = torque_model.payload_torque(part, regressor)
        flat = regressor.reshape(len(regressor), -1)
        active = flat.any(axis=0)  # about half of the columns are zero by structure
        flat[:, active] = low_pass(flat[:, active], rate, cutoff)
        kept = slice(first - begin, end - begin, step)
        regressors.append(np.ascontiguousarray(regressor[kept]))
        payloads.append(low_pass(payload, rate, cutoff)[kept])
    return np.concatenate(regressors), np.concatenate(payloads)


def usable(
    joint_velocity: Float, rate: float, transmission: Float, filters: Filters
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return rows to fit, of each joint, shape (N, n), and rows to compare, shape (N,).

    A joint's row is out while a motor that acts on the joint stands: its friction is then
    unknown. The ends are out for the reach of the filter.

    Args:
        joint_velocity: Shape (N, n). [rad/s] or [m/s]
        rate: Of the rows. [Hz]
        transmission: Motor turns per joint turn, shape (n, n). [-]
    """
    reach = max(1, round(0.5 * rate / filters.cutoff))
    share = transmission / np.diagonal(transmission)[:, None]
    still = standing(joint_velocity @ share.T, filters.standing_velocity, reach)
    acts = transmission != 0.0
    held = (still.astype(np.float64) @ acts) > 0.0
    compared = inside(len(joint_velocity), 2 * reach)
    return ~held & compared[:, None], compared
