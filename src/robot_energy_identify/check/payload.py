"""A mass at the last link that the model lacks or has too much, from the recorded torque.

The mass is fitted together with what else may be wrong by a known amount: the mass of every link
and its centre, a common scale of the torque, and friction of any size. So its standard deviation
says how much of it the model's own bodies could explain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_energy.timeline.blocks import Float
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.hypotheses import FLOOR, MIN_SAMPLES, Cause, Trial

SURE = 2.5  # standard deviations by which a mass differs from 0
MIN_MASS = 0.3  # [kg]
MAX_SHARE = 0.15  # of the robot's own moving mass; it carries less, beyond its known payload
LEAST_GAIN = 0.5
MASS_STD = 0.05  # of the mass of a link in a model [-]
CENTRE_STD = 0.003  # of its centre [m]
INERTIA_STD = 0.01  # of the payload about the last joint, of the most it carries [m^2]
SCALE_STD = 0.05  # of a common scale of the torque [-]
CORRELATION_TIME = 0.25  # of what the fit leaves unexplained [s]


@dataclass(frozen=True)
class PayloadFit:
    """A mass at the last link.

    Attributes:
        mass: Beyond the model's payload. [kg]
        std: Standard deviation; NaN if it cannot be fitted. [kg]
        moment: Its mass times its centre, in the frame of the last link, shape (3,). [kg m]
        torque: What it adds to the motors, shape (N, n). [N m]
    """

    mass: float
    std: float
    moment: Float
    torque: Float

    @property
    def least(self) -> float:
        """The least mass that would be found. [kg]"""
        return max(MIN_MASS, SURE * self.std) if np.isfinite(self.std) else float("inf")


def payload_cause(trial: Trial, fit: PayloadFit) -> list[Cause]:
    """Return a mass at the last link as the one cause, if the torque shows it for certain.

    Args:
        trial: A recording.
        fit: Of the mass.
    """
    robot = trial.evidence.robot
    largest = MAX_SHARE * (robot.moving_mass - robot.payload_mass) + robot.payload_mass
    lowest = -robot.payload_mass - 0.2 * largest  # a part of the last link may be missing
    if not (abs(fit.mass) > fit.least and lowest < fit.mass < largest):
        return []

    def correct(evidence: Evidence) -> Evidence:
        return replace(evidence, motor_torque=evidence.motor_torque - fit.torque)

    return [Cause("payload", (), fit.mass, correct, LEAST_GAIN, fit.std, moment=fit.moment)]


def fitted_payload(trial: Trial) -> PayloadFit:
    """Return a fit of a mass at the last link; 0, of unknown deviation, where no joint shows one.

    Args:
        trial: A recording.
    """
    from scipy.optimize import lsq_linear

    evidence, count = trial.evidence, len(trial.evidence.names)
    unknown = PayloadFit(0.0, float("nan"), np.zeros(3), np.zeros_like(trial.rigid))
    inverse = evidence.drivetrain.motor_torque_from_joint(np.eye(count))
    # motor torque per unit of each inertial parameter, shape (N, n, 10 n)
    motor = np.einsum("nji,jk->nki", evidence.robot.torque_regressor(*evidence.motion), inverse)
    parameters = evidence.robot.link_parameters
    own_parts = [slice(10 * k, 10 * k + 10) for k in range(count)]
    links = np.stack([motor[:, :, own] @ parameters[own] for own in own_parts], axis=2)
    centres = np.stack([motor[:, :, 10 * k + axis] for k in range(count) for axis in (1, 2, 3)], 2)
    body = motor[:, :, 10 * (count - 1) :]
    speed = evidence.drivetrain.motor_velocity_from_joint(evidence.velocity)
    shared = 10 + 1 + 1 + 4 * count  # payload, scale, load friction, links and their centres
    width = shared + 3 * count
    prior = np.full(width, np.inf)
    robot = evidence.robot
    prior[4:10] = INERTIA_STD * (MAX_SHARE * robot.moving_mass + robot.payload_mass)
    prior[10] = SCALE_STD
    prior[12 : 12 + count] = MASS_STD
    prior[12 + count : shared] = CENTRE_STD * np.repeat(np.maximum(parameters[::10], 0.1), 3)
    parts: dict[int, tuple[Float, Float]] = {}
    for j in range(count):
        rows = trial.moving[:, j] & np.isfinite(evidence.motor_torque[:, j])
        rows &= np.isfinite(trial.rigid[:, j])
        if int(rows.sum()) < MIN_SAMPLES or not np.isfinite(trial.unexplained[j]):
            continue
        rest = (evidence.motor_torque - trial.rigid)[rows, j]
        block = np.zeros((len(rest), width))
        block[:, :10], block[:, 10] = body[rows, j], trial.rigid[rows, j]
        block[:, 11] = np.abs(trial.rigid[rows, j]) * np.sign(speed[rows, j])
        block[:, 12 : 12 + count], block[:, 12 + count : shared] = links[rows, j], centres[rows, j]
        own = shared + 3 * j
        block[:, own] = np.sign(speed[rows, j])
        block[:, own + 1], block[:, own + 2] = speed[rows, j], 1.0
        parts[j] = block, rest
    if not parts:
        return unknown
    size = {
        j: float(np.var(evidence.motor_torque[np.isfinite(evidence.motor_torque[:, j]), j]))
        for j in parts
    }
    noise = {j: np.sqrt((trial.unexplained[j] + FLOOR) * size[j]) for j in parts}
    independent = max(float(evidence.durations.sum()) / CORRELATION_TIME, 1.0)  # samples
    share = np.sqrt(independent / len(evidence.stamp_ns))
    known = np.flatnonzero(np.isfinite(prior))
    ridge = np.zeros((len(known), width))
    ridge[np.arange(len(known)), known], none = 1.0 / prior[known], np.zeros(len(known))
    low = np.full(width, -np.inf)
    low[11] = 0.0
    low[shared:] = np.tile([0.0, 0.0, -np.inf], count)
    values, std = np.zeros(width), float("nan")
    for _ in range(2):  # the second time with the noise that the first one leaves
        matrix = np.concatenate([*(share / noise[j] * parts[j][0] for j in parts), ridge])
        target = np.concatenate([*(share / noise[j] * parts[j][1] for j in parts), none])
        scale = np.linalg.norm(matrix, axis=0)
        used = scale > 1e-9 * scale.max()
        if not used[0]:
            return unknown
        unit: Float = matrix[:, used] / scale[used]
        values[used] = lsq_linear(unit, target, bounds=(low[used], np.inf)).x / scale[used]
        std = float(np.sqrt(np.linalg.pinv(unit.T @ unit)[0, 0])) / float(scale[0])
        for j, (block, rest) in parts.items():
            noise[j] = np.sqrt(float(np.var(rest - block @ values)) + FLOOR * size[j])
    return PayloadFit(float(values[0]), std, values[1:4], np.asarray(body @ values[:10]))
