"""Causes that make recorded torque differ from the model's, tried one after the other.

For every cause the recording is corrected as if it were there, the rigid-body torque is computed
again, and friction of any size but never of the wrong sign is fitted for each joint:

``measured = rigid + rotor + coulomb sign(w) + viscous w + offset``, coulomb, viscous >= 0.

`robot_energy.check.search` names the cause that lowers the unexplained torque most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import EffortMeaning, Float
from robot_energy.check.evidence import Evidence
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort

MIN_SAMPLES = 80  # moving samples of a joint, below which nothing is said of its torque
MIN_MOTION = 6.0  # s of it: 24 independent samples of what a model leaves unexplained
FLOOR = 1e-3  # share of a joint's torque variance that no model explains
OFFSETS = np.array([-np.pi / 2, -0.8, -0.4, -0.2, -0.1, 0.1, 0.2, 0.4, 0.8, np.pi / 2])  # [rad]
SCALES = {
    "RMS instead of peak current, or the reverse": (2.0**0.5, 2.0**-0.5),
    "half or twice the value": (2.0, 0.5),
    "line instead of phase current, or the reverse": (3.0**0.5, 3.0**-0.5),
    "percent or thousandths of another unit": (10.0, 0.1, 100.0, 0.01, 1000.0, 0.001),
}


@dataclass(frozen=True)
class Trial:
    """A corrected recording, and how much torque it leaves unexplained.

    Attributes:
        evidence: The corrected recording.
        unexplained: Share of each joint's torque variance, shape (n,); NaN where unknown.
        rigid: Motor side with rotors, shape (N, n). [N m]
        joint: Of the bodies, joint side, shape (N, n). [N m] or [N]
        moving: Which samples of which joint move, shape (N, n).
    """

    evidence: Evidence
    unexplained: Float
    rigid: Float
    joint: Float
    moving: NDArray[np.bool_]

    def cost(self) -> float:
        """Sum over the joints of the logarithm of the unexplained share."""
        return float(np.nansum(np.log(self.unexplained + FLOOR)))


@dataclass(frozen=True)
class Cause:
    """One cause and the recording without it.

    Attributes:
        name: As in `Finding.cause`.
        joints: Whose.
        value: Its size, in the unit of the cause; 1 where it has none.
        correct: Gives the recording without it.
        least_gain: By which it must lower the cost to be named.
        std: Standard deviation of ``value``; NaN where it is a choice.
        choice: What it should be instead, in words; empty where ``value`` says it.
        moment: Of a payload, mass times centre in the frame of the last link, shape (3,). [kg m]
    """

    name: str
    joints: tuple[int, ...]
    value: float
    correct: Callable[[Evidence], Evidence]
    least_gain: float
    std: float = float("nan")
    choice: str = ""
    moment: Float = field(default_factory=lambda: np.zeros(3))


def attempt(evidence: Evidence, like: Trial | None = None) -> Trial:
    """Return how much torque the model leaves unexplained.

    Args:
        evidence: The recording, thinned.
        like: A trial whose torque of the bodies is used, if the motion is the same.

    Returns:
        The trial.
    """
    same = like is not None and all(
        getattr(evidence, name) is getattr(like.evidence, name)
        for name in ("position", "velocity", "acceleration", "robot")
    )
    if like is not None and same:
        joint, moving = like.joint, like.moving
    else:
        motion = (evidence.position, evidence.velocity, evidence.acceleration)
        joint = evidence.robot.joint_torque(*map(np.ascontiguousarray, motion))
        moving = evidence.moving
    rigid = _rigid_motor_torque(evidence, joint)
    speed = evidence.drivetrain.motor_velocity_from_joint(evidence.velocity)
    usable = moving & np.isfinite(evidence.motor_torque) & np.isfinite(rigid)
    enough = evidence.durations @ usable >= MIN_MOTION
    shares = [
        _unexplained(evidence.motor_torque[:, j], rigid[:, j], speed[:, j], usable[:, j])
        if enough[j]
        else float("nan")
        for j in range(rigid.shape[1])
    ]
    return Trial(evidence, np.array(shares), rigid, joint, moving)


def _rigid_motor_torque(evidence: Evidence, joint: Float) -> Float:
    """Rigid-body and rotor torque, motor side; a sensor behind the gear sees no rotor. [N m]"""
    motor = evidence.drivetrain.motor_torque_from_joint(joint)
    if evidence.effort is EffortMeaning.JOINT_TORQUE:
        return motor
    acceleration = evidence.drivetrain.motor_velocity_from_joint(evidence.acceleration)
    return motor + evidence.drivetrain.rotor_inertia * acceleration


def _unexplained(measured: Float, rigid: Float, speed: Float, rows: NDArray[np.bool_]) -> float:
    """Share of one joint's variance that neither bodies nor friction explain; NaN if unknown."""
    if int(rows.sum()) < MIN_SAMPLES:
        return float("nan")
    target, speed = measured[rows], speed[rows]
    total = float(np.var(target))
    if not total > 0.0:
        return float("nan")
    columns = np.stack([np.sign(speed), speed, target - rigid[rows]])
    columns -= columns.mean(axis=1, keepdims=True)
    product = columns @ columns.T
    (cc, cv, ct), (_, vv, vt), left = product[0], product[1], float(product[2, 2])
    gains = [0.0]  # of coefficients that are not negative: none, one of them, both
    gains += [float(t * t / own) for own, t in ((cc, ct), (vv, vt)) if own > 0.0 and t > 0.0]
    det = cc * vv - cv * cv
    if det > 1e-9 * cc * vv:
        coulomb, viscous = (vv * ct - cv * vt) / det, (cc * vt - cv * ct) / det
        if coulomb >= 0.0 and viscous >= 0.0:
            gains.append(float(coulomb * ct + viscous * vt))
    return max(left - max(gains), 0.0) / (len(target) * total)


