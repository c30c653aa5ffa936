"""Do velocity and effort of a joint state belong to the instant of its position?

A driver may filter them, or send them later. What they follow at the stamp t is known: the change
of the position, or the torque of the bodies and friction. Values at t + L are fitted by it, and the
L that leaves least is how late they are. Signs, scales and gear ratios do not matter for it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from robot_energy.timeline.blocks import Float

MAX_LATE = 1.0  # s
LAGS = np.arange(-MAX_LATE, MAX_LATE + 1e-9, 0.01)
LEAST_STEPS = 1.5  # usual steps of the stamps
MAX_LEFT = 0.5  # share of the variance, beyond which what they follow is not known
MAX_SHARE = 0.65  # of what is left without a lag, that may be left with it
MIN_SPAN = 10.0  # s
MIN_ROWS, MAX_ROWS = 50, 2000


def field_lag(time: Float, joints: Iterable[tuple[Float, Float]], least: float) -> float:
    """Return how late values of joints are, 0 where that is little or not known. [s]

    Args:
        time: Of the samples, shape (N,). [s]
        joints: Of each joint what the values follow, shape (N, K), and the values, shape (N,).
            [any unit]
        least: What counts as late. [s]
    """
    step = np.diff(time)
    if not len(step) or time[-1] - time[0] < MIN_SPAN or not (step > 0.0).all():
        return 0.0
    rows = np.flatnonzero((time - time[0] >= MAX_LATE) & (time[-1] - time >= MAX_LATE))
    rows = rows[:: max(1, len(rows) // MAX_ROWS)]
    left: list[Float] = []
    for follows, values in joints:
        used, known = rows[np.isfinite(follows[rows]).all(axis=1)], np.isfinite(values)
        if min(len(used), np.count_nonzero(known)) < MIN_ROWS:
            continue
        base = np.linalg.qr(follows[used] - follows[used].mean(axis=0))[0]
        late = np.interp(time[used] + LAGS[:, None], time[known], values[known])
        late -= late.mean(axis=1, keepdims=True)
        size = (late**2).sum(axis=1)
        explained = ((late @ base) ** 2).sum(axis=1)
        left.append(1.0 - explained / np.where(size > 0.0, size, np.inf))
    left = [one for one in left if one.min() < MAX_LEFT]
    if not left:
        return 0.0
    mean = np.mean(left, axis=0)
    best, lag = int(np.argmin(mean)), float(LAGS[int(np.argmin(mean))])
    least = max(least, LEAST_STEPS * float(np.median(step)))
    shown = mean[best] < MAX_SHARE * mean[len(LAGS) // 2] and least < abs(lag) < MAX_LATE
    return lag if shown else 0.0
