"""Delay between the torque channel and the position channel, from the data.

Drives filter and transport their torque on another way than positions. The fits draw on the
prior: without it, a short recording leaves parameters free that take up any delay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float
from robot_energy.identify.data.observations import Observations
from robot_energy.identify.dynamics.consistent import Prior
from robot_energy.identify.dynamics.validation import folds_of
from robot_energy.identify.stats.cross_validation import splits
from robot_energy.identify.stats.lag import Delay, best_delay, held_out_errors
from robot_energy.identify.stats.regression import qr_r

STEPS = 10  # on each side of zero
MIN_GAIN = 0.01  # of the held-out error, below which a delay is not worth believing


def estimate_delay(
    observations: Observations,
    weight: Float,
    prior: Prior,
    span: float,
    guard: float,
) -> Delay:
    """Return the delay of the torque, by cross-validation.

    Args:
        observations: With the prior's columns, torque as measured.
        weight: Of each joint, shape (n,), one over the noise of an independent row. [1/(N m)]
        prior: Of every column.
        span: Delays from minus to plus this are tried. [s]
        guard: Time left out beside each fold. [s]
    """
    delays = np.linspace(-span, span, 2 * STEPS + 1)
    torque = np.stack([observations.advanced(float(d)).joint_torque for d in delays], axis=2)
    reach = int(np.ceil(span * observations.rate))
    used = observations.used & _away_from_cuts(observations, reach)[:, None]
    pairs = list(splits(folds_of(observations), round(guard * observations.rate)))
    kept = np.logical_and.reduce([test | train for train, test in pairs])
    triangles: list[Float] = []
    for _, test in pairs:
        rows, joints = np.nonzero(used & (test & kept)[:, None])
        both = np.concatenate([observations.regressor[rows, joints], torque[rows, joints]], axis=1)
        triangles.append(qr_r(both * weight[joints][:, None]))
    known = _prior_rows(prior, len(delays))
    error = held_out_errors(triangles, observations.regressor.shape[2], known)
    return best_delay(delays, error, error[:, STEPS], span, MIN_GAIN)


def _prior_rows(prior: Prior, delays: int) -> Float:
    """Rows ``[parameter, value of every delay] / std`` of what is known, shape (K, P + D)."""
    known = np.isfinite(prior.std)
    rows = np.diag(np.where(known, 1.0 / np.where(known, prior.std, 1.0), 0.0))
    values = rows @ prior.values
    return np.column_stack([rows, *[values] * delays])[known]


def _away_from_cuts(observations: Observations, reach: int) -> NDArray[np.bool_]:
    """Rows whose shifted torque is measured, not held from the end of a stretch."""
    row = np.arange(len(observations.segment))
    starts = np.searchsorted(observations.segment, observations.segment, side="left")
    ends = np.searchsorted(observations.segment, observations.segment, side="right")
    return (row - starts >= reach) & (row < ends - reach)
