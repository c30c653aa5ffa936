"""Delay between the torque channel and the position channel, from the data.

Drives filter and transport their torque on another way than positions. For every delay in
a small range the model is fitted on four fifths of the recording and tested on the rest;
the delay of the least held-out error is the estimate, to fractions of a sample. The fits draw
on the prior: without it, a short recording leaves parameters free that take up any delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float
from robot_energy.identify.consistent import Prior
from robot_energy.identify.observations import Observations
from robot_energy.identify.triangle import triangle_of
from robot_energy.identify.validation import splits

STEPS = 10  # on each side of zero
LEAST_GAIN = 0.01  # of the held-out error, below which a delay is not worth believing


@dataclass(frozen=True)
class Delay:
    """The estimate and what it rests on.

    Attributes:
        value: By which the torque lags the positions, at the least held-out error. [s]
        gain: Share of the held-out error it takes away. [-]
        applied: The value, or 0 where the gain is below 1 % or the value at the end. [s]
        at_edge: Whether the least error is at the end of the range.
    """

    value: float
    gain: float
    applied: float
    at_edge: bool


def estimate_delay(
    observations: Observations,
    weight: Float,
    prior: Prior,
    span: float,
    folds: int,
    guard: float,
) -> Delay:
    """Estimate the delay by cross-validation.

    Args:
        observations: With the prior's columns, torque as measured.
        weight: Of each joint, shape (n,), one over the noise of an independent row. [1/(N m)]
        prior: Of every column.
        span: Delays from minus to plus this are tried. [s]
        folds: Number of contiguous folds.
        guard: Time left out beside each fold. [s]

    Returns:
        The estimate.
    """
    delays = np.linspace(-span, span, 2 * STEPS + 1)
    torque = np.stack([observations.advanced(float(d)).joint_torque for d in delays], axis=2)
    reach = int(np.ceil(span * observations.rate))
    used = observations.used & _away_from_cuts(observations, reach)[:, None]
    triangles = _triangles(observations, torque, used, weight, folds, guard)
    width = observations.regressor.shape[2]
    error = np.zeros(len(delays))
    known = _prior_rows(prior, len(delays))
    for test in range(len(triangles)):
        train = [part for fold, part in enumerate(triangles) if fold != test]
        triangle = triangle_of(np.concatenate([*train, known]))
        values = np.linalg.lstsq(triangle[:width, :width], triangle[:width, width:], rcond=None)[0]
        held = triangles[test]
        error += ((held[:, :width] @ values - held[:, width:]) ** 2).sum(axis=0)
    size = np.sqrt(error)
    best = int(np.argmin(size))
    at_edge = best in (0, len(delays) - 1)
    value, least = float(delays[best]), float(size[best])
    if not at_edge:  # the parabola through the least error and its neighbours
        before, here, after = size[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        if bend > 0.0:
            part = 0.5 * (before - after) / bend
            value += float(part) * float(delays[1] - delays[0])
            least = float(here - 0.25 * (before - after) * part)
    gain = 1.0 - least / float(size[STEPS]) if size[STEPS] > 0 else 0.0
    believed = gain >= LEAST_GAIN and not at_edge  # at the end there is no least error yet
    return Delay(value, gain, value if believed else 0.0, at_edge)


def _prior_rows(prior: Prior, delays: int) -> Float:
    """Rows ``[parameter, value of every delay] / std`` of what is known, shape (K, P + D)."""
    known = np.isfinite(prior.std)
    rows = np.diag(np.where(known, 1.0 / np.where(known, prior.std, 1.0), 0.0))
    values = rows @ prior.values
    return np.column_stack([rows, *[values] * delays])[known]


def _triangles(
    observations: Observations,
    torque: Float,
    used: NDArray[np.bool_],
    weight: Float,
    folds: int,
    guard: float,
) -> list[Float]:
    """Compress each fold's rows of ``[regressor, torque of every delay]``."""
    pairs = splits(observations, folds, guard)
    between = np.zeros(len(observations.segment), dtype=np.bool_)
    for test, train in pairs:
        between |= ~test & ~train
    triangles: list[Float] = []
    for test, _ in pairs:
        rows, joints = np.nonzero(used & (test & ~between)[:, None])
        both = np.concatenate([observations.regressor[rows, joints], torque[rows, joints]], axis=1)
        triangles.append(triangle_of(both * weight[joints][:, None]))
    return triangles


def _away_from_cuts(observations: Observations, reach: int) -> NDArray[np.bool_]:
    """Rows whose shifted torque is measured, not held from the end of a stretch."""
    row = np.arange(len(observations.segment))
    starts = np.searchsorted(observations.segment, observations.segment, side="left")
    ends = np.searchsorted(observations.segment, observations.segment, side="right")
    return (row - starts >= reach) & (row < ends - reach)
