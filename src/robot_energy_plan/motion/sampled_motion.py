"""Recorded positions -> motion: on a uniform grid, filtered without delay, differentiated."""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_plan.motion.ptp import Trajectory

ORDER = 2  # of the filter; forward and backward make it 4
MIN_SAMPLES = 20
MEMORY = 1.5  # periods of the cut-off frequency after which a filter has forgotten its start


def low_pass(values: Float, rate: float, cutoff: float) -> Float:
    """Return values filtered forward and backward (Butterworth): no delay at any frequency.

    Args:
        values: Shape (N, ...), uniform in time. [any unit]
        rate: [Hz]
        cutoff: Where the filter, passed twice, halves the amplitude. [Hz]
    """
    from scipy.signal import butter, sosfiltfilt

    if len(values) < MIN_SAMPLES:
        raise NotIdentifiableError(
            f"a stretch of the recording has {len(values)} samples",
            f"at least {MIN_SAMPLES}",
            "record longer without gaps",
        )
    if not 0 < cutoff < 0.5 * rate:
        raise NotIdentifiableError(
            f"the filter is to pass {cutoff:g} Hz of a recording at {rate:g} Hz",
            f"a cut-off frequency below {0.5 * rate:g} Hz",
            "record faster or lower the cut-off frequency",
        )
    # Extended at both ends for as long as the filter remembers, whatever the rate.
    memory = min(len(values) - 1, int(np.ceil(MEMORY * rate / cutoff)))
    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=memory))


def motion_from_position(joint_position: Float, rate: float, cutoff: float) -> Trajectory:
    """Return filtered positions and their first two central differences, at the same instants.

    Args:
        joint_position: Shape (N, n). [rad] or [m]
        rate: [Hz]
        cutoff: Of the zero-phase filter. [Hz]
    """
    position = low_pass(joint_position, rate, cutoff)
    velocity = np.gradient(position, 1.0 / rate, axis=0)
    return Trajectory(position, velocity, np.gradient(velocity, 1.0 / rate, axis=0))


def uniform(stamp_ns: Int, values: Float, rate: float) -> Float:
    """Return jittering samples on a uniform grid, by linear interpolation, shape (M, n).

    Args:
        stamp_ns: Strictly rising, without gaps, shape (N,). [ns]
        values: Shape (N, n). [any unit]
        rate: Of the grid, which starts at the first stamp. [Hz]
    """
    since = (stamp_ns - stamp_ns[0]) * NANOSECOND
    grid = np.arange(int(since[-1] * rate + 1e-9) + 1) / rate
    columns = [np.interp(grid, since, values[:, joint]) for joint in range(values.shape[1])]
    return np.stack(columns, axis=1)
