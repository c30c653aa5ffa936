"""Recorded channels made ready for a fit: filtered without delay, aligned, cut alike.

Positions and torques go through the same zero-phase Butterworth filter and velocities and
accelerations are central differences (paper B, section 4.3.3). Whatever is cut off is cut
off all channels with the same rows, so that no channel can be shifted against another.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError, ShapeError
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_plan.motion.sampled_motion import uniform

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
