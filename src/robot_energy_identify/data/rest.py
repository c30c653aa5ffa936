"""Where the joints of a recording stand still.

Which joints stand still is recognised by the noise of their velocity and not by a fixed threshold.
The noise of a joint's velocity is its standard deviation about a straight line in windows of a
quarter of a second, of which the lowest twentieth counts: rest, or motion at constant speed. A
joint stands where its velocity is within four of these deviations of 0, and its mean over a
tenth of a second within two; both limits are at least the ``standstill_velocity`` of the model.
The first finds rest under noise, the second keeps a slow, steady motion apart from it.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_identify.check.evidence import velocity_noise
from robot_energy_identify.data.recordings import Recording

AROUND = 50_000_000  # ns to each side, over which the mean velocity is taken
SAMPLE_DEVIATIONS = 4.0
MEAN_DEVIATIONS = 2.0
MAX_NOISE = 0.02  # rad/s: a recording without rest or steady motion shows no noise, but motion


def still(stamp_ns: Int, velocity: Float, standstill: Float) -> NDArray[np.bool_]:
    """Return where each joint stands, shape (N, n); False where the velocity is not finite.

    Args:
        stamp_ns: Rising, shape (N,). [ns]
        velocity: Shape (N, n). [rad/s] or [m/s]
        standstill: Of the model, shape (n,). [rad/s] or [m/s]
    """
    noise = np.minimum(np.nan_to_num(velocity_noise(stamp_ns, velocity)), MAX_NOISE)
    known = np.isfinite(velocity)
    total = np.zeros((len(velocity) + 1, velocity.shape[1]))
    np.cumsum(np.where(known, velocity, 0.0), axis=0, out=total[1:])
    first, last = window(stamp_ns)
    mean = (total[last] - total[first]) / (last - first)[:, None]
    near = np.abs(velocity) <= np.maximum(standstill, SAMPLE_DEVIATIONS * noise)
    return known & near & (np.abs(mean) <= np.maximum(standstill, MEAN_DEVIATIONS * noise))


def window(stamp_ns: Int) -> tuple[Int, Int]:
    """Return the first sample of `AROUND` each one and the one behind the last, shape (N,).

    Args:
        stamp_ns: Rising, shape (N,). [ns]
    """
    first = np.searchsorted(stamp_ns, stamp_ns - AROUND, side="left")
    last = np.searchsorted(stamp_ns, stamp_ns + AROUND, side="right")
    return first, last


def still_joints(recording: Recording) -> NDArray[np.bool_]:
    """Return where each joint of a recording stands, shape (N, n)."""
    block = recording.torque
    standstill = np.array([joint.standstill_velocity for joint in recording.model.joints])
    return still(block.stamp_ns, block.joint_velocity, standstill)


class Rest(Described):
    """Stretches in which no joint moves."""

    total: Annotated[float, "Time of all of them. [s]"]
    longest: Annotated[float, "[s]"]
    count: int

    def __str__(self) -> str:
        if not self.count:
            return "no joint states at rest were found"
        return (
            f"the joints rest {self.total:.1f} s in all, {self.count} times, {self.longest:.1f} s "
            "at the longest"
        )


def rest_of(stamp_ns: Int, resting: NDArray[np.bool_]) -> Rest:
    """Return how long and how often a robot rests.

    Args:
        stamp_ns: Rising, shape (N,). [ns]
        resting: Where no joint moves, shape (N,).
    """
    edges = np.flatnonzero(np.diff(resting.astype(np.int8), prepend=0, append=0))
    starts, ends = edges[::2], edges[1::2] - 1
    spans = (stamp_ns[ends] - stamp_ns[starts]) * NANOSECOND
    return Rest(float(spans.sum()), float(spans.max(initial=0.0)), len(spans))
