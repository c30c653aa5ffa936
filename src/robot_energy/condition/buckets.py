"""Buckets of speed and temperature, with weights that fall linearly to the next bucket.

A value between two buckets belongs to both, the nearer one more, and the weights sum to one.
So no sum jumps where a motor crosses an edge. Outside the outermost buckets, these hold.
"""

from __future__ import annotations

import numpy as np

from robot_energy.timeline.blocks import Float, Int

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
