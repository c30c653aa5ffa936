"""Causes that make recorded torque differ from the model's, tried one after the other.

For every cause the recording is corrected as if it were there, the rigid-body torque is computed
again, and friction of any size but never of the wrong sign is fitted for each joint:

``measured = rigid + rotor + coulomb sign(w) + viscous w + offset``, coulomb, viscous >= 0.

`robot_energy_identify.check.torque` names the cause that lowers the unexplained torque most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort
from robot_energy.timeline.blocks import EffortMeaning, Float
from robot_energy_identify.check.evidence import Evidence

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
RATIOS = (2.0, 0.5, 3.0, 1 / 3, 4.0, 0.25)
MIN_MOVE = 0.05  # rad of range, below which a joint does not show its zero
MAX_FACTOR = 3.0  # of measured over body torque, for a meaning of the effort that fits
MOTION = ("position", "velocity", "acceleration")


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
    """
    if like is not None and all(
        getattr(evidence, name) is getattr(like.evidence, name) for name in (*MOTION, "robot")
    ):
        joint, moving = like.joint, like.moving
    else:
        joint = evidence.robot.joint_torque(*evidence.motion)
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


def candidates(trial: Trial) -> list[Cause]:
    """Return the causes worth a trial with a recording.

    Args:
        trial: The recording as it is now.
    """
    evidence = trial.evidence
    count = len(evidence.names)
    known = [j for j in range(count) if np.isfinite(trial.unexplained[j])]
    everything = tuple(range(count))
    found = [_torque_factor("torque_sign", everything, -1.0, 0.3)]
    if count > 1:
        found += [_torque_factor("torque_sign", (j,), -1.0, 0.3) for j in known]
    found += [_joint_sign(j) for j in known]
    for factors in SCALES.values():
        least = 0.15 * len(known)
        found += [_torque_factor("torque_scale", everything, factor, least) for factor in factors]
    found += [_gear_ratio(j, factor) for j in known for factor in RATIOS]
    found += [_effort_meaning(evidence, meaning) for meaning in _meanings(evidence)]
    found += [_joint_order(i, j) for i in known for j in known if i < j]
    prismatic = evidence.robot.limits.prismatic
    found += [  # neighbours that count from a home pose
        zero_offset((j, j + 1), value)
        for j in everything[:-1]
        for value in (-np.pi / 2, np.pi / 2)
        if not prismatic[j] and not prismatic[j + 1]
    ]
    for j in everything:
        if not prismatic[j] and np.ptp(evidence.position[:, j]) > MIN_MOVE:
            found += _best_offset(evidence, j)
    return found


def _meanings(evidence: Evidence) -> list[EffortMeaning]:
    """Other meanings of the effort that give it the size of the body torque, which it lacks."""
    factors = evidence.remarks.effort_factors
    stated, _ = factors.get(evidence.effort, (1.0, 1.0))
    if 1 / MAX_FACTOR < abs(stated) < MAX_FACTOR:
        return []
    return [
        meaning
        for meaning, (factor, _) in factors.items()
        if meaning is not evidence.effort and 1 / MAX_FACTOR < abs(factor) < MAX_FACTOR
    ]


def _torque_factor(name: str, joints: tuple[int, ...], factor: float, least_gain: float) -> Cause:
    """The recorded torque is ``factor`` times what it should be."""

    def correct(evidence: Evidence) -> Evidence:
        torque = evidence.motor_torque.copy()
        torque[:, list(joints)] /= factor
        return replace(evidence, motor_torque=torque)

    return Cause(name, joints, factor, correct, least_gain)


def _gear_ratio(joint: int, factor: float) -> Cause:
    """The gear ratio of a joint in the model is ``factor`` times the true one."""

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


def _effort_meaning(evidence: Evidence, meaning: EffortMeaning) -> Cause:
    """The effort means something else than was stated."""
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


def _joint_sign(joint: int) -> Cause:
    """Position, velocity and acceleration of a joint have the wrong sign."""

    def correct(evidence: Evidence) -> Evidence:
        changed: dict[str, Float] = {}
        for key in MOTION:
            changed[key] = getattr(evidence, key).copy()
            changed[key][:, joint] *= -1.0
        return replace(evidence, **changed)

    return Cause("joint_sign", (joint,), -1.0, correct, 0.4)


def _joint_order(first: int, second: int) -> Cause:
    """Two joints have each other's position, velocity and torque."""

    def correct(evidence: Evidence) -> Evidence:
        order = list(range(evidence.position.shape[1]))
        order[first], order[second] = second, first
        unit = _motor_torque_of_effort(evidence)  # each effort was taken for the other joint's
        return replace(
            evidence,
            **{key: getattr(evidence, key)[:, order] for key in MOTION},
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


def zero_offset(joints: tuple[int, ...], value: float) -> Cause:
    """The zero of a joint is off by ``value``; that of a second one by ``-value``.

    Args:
        joints: Indices in model order, one or two.
        value: Recorded less true position of the first. [rad]
    """

    def correct(evidence: Evidence) -> Evidence:
        position = evidence.position.copy()
        for joint, sign in zip(joints, (1.0, -1.0), strict=False):
            position[:, joint] -= sign * value
        return replace(evidence, position=position)

    return Cause("zero_offset", joints, value, correct, 0.25 if len(joints) == 1 else 1.0)


def _best_offset(evidence: Evidence, joint: int) -> list[Cause]:
    """The zero offset of a joint that lowers the cost most; empty if none does."""
    from scipy.optimize import minimize_scalar

    few = evidence.rows(slice(None, None, max(1, len(evidence.stamp_ns) // 500)))
    base = attempt(few).cost()

    def cost(value: float) -> float:
        return attempt(zero_offset((joint,), float(value)).correct(few)).cost()

    costs = np.array([cost(value) for value in OFFSETS])
    place = int(np.argmin(costs))
    if costs[place] > base - 0.1:
        return []
    low = OFFSETS[place] - 0.5 * abs(OFFSETS[place])
    high = OFFSETS[place] + 0.5 * abs(OFFSETS[place])
    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 2e-3})
    return [zero_offset((joint,), float(found.x))]


def scale_words(factor: float) -> str:
    """Return what a factor of the torque usually means.

    Args:
        factor: Recorded over expected torque. [-]
    """
    for words, factors in SCALES.items():
        if any(abs(np.log(abs(factor) / value)) < 0.02 for value in factors):
            return words
    return "another unit or torque constant"
