"""Torque errors of a fit: on the data it was made from, and on data held out.

Held-out data are contiguous folds. The filters smear a moment of each sample into its
neighbours, so training leaves out that moment on both sides of the fold it is tested on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.blocks import Float, Int
from robot_energy.identify.data.observations import Observations
from robot_energy.identify.stats import cross_validation
from robot_energy.identify.stats.cross_validation import Mask, contiguous_folds, relative_error


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
    """Return the errors of a prediction of the measured torque.

    Args:
        observations: The rows.
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
        observations: The rows.
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

    Args:
        observations: The rows.
    """
    place = np.cumsum(observations.compared) - 1
    count = int(observations.compared.sum())
    return contiguous_folds(count)[np.clip(place, 0, count - 1)]
