"""How well a motion identifies the base parameters of a robot.

The criterion is one of the observation matrix of the base parameters, links and everything else
that `identify dynamics` fits. Rows are divided by the joint's RMS torque and columns by their
RMS, both over states drawn evenly within the limits. These scales belong to the robot and
not to a motion, so figures of different motions compare, and a small motion is worse than
a large one. (Columns scaled to unit length by the motion itself would hide its size.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_energy.blocks import Float
from robot_energy.identify.dynamics.base_parameters import not_excited
from robot_energy.identify.dynamics.columns import ParameterColumn
from robot_energy.identify.dynamics.torque_model import TorqueModel
from robot_energy.identify.excitation.limits import ExcitationLimits, slopes
from robot_energy.model import RobotModel
from robot_energy.motion import Trajectory

Criterion = Literal["condition", "determinant"]

STATES = 400  # drawn for the scales


@dataclass(frozen=True)
class ExcitationScore:
    """How well a motion tells the base parameters.

    Attributes:
        condition: Condition number of the scaled observation matrix.
        log_determinant: Of the scaled information matrix per row, over the number of base
            parameters: one more means deviations smaller by ``exp(0.5)`` on average.
        not_excited: Base parameters that the motion does not tell.
    """

    condition: float
    log_determinant: float
    not_excited: tuple[str, ...]


class ExcitationCriterion:
    """Scaled observation matrix of the base parameters of one robot.

    Args:
        model: The robot.
        limits: Within which it moves.
        columns: What is fitted in addition to the links.
    """

    def __init__(
        self, model: RobotModel, limits: ExcitationLimits, columns: tuple[ParameterColumn, ...]
    ) -> None:
        self.limits = limits
        self._torque_model = TorqueModel.from_model(model, columns)
        self.base = self._torque_model.structure()
        random = np.random.default_rng(0)
        shape = (STATES, limits.robot.n_joints)
        draw = [random.uniform(-1.0, 1.0, shape) for _ in range(3)]
        states = Trajectory(
            limits.middle + limits.reach * draw[0],
            limits.velocity * draw[1],
            limits.acceleration * draw[2],
        )
        torque = np.sqrt((limits.joint_torque(states) ** 2).mean(axis=0))
        rows = self._torque_model.regressor(states)[:, :, self.base.independent] / torque[:, None]
        size = np.sqrt((rows**2).mean(axis=(0, 1)))
        self._scale = 1.0 / (torque[:, None] * size)

    def rows(self, motion: Trajectory) -> Float:
        """Return the scaled observation matrix over the root of its number of rows, (N, n, B).

        Args:
            motion: Samples of it, evenly in time.
        """
        rows = self._torque_model.regressor(motion)[:, :, self.base.independent] * self._scale
        return rows / np.sqrt(rows.shape[0] * rows.shape[1])

    def quality(self, motion: Trajectory) -> ExcitationScore:
        """Return how well a motion tells the base parameters.

        Argument as in `ExcitationCriterion.rows`.
        """
        rows = self.rows(motion).reshape(-1, len(self.base))
        size = np.linalg.svd(rows, compute_uv=False)
        with np.errstate(divide="ignore"):
            condition = float(size[0] / size[-1]) if len(rows) >= rows.shape[1] else np.inf
            determinant = float(2.0 * np.log(size).mean())
        return ExcitationScore(condition, determinant, not_excited(rows, self.base.labels))

    def cost(self, motion: Trajectory, criterion: Criterion) -> float:
        """Return the logarithm of the condition number, or less that of the determinant.

        Args:
            motion: Samples of it, evenly in time.
            criterion: Which of both.
        """
        rows = self.rows(motion)
        size = np.linalg.svd(rows.reshape(-1, rows.shape[2]), compute_uv=False)
        size = np.maximum(size, np.finfo(np.float64).tiny)
        if criterion == "condition":
            return float(np.log(size[0] / size[-1]))
        return float(-2.0 * np.log(size).mean())

    def slopes(self, motion: Trajectory, criterion: Criterion) -> Float:
        """Return cost per position, velocity and acceleration of every sample, shape (3, N, n).

        Arguments as in `ExcitationCriterion.cost`.
        """
        rows = self.rows(motion)
        flat = rows.reshape(-1, rows.shape[2])
        left, size, right = np.linalg.svd(flat, full_matrices=False)
        size = np.maximum(size, np.finfo(np.float64).tiny)
        if criterion == "condition":
            slope = np.outer(left[:, 0], right[0]) / size[0]
            slope -= np.outer(left[:, -1], right[-1]) / size[-1]
        else:
            slope = (left / size) @ right * (-2.0 / len(size))
        slope = slope.reshape(rows.shape)
        found = slopes(
            motion, self.limits, lambda moved: (slope * (self.rows(moved) - rows)).sum(axis=(1, 2))
        )
        return found.swapaxes(1, 2)
