"""Whole recordings held out: each one predicted from the others, and from itself.

Blocks of one recording share its poses, its speeds and the warmth of its grease. Another
recording shares none of them, so this is the stricter test, and the one that shows how good
a model file is on the next motion.

Next to the torque stands the work of the motors, ``P_i = t_i w_i`` of every motor (paper A, eq. 1;
paper B, eq. 4), integrated over the rows: net work is what friction and payload keep, positive
work what the motors gave, braking left out. An energy forgives torque errors that cancel, so it
is never shown without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.blocks import Float
from robot_energy_identify.data.observations import Channels, Observations
from robot_energy_identify.dynamics.dynamics import Dynamics, DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.validation import (
    HoldOutResult,
    LeaveOneOut,
    Work,
    torque_error,
)


def across_recordings(
    recordings: Mapping[str, Sequence[Channels]],
    model: RobotModel,
    settings: DynamicsSettings | None = None,
) -> LeaveOneOut:
    """Return predictions of each of several recordings, held out once, and what was measured."""
    transmission = Drivetrain.from_model(model).transmission
    fits: dict[tuple[str, ...], Dynamics] = {}
    judgements: list[HoldOutResult] = []
    refused: list[str] = []

    def fitted(names: tuple[str, ...]) -> Dynamics:
        if names not in fits:
            stretches = [part for name in names for part in recordings[name]]
            fits[names] = identify_dynamics(stretches, model, settings)
        return fits[names]

    splits = [(name, tuple(other for other in recordings if other != name)) for name in recordings]
    splits += [(name, (name,)) for name in recordings]
    for name, trained_on in splits:
        try:
            fit = fitted(trained_on)
            own = trained_on == (name,)
            rows = fit.observations if own else fit.rows_of(recordings[name])
            predicted = fit.predict_held_out() if own else fit.predict(rows)
            part = rows.with_columns(fit.base.independent)
            plain = fit.held_out() if own else torque_error(part, part.regressor @ fit.fit.values)
        except NotIdentifiableError as error:
            refused.append(f"{name} from {' and '.join(trained_on)}: {error.found}")
            continue
        judgements.append(
            HoldOutResult(
                name,
                trained_on,
                torque_error(rows, predicted),
                motor_work(rows, predicted, transmission),
                motor_work(rows, rows.joint_torque, transmission),
                plain,
            )
        )
    return LeaveOneOut(tuple(judgements), tuple(refused))


def motor_work(observations: Observations, joint_torque: Float, transmission: Float) -> Work:
    """Return the work of the motors over moving and standing rows, low-passed on both sides.

    Args:
        joint_torque: Measured or predicted, shape (N, n). [N m] or [N]
        transmission: Motor turns per joint turn, shape (n, n). [-]
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
