"""Torque errors of a fit: on the data it was made from, and on data held out.

Held-out data are contiguous folds. The filters smear a moment of each sample into its
neighbours, so training leaves out that moment on both sides of the fold it is tested on.

Drives filter and transport their torque on another way than positions, so the delay between the
two channels comes from the same folds. Its fits draw on the prior: without it, a short recording
leaves parameters free that take up any delay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.data.observations import Observations
from robot_energy_identify.dynamics.consistent import Prior
from robot_energy_identify.stats import cross_validation
from robot_energy_identify.stats.cross_validation import (
    Mask,
    contiguous_folds,
    relative_error,
    splits,
)
from robot_energy_identify.stats.lag import Delay, best_delay, held_out_errors
from robot_energy_identify.stats.regression import qr_r

STEPS = 10  # delays of the torque on each side of zero
MIN_GAIN = 0.01  # of the held-out error, below which a delay is not worth believing


class TorqueError(Described):
    """Norm of the torque error over the norm of the measured torque."""

    joint: Annotated[Float, "Of each joint, over its moving rows, shape (n,). [-]"]
    total: Annotated[float, "Of all joints, over their moving rows. [-]"]
    with_standstill: Annotated[float, "Of all joints, over moving and standing rows. [-]"]


def torque_error(observations: Observations, predicted: Float) -> TorqueError:
    """Return the errors of a prediction of the measured torque.

    Args:
        predicted: Joint torque, shape (N, n). [N m] or [N]
    """
    error = predicted - observations.joint_torque
    used, torque = observations.used, observations.joint_torque
    return TorqueError(
        np.array(
            [relative_error(error[rows, j], torque[rows, j]) for j, rows in enumerate(used.T)]
        ),
        relative_error(error[used], torque[used]),
        relative_error(error[observations.compared], torque[observations.compared]),
    )


def predict_held_out(
    observations: Observations, estimate: Callable[[Observations], Float], guard: float
) -> Float:
    """Return the joint torque of every fold as the others predict it, (N, n). [N m] or [N]

    Args:
        estimate: Fits the parameters of the columns to the used rows of what it is given.
        guard: Time left out of the training on both sides of the fold. [s]
    """

    def predict(train: Mask, test: Mask) -> Float:
        values = estimate(replace(observations, used=observations.used & train[:, None]))
        return observations.regressor[test] @ values

    reach = round(guard * observations.rate)
    return cross_validation.predict_held_out(folds_of(observations), predict, reach)


def folds_of(observations: Observations) -> Int:
    """Return the fold of each row, shape (N,).

    Rows that are compared are shared out evenly; the others go with their neighbours.
    """
    place = np.cumsum(observations.compared) - 1
    count = int(observations.compared.sum())
    return contiguous_folds(count)[np.clip(place, 0, count - 1)]


def estimate_delay(
    observations: Observations,
    weight: Float,
    prior: Prior,
    span: float,
    guard: float,
) -> Delay:
    """Return the delay of the torque, by cross-validation.

    Args:
        weight: Of each joint, shape (n,), one over the noise of an independent row. [1/(N m)]
        span: Delays from minus to plus this are tried. [s]
        guard: Time left out next to each fold. [s]
    """
    delays = np.linspace(-span, span, 2 * STEPS + 1)
    torque = np.stack([observations.advanced(float(d)).joint_torque for d in delays], axis=2)
    reach = int(np.ceil(span * observations.rate))
    row, segment = np.arange(len(observations.segment)), observations.segment
    starts, ends = (np.searchsorted(segment, segment, side=side) for side in ("left", "right"))
    # rows whose shifted torque is measured, not held from the end of a stretch
    measured = (row - starts >= reach) & (row < ends - reach)
    used = observations.used & measured[:, None]
    pairs = list(splits(folds_of(observations), round(guard * observations.rate)))
    kept = np.logical_and.reduce([test | train for train, test in pairs])
    triangles: list[Float] = []
    for _, test in pairs:
        rows, joints = np.nonzero(used & (test & kept)[:, None])
        both = np.concatenate([observations.regressor[rows, joints], torque[rows, joints]], axis=1)
        both *= weight[joints][:, None]
        triangles.append(qr_r(both))
    # rows [parameter, value of every delay] / std of what is known, shape (K, P + D)
    known = np.isfinite(prior.std)
    rows = np.diag(np.where(known, 1.0 / np.where(known, prior.std, 1.0), 0.0))
    known = np.column_stack([rows, *[rows @ prior.values] * len(delays)])[known]
    error = held_out_errors(triangles, observations.regressor.shape[2], known)
    return best_delay(delays, error, error[:, STEPS], span, MIN_GAIN)
