"""Mechanical work of the motors: what is left of a torque error once it is energy.

``P_i = t_i w_i`` of every motor (paper A, eq. 1; paper B, eq. 4), integrated over the rows. Net
work is what friction and payload keep; positive work is what the motors gave, braking left
out. An energy forgives torque errors that cancel, so it is never shown without them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.identify.data.observations import Observations


@dataclass(frozen=True)
class Work:
    """Work of every motor over the rows that are compared.

    Attributes:
        net: Integral of the power, shape (n,). [J]
        positive: Integral of the power where it is positive, shape (n,). [J]
    """

    net: Float
    positive: Float


def motor_work(observations: Observations, joint_torque: Float, transmission: Float) -> Work:
    """Integrate the power of the motors over moving and standing rows.

    Args:
        observations: The rows with their motion.
        joint_torque: Measured or predicted, shape (N, n). [N m] or [N]
        transmission: Motor turns per joint turn, shape (n, n). [-]

    Returns:
        The work. Rows are low-passed: what vibrates faster is in no side of a comparison.
    """
    motor_torque = np.linalg.solve(transmission.T, joint_torque.T).T
    motor_velocity = observations.motion.joint_velocity @ transmission.T
    power = (motor_torque * motor_velocity)[observations.compared]
    step = 1.0 / observations.rate
    return Work(power.sum(axis=0) * step, np.maximum(power, 0.0).sum(axis=0) * step)


def share_off(predicted: float, measured: float) -> float:
    """Return by which share a prediction is off, signed; NaN where nothing was measured.

    Args:
        predicted: An energy. [J]
        measured: The same, as measured. [J]
    """
    return (predicted - measured) / abs(measured) if measured != 0.0 else float("nan")
