"""Torque errors of a fit: on the data it was made from, and on data held out.

Held-out data are contiguous folds. The filters smear a moment of each sample into its
neighbours, so training leaves out that moment on both sides of the fold it is tested on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float
from robot_energy.identify.observations import Observations
from robot_energy.identify.quality import folds_in_order

Estimator = Callable[[Observations], Float]


@dataclass(frozen=True)
class TorqueError:
    """Norm of the torque error over the norm of the measured torque.

    Attributes:
        joint: Of each joint, over its moving rows, shape (n,). [-]
        total: Of all joints, over their moving rows. [-]
        with_standstill: Of all joints, over moving and standing rows. [-]
    """

    joint: Float
    total: float
    with_standstill: float


def torque_error(observations: Observations, predicted: Float) -> TorqueError:
    """Compare a prediction with the measured torque.

    Args:
        observations: The rows.
        predicted: Joint torque, shape (N, n). [N m] or [N]

    Returns:
        The errors.
    """
    error = predicted - observations.joint_torque
    used, torque = observations.used, observations.joint_torque
    return TorqueError(
        np.array([_share(error[rows, j], torque[rows, j]) for j, rows in enumerate(used.T)]),
        _share(error[used], torque[used]),
        _share(error[observations.compared], torque[observations.compared]),
    )


def held_out_torque(
    observations: Observations, estimate: Estimator, folds: int, guard: float
) -> TorqueError:
    """Predict every fold from the others.

    Args:
        observations: The rows.
        estimate: Fits the parameters of the columns to the used rows of what it is given.
        folds: Number of contiguous folds.
        guard: Time left out of the training on both sides of the fold. [s]

    Returns:
        The errors of all folds together.
    """
    return torque_error(observations, predict_held_out(observations, estimate, folds, guard))


def predict_held_out(
    observations: Observations, estimate: Estimator, folds: int, guard: float
) -> Float:
    """Return the torque of every fold as the others predict it.

    Args:
        observations: The rows.
        estimate: As of `held_out_torque`.
        folds: Number of contiguous folds.
        guard: Time left out of the training on both sides of the fold. [s]

    Returns:
        Joint torque, shape (N, n). [N m] or [N]
    """
    predicted = np.zeros_like(observations.joint_torque)
    for test, train in splits(observations, folds, guard):
        values = estimate(replace(observations, used=observations.used & train[:, None]))
        predicted[test] = observations.regressor[test] @ values
    return predicted


def splits(
    observations: Observations, folds: int, guard: float
) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Return masks of test and training rows, one pair per fold, each of shape (N,).

    Rows that are compared are shared out evenly; the others go with their neighbours.
    """
    place = np.cumsum(observations.compared) - 1
    count = int(observations.compared.sum())
    fold = folds_in_order(count, folds)[np.clip(place, 0, count - 1)]
    reach = round(guard * observations.rate)
    pairs: list[tuple[NDArray[np.bool_], NDArray[np.bool_]]] = []
    for name in np.unique(fold):
        test = fold == name
        rows = np.flatnonzero(test)
        train = np.ones(len(test), dtype=np.bool_)
        train[max(int(rows[0]) - reach, 0) : int(rows[-1]) + reach + 1] = False
        pairs.append((test, train))
    return pairs


def _share(error: Float, reference: Float) -> float:
    size = float(np.linalg.norm(reference))
    return float(np.linalg.norm(error)) / size if size > 0 else float("nan")
