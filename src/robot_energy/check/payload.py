"""A mass at the last link that the model lacks or has too much, from the recorded torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_energy.blocks import Float
from robot_energy.check.evidence import Evidence
from robot_energy.check.hypotheses import FLOOR, MIN_SAMPLES, Cause, Trial

SURE = 4.0  # standard deviations by which a mass differs from 0
MIN_MASS = 0.3  # [kg]
MAX_SHARE = 0.15  # of the robot's own moving mass; it carries less, beyond its known payload


def payload_cause(trial: Trial) -> list[Cause]:
    """Return a mass at the last link as a cause, if the torque shows one for certain.

    It is fitted twice, with and without a common scale of the torque. The two differ where scale
    and mass explain the same torque: the size named is their mean.

    Args:
        trial: A recording.

    Returns:
        One cause, or none. [kg]
    """
    free, std, torque = _fitted_payload(trial, True)
    robot = trial.evidence.robot
    largest = MAX_SHARE * (robot.moving_mass - robot.payload_mass) + robot.payload_mass
    least = -robot.payload_mass - 0.2 * largest  # a part of the last link may be missing
    if not (abs(free) > SURE * std and abs(free) > MIN_MASS and least < free < largest):
        return []
    fixed, _, _ = _fitted_payload(trial, False)

    def correct(evidence: Evidence) -> Evidence:
        return replace(evidence, motor_torque=evidence.motor_torque - torque)

    return [Cause("payload", (), 0.5 * (free + fixed), correct, 0.9, abs(free - fixed) / 2)]


def _fitted_payload(trial: Trial, with_scale: bool) -> tuple[float, float, Float]:
    """Mass [kg], its standard deviation of the fit [kg], and its motor torque [N m]."""
    from scipy.optimize import lsq_linear

    evidence = trial.evidence
    count = len(evidence.names)
    last = 10 * (count - 1)
    regressor = evidence.robot.torque_regressor(
        *(np.ascontiguousarray(values) for values in
          (evidence.position, evidence.velocity, evidence.acceleration))
    )[:, :, last : last + 4]  # fmt: skip
    motor = np.stack(
        [evidence.drivetrain.motor_torque_from_joint(regressor[:, :, k]) for k in range(4)], axis=2
    )
    speed = evidence.drivetrain.motor_velocity_from_joint(evidence.velocity)
    moving = evidence.moving
    # Two columns for all joints take up what is no payload: a common scale of the torque, and
    # friction that grows with the load.
    shared = 6
    width = shared + 3 * count
    blocks: list[Float] = []
    targets: list[Float] = []
    for j in range(count):
        rows = moving[:, j] & np.isfinite(evidence.motor_torque[:, j])
        if int(rows.sum()) < MIN_SAMPLES or not np.isfinite(trial.unexplained[j]):
            continue
        rest = (evidence.motor_torque - trial.rigid)[rows, j]
        weight = 1.0 / max(
            float(np.sqrt((trial.unexplained[j] + FLOOR) * np.var(evidence.motor_torque[rows, j]))),
            1e-12,
        )
        block = np.zeros((len(rest), width))
        block[:, :4] = motor[rows, j]
        if with_scale:
            block[:, 4] = trial.rigid[rows, j]
        block[:, 5] = np.abs(trial.rigid[rows, j]) * np.sign(speed[rows, j])
        first = shared + 3 * j
        block[:, first : first + 3] = np.column_stack(
            [np.sign(speed[rows, j]), speed[rows, j], np.ones(len(rest))]
        )
        blocks.append(weight * block)
        targets.append(weight * rest)
    if not blocks:
        return 0.0, float("nan"), np.zeros_like(trial.rigid)
    matrix, target = np.concatenate(blocks), np.concatenate(targets)
    scale = np.linalg.norm(matrix, axis=0)
    used = scale > 1e-9 * scale.max()
    low = np.full(width, -np.inf)
    low[5] = 0.0
    low[shared:] = np.tile([0.0, 0.0, -np.inf], count)
    unit: Float = matrix[:, used] / scale[used]
    solved = lsq_linear(unit, target, bounds=(low[used], np.inf))
    values = np.zeros(width)
    values[used] = solved.x / scale[used]
    covariance: Float = np.linalg.pinv(unit.T @ unit)
    mass_std = float("nan")
    if used[0]:
        variance = 2.0 * solved.cost / max(len(target) - width, 1)
        mass_std = float(np.sqrt(covariance[0, 0] * variance)) / float(scale[0])
    return float(values[0]), mass_std, np.asarray(np.einsum("njk,k->nj", motor, values[:4]))
