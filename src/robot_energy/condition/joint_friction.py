"""Learns one multiplier on the friction of each joint whose torque is measured.

Along the direction of motion, ``(measured - rigid torque) sgn(w)`` is friction plus the error
of the rigid-body torque. The error of a load that the model does not have acts the same way
whichever way the joint turns, so it has opposite signs in the two directions and leaves
their mean:

``multiplier = (sum_fwd y / sum_fwd x + sum_bwd y / sum_bwd x) / 2``,

``y = (tau_measured - tau_rigid) sgn(w)``, ``x = |friction torque of the model|`` at the present
speed and temperature. A part of five seconds is taken or refused as a whole.

A value between two buckets of speed or temperature belongs to both, the nearer one more, and the
weights sum to one, so that no sum jumps where a motor crosses an edge.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.physics.drivetrain import ABOVE_STANDSTILL
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    Float,
    Int,
    PowerBlock,
)

SLOWEST = 0.05  # speed of the slowest bucket, joint side [rad/s] or [m/s]
SPEED_STEP = 4.0  # from one bucket of speed to the next
SPEED_BUCKETS = 4  # 0.05, 0.2, 0.8, 3.2
DEGC_STEP = 10.0  # from one bucket of temperature to the next [K]
DEGC_BUCKETS = 10  # 0 to 90 degC

BUCKET_SPEED = SLOWEST * SPEED_STEP ** np.arange(SPEED_BUCKETS)
BUCKET_DEGC = DEGC_STEP * np.arange(DEGC_BUCKETS)


def speed_place(speed: Float) -> Float:
    """Return where speeds lie among the buckets, 0 to ``SPEED_BUCKETS - 1``, same shape. [-]

    Args:
        speed: Amount, joint side, any shape. [rad/s] or [m/s]
    """
    with np.errstate(divide="ignore"):
        place = np.log(speed / SLOWEST) / np.log(SPEED_STEP)
    return np.clip(place, 0.0, SPEED_BUCKETS - 1.0)


def degc_place(motor_temperature_degc: Float) -> Float:
    """Return where temperatures lie among the buckets, 0 to ``DEGC_BUCKETS - 1``. [-]

    Args:
        motor_temperature_degc: Any shape. [degC]
    """
    return np.clip(motor_temperature_degc / DEGC_STEP, 0.0, DEGC_BUCKETS - 1.0)


def shares(place: Float, buckets: int) -> Float:
    """Return the weight of every bucket, shape (..., B); each row sums to one. [-]

    Args:
        place: Shape (...). [-]
    """
    return np.maximum(1.0 - np.abs(place[..., None] - np.arange(buckets)), 0.0)


def interpolated(table: Float, degc: Float, speed: Float) -> Float:
    """Return the values of tables between their buckets, shape (N, n). [-]

    Args:
        table: One of each joint, shape (n, DEGC_BUCKETS, SPEED_BUCKETS). [-]
        degc: Places of the temperatures, shape (N, n). [-]
        speed: Places of the speeds, shape (N, n). [-]
    """
    row, up_row = _corner(degc, DEGC_BUCKETS)
    column, up_column = _corner(speed, SPEED_BUCKETS)
    flat = table.reshape(-1)
    first = np.arange(len(table)) * (DEGC_BUCKETS * SPEED_BUCKETS) + row * SPEED_BUCKETS + column
    low = flat[first] + (flat[first + 1] - flat[first]) * up_column
    first += SPEED_BUCKETS
    high = flat[first] + (flat[first + 1] - flat[first]) * up_column
    return low + (high - low) * up_row


def _corner(place: Float, buckets: int) -> tuple[Int, Float]:
    """The bucket below, and how far it is to the next."""
    below = np.minimum(place.astype(np.int64), buckets - 2)
    return below, place - below


BOUNDS = (0.5, 2.0)  # of a multiplier, around the model file [-]
MAX_RATIO = 10.0  # of one part, either way; beyond it is a collision or a wrong torque [-]
MEMORY = 1800.0  # of a bucket and direction [s]
RAW_MEMORY = 60.0  # of the raw multiplier [s]
MIN_TIME = 20.0  # in each direction, before a joint's multiplier is valid [s]
MIN_BUCKET_TIME = 2.0  # in each direction, before a bucket counts [s]
SHRINK_TIME = 10.0  # a bucket with this time lies half way to the joint's mean [s]
GRID = 1e-6  # multipliers are rounded to it: no rounding error of a sum shows in a register


class MotionSums(Described):
    """What one part of the samples says of each joint, forward and backward."""

    stamp_ns: int
    model: Annotated[
        Float,
        "Sum of the model's friction torque times the sample period, by bucket of speed, shape "
        "(2, n, SPEED_BUCKETS). [N m s]",
    ]
    measured: Annotated[Float, "The same of the measured friction torque. [N m s]"]
    time: Annotated[Float, "Time in motion, same shape. [s]"]
    load: Annotated[
        Float, "Sum of the amount of the rigid torque times the period, shape (2, n). [N m s]"
    ]
    degc: Annotated[Float, "Mean temperature, shape (n,). [degC]"]

    @property
    def ratio(self) -> Float:
        """Measured over model friction, shape (2, n); NaN without motion. [-]"""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.measured.sum(axis=2) / self.model.sum(axis=2)


class MotionReader:
    """Cuts what power samples say of friction into sums, part by part.

    Args:
        gear_ratio: Amount, shape (n,). [motor turns per joint turn]
        standstill: Speed below which a motor stands, shape (n,). [rad/s]
        fallback_degc: Temperature that the model assumes where none is measured. [degC]
    """

    def __init__(self, gear_ratio: Float, standstill: Float, fallback_degc: float) -> None:
        self.gear_ratio = gear_ratio
        self._floor = ABOVE_STANDSTILL * standstill[:, None]
        self._fallback_degc = fallback_degc

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def read(self, block: PowerBlock, friction_power: Float) -> MotionSums | None:
        """Return the sums over the samples of one part; None if no torque was measured.

        Args:
            friction_power: By the model file, shape (N, n). [W]
        """
        if np.isnan(block.shaft_power_measured).all():
            return None
        velocity = _rows(block.motor_velocity)
        speed = np.abs(velocity)
        model = _rows(friction_power) / speed
        rigid = _rows(block.rigid_power) / speed
        measured = _rows(block.shaft_power_measured) / speed - rigid
        good = (speed > self._floor) & np.isfinite(measured) & (model > 0)
        good &= (block.quality & np.uint32(DOUBTFUL)) == 0
        place = speed_place(np.where(good, speed, 1.0) / self.gear_ratio[:, None])
        stamp = block.stamp_ns
        period = float(stamp[-1] - stamp[0]) * NANOSECOND / max(len(stamp) - 1, 1)
        weight = shares(place, SPEED_BUCKETS) * period
        ways = np.stack([good & (velocity > 0), good & (velocity < 0)])

        def summed(values: Float) -> Float:
            return np.stack([np.einsum("nt,ntk->nk", np.where(w, values, 0), weight) for w in ways])

        return MotionSums(
            int(stamp[-1]),
            summed(model),
            summed(measured),
            summed(np.ones_like(speed)),
            np.where(ways, np.abs(rigid), 0.0).sum(axis=2) * period,
            _rows(self.temperature(block.motor_temperature_degc)).mean(axis=1),
        )

    def temperature(self, motor_temperature_degc: Float) -> Float:
        """Return the temperatures that the friction model has used, same shape. [degC]

        Args:
            motor_temperature_degc: NaN where none is known, shape (N, n). [degC]
        """
        missing = np.isnan(motor_temperature_degc)
        return np.where(missing, self._fallback_degc, motor_temperature_degc)

    def places(self, motor_velocity: Float, motor_temperature_degc: Float) -> tuple[Float, Float]:
        """Return places among the buckets of temperature and of speed, shape (N, n) each. [-]

        Args:
            motor_velocity: Shape (N, n). [rad/s]
            motor_temperature_degc: Shape (N, n). [degC]
        """
        degc = degc_place(self.temperature(motor_temperature_degc))
        speed = np.nan_to_num(np.abs(motor_velocity), nan=0.0, posinf=0.0)
        return degc, speed_place(speed / self.gear_ratio)


class FrictionLearner:
    """Multipliers on the friction of each joint, by bucket.

    Attributes:
        sums: Of the model's and the measured friction torque and of time, by direction, joint
            and bucket, shape (3, 2, n, DEGC_BUCKETS, SPEED_BUCKETS). [N m s], [N m s], [s]
        newest: The same of the last minute without buckets, shape (3, 2, n).
        parts: Parts in motion that were used, shape (n,).
        refused: Parts that were not, as their torque makes no sense, shape (n,).
    """

    def __init__(self, n_joints: int) -> None:
        self.sums: Float = np.zeros((3, 2, n_joints, DEGC_BUCKETS, SPEED_BUCKETS))
        self.newest: Float = np.zeros((3, 2, n_joints))
        self.parts = np.zeros(n_joints, dtype=np.int64)
        self.refused = np.zeros(n_joints, dtype=np.int64)

    def step(self, part: MotionSums) -> MotionSums:
        """Return a part without what is refused; the rest has been learned from."""
        moved = part.time.sum(axis=2) > 0
        kept = moved & (np.abs(np.nan_to_num(part.ratio)) <= MAX_RATIO)
        self.refused += (moved & ~kept).any(axis=0)
        self.parts += kept.any(axis=0)
        used = replace(
            part,
            model=np.where(kept[:, :, None], part.model, 0.0),
            measured=np.where(kept[:, :, None], part.measured, 0.0),
            time=np.where(kept[:, :, None], part.time, 0.0),
            load=np.where(kept, part.load, 0.0),
        )
        parts = np.stack([used.model, used.measured, used.time])
        degc = shares(degc_place(part.degc), DEGC_BUCKETS)
        self.sums += parts[:, :, :, None, :] * degc[:, :, None]
        self.newest += parts.sum(axis=3)
        for sums, memory in ((self.sums, MEMORY), (self.newest, RAW_MEMORY)):
            sums *= np.minimum(1.0, memory / np.maximum(sums[2], memory))
        return used

    @property
    def raw(self) -> Float:
        """Multiplier of the last minute of motion, shape (n,); NaN where unknown. [-]"""
        return _both_ways(self.newest, 0.0)

    @property
    def filtered(self) -> Float:
        """Mean over the buckets, within bounds, shape (n,); NaN where unknown. [-]"""
        return np.clip(_both_ways(self.sums.sum(axis=(3, 4)), 0.0), *BOUNDS)

    @property
    def valid(self) -> np.ndarray:
        """Whether a joint's multiplier can be used, shape (n,)."""
        enough = (self.sums[2].sum(axis=(2, 3)) >= MIN_TIME).all(axis=0)
        return enough & np.isfinite(self.filtered)

    @property
    def buckets(self) -> Float:
        """Multiplier of each bucket as measured, within bounds; NaN where unknown. [-]

        Shape (n, DEGC_BUCKETS, SPEED_BUCKETS).
        """
        return np.clip(_both_ways(self.sums, MIN_BUCKET_TIME), *BOUNDS)

    @property
    def bucket_time(self) -> Float:
        """Time behind each bucket, the lesser of both directions, as `buckets`. [s]"""
        return self.sums[2].min(axis=0)

    def table(self) -> Float:
        """Return the multiplier of every bucket, as `buckets`, 1 for a joint that is not valid. [-]

        A bucket with little time is drawn to the mean of its joint, one without has it.
        """
        mean = np.where(self.valid, self.filtered, 1.0)[:, None, None]
        own = self.buckets
        time = np.where(np.isnan(own), 0.0, self.bucket_time)
        table = (time * np.nan_to_num(own) + SHRINK_TIME * mean) / (time + SHRINK_TIME)
        table = np.where(self.valid[:, None, None], table, 1.0)
        return np.round(table / GRID) * GRID


@np.errstate(divide="ignore", invalid="ignore")
def _both_ways(sums: Float, min_time: float) -> Float:
    """Mean of the ratios of both directions; NaN where one lacks time."""
    model, measured, time = sums
    known = (time > min_time) & (model > 0)
    return np.where(known, measured / model, np.nan).mean(axis=0)


def _rows(values: Float) -> Float:
    """One row per joint, always in the same order in memory."""
    return np.ascontiguousarray(values.T)