def torque_factor(name: str, joints: tuple[int, ...], factor: float, least_gain: float) -> Cause:
    """The recorded torque is ``factor`` times what it should be.

    Args:
        name: Of the cause.
        joints: Indices in model order.
        factor: Recorded over true torque. [-]
        least_gain: In cost, for it to be named. [-]
    """

    def correct(evidence: Evidence) -> Evidence:
        torque = evidence.motor_torque.copy()
        torque[:, list(joints)] /= factor
        return replace(evidence, motor_torque=torque)

    return Cause(name, joints, factor, correct, least_gain)


def gear_ratio(joint: int, factor: float) -> Cause:
    """The gear ratio of a joint in the model is ``factor`` times the true one.

    Args:
        joint: Index in model order.
        factor: Ratio of the model over the true one. [-]
    """

    def correct(evidence: Evidence) -> Evidence:
        transmission = evidence.drivetrain.transmission.copy()
        transmission[joint] /= factor
        torque = evidence.motor_torque
        if evidence.effort is EffortMeaning.JOINT_TORQUE:  # it was divided by the wrong ratio
            torque = torque.copy()
            torque[:, joint] *= factor
        drivetrain = Drivetrain(transmission, evidence.drivetrain.rotor_inertia)
        return replace(evidence, drivetrain=drivetrain, motor_torque=torque)

    return Cause("gear_ratio", (joint,), factor, correct, 0.85 + 0.1 * abs(np.log(factor)))


def effort_meaning(evidence: Evidence, meaning: EffortMeaning) -> Cause:
    """The effort means something else than was stated.

    Args:
        evidence: The recording, whose stated meaning is doubted.
        meaning: What it would be instead.
    """
    stated, joints = evidence.effort, range(len(evidence.names))

    def correct(evidence: Evidence) -> Evidence:
        maps = [
            Effort.from_model(evidence.model, one, evidence.drivetrain).motor_torque(
                np.eye(len(joints))
            )
            for one in (stated, meaning)
        ]
        torque = evidence.motor_torque @ np.linalg.inv(maps[0]) @ maps[1]
        return replace(evidence, motor_torque=torque, effort=meaning)

    factor, _ = evidence.remarks.effort_factors.get(stated, (float("nan"), 0.0))
    return Cause("effort_meaning", tuple(joints), factor, correct, 0.3, choice=str(meaning))


