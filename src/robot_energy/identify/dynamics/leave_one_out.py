"""Whole recordings held out: each one predicted from the others, and from itself.

Blocks of one recording share its poses, its speeds and the warmth of its grease. Another
recording shares none of them, so this is the stricter test, and the one that tells how good
a model file is on the next motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robot_energy.blocks import Float
from robot_energy.errors import NotIdentifiableError
from robot_energy.identify.data.observations import Observations
from robot_energy.identify.data.signals import Channels
from robot_energy.identify.dynamics.dynamics import Dynamics, DynamicsSettings, identify_dynamics
from robot_energy.identify.dynamics.validation import TorqueError, torque_error
from robot_energy.identify.dynamics.work import Work, motor_work
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain


@dataclass(frozen=True)
class HoldOutResult:
    """A prediction of one recording beside what was measured in it.

    Attributes:
        recording: The one that was predicted.
        trained_on: The recordings of the fit; the same one: its own other blocks.
        torque: Error of the model file.
        predicted: Work as the model file says it.
        measured: Work as measured.
        least_squares: Torque error of the fit without bodies that can exist.
    """

    recording: str
    trained_on: tuple[str, ...]
    torque: TorqueError
    predicted: Work
    measured: Work
    least_squares: TorqueError


@dataclass(frozen=True)
class LeaveOneOut:
    """Recordings of one robot, each held out once.

    Attributes:
        judgements: From the others first, then each from its own blocks.
        refused: Recordings that could not be predicted so, with the reason, one sentence each.
    """

    judgements: tuple[HoldOutResult, ...]
    refused: tuple[str, ...]


def across_recordings(
    recordings: Mapping[str, Sequence[Channels]],
    model: RobotModel,
    settings: DynamicsSettings | None = None,
) -> LeaveOneOut:
    """Hold every recording out once.

    Args:
        recordings: Stretches of each recording by its name, two or more.
        model: As of `identify_dynamics`.
        settings: As of `identify_dynamics`.

    Returns:
        The judgements.
    """
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
            plain = fit.held_out() if own else _least_squares(fit, rows)
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


def _least_squares(fit: Dynamics, rows: Observations) -> TorqueError:
    part = rows.with_columns(fit.base.independent)
    predicted: Float = part.regressor @ fit.fit.values
    return torque_error(part, predicted)