def joint_sign(joint: int) -> Cause:
    """Position, velocity and acceleration of a joint have the wrong sign.

    Args:
        joint: Index in model order.

    Returns:
        The cause.
    """

    def correct(evidence: Evidence) -> Evidence:
        changed: dict[str, Float] = {}
        for key in ("position", "velocity", "acceleration"):
            values = getattr(evidence, key).copy()
            values[:, joint] *= -1.0
            changed[key] = values
        return replace(evidence, **changed)

    return Cause("joint_sign", (joint,), -1.0, correct, 0.4)


def joint_order(first: int, second: int) -> Cause:
    """Two joints have each other's position, velocity and torque.

    Args:
        first: Index in model order.
        second: Index in model order.

    Returns:
        The cause.
    """

    def correct(evidence: Evidence) -> Evidence:
        order = list(range(evidence.position.shape[1]))
        order[first], order[second] = second, first
        unit = _motor_torque_of_effort(evidence)  # each effort was taken for the other joint's
        return replace(
            evidence,
            position=evidence.position[:, order],
            velocity=evidence.velocity[:, order],
            acceleration=evidence.acceleration[:, order],
            motor_torque=evidence.motor_torque[:, order] * (unit / unit[order]),
        )

    return Cause("joint_order", (first, second), 1.0, correct, 1.0)


def _motor_torque_of_effort(evidence: Evidence) -> Float:
    """Motor torque of an effort of 1 of each joint, without coupling, shape (n,)."""
    if evidence.effort is EffortMeaning.JOINT_TORQUE:
        return np.asarray(1.0 / np.diag(evidence.drivetrain.transmission))
    constants = [joint.torque_constant for joint in evidence.model.joints]
    if evidence.effort is not EffortMeaning.MOTOR_CURRENT or None in constants:
        return np.ones(len(constants))
    return np.array([constant.value for constant in constants if constant is not None])


def offset(joint: int, value: float) -> Cause:
    """The zero of a joint is off by ``value``.

    Args:
        joint: Index in model order.
        value: Recorded less true position. [rad]

    Returns:
        The cause.
    """

    def correct(evidence: Evidence) -> Evidence:
        position = evidence.position.copy()
        position[:, joint] -= value
        return replace(evidence, position=position)

    return Cause("zero_offset", (joint,), value, correct, 0.25)


def home_pose(first: int, second: int, value: float) -> Cause:
    """Two neighbours count from a home pose: their zeros are off, in opposite directions.

    Args:
        first: Index in model order.
        second: Index in model order.
        value: Offset of the first; that of the second is its negative. [rad]

    Returns:
        The cause.
    """

    def correct(evidence: Evidence) -> Evidence:
        position = evidence.position.copy()
        position[:, first] -= value
        position[:, second] += value
        return replace(evidence, position=position)

    return Cause("zero_offset", (first, second), value, correct, 1.0)


def best_offset(evidence: Evidence, joint: int) -> Cause | None:
    """The zero offset of a joint that lowers the cost most; None if none does.

    Args:
        evidence: The recording.
        joint: Index in model order.
    """
    from scipy.optimize import minimize_scalar

    step = max(1, len(evidence.stamp_ns) // 500)
    few = _rows(evidence, slice(None, None, step))
    base = attempt(few).cost()

    def cost(value: float) -> float:
        return attempt(offset(joint, float(value)).correct(few)).cost()

    costs = np.array([cost(value) for value in OFFSETS])
    place = int(np.argmin(costs))
    if costs[place] > base - 0.1:
        return None
    low = OFFSETS[place] - 0.5 * abs(OFFSETS[place])
    high = OFFSETS[place] + 0.5 * abs(OFFSETS[place])
    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 2e-3})
    return offset(joint, float(found.x))


def _rows(evidence: Evidence, rows: slice) -> Evidence:
    names = ("stamp_ns", "segment", "position", "velocity", "acceleration", "motor_torque",
             "temperature_degc")  # fmt: skip
    return replace(evidence, **{name: getattr(evidence, name)[rows] for name in names})


def scale_words(factor: float) -> str:
    """Return what a factor of the torque usually means.

    Args:
        factor: Recorded over expected torque. [-]
    """
    for words, factors in SCALES.items():
        if any(abs(np.log(abs(factor) / value)) < 0.02 for value in factors):
            return words
    return "another unit or torque constant"
