"""Causes that make recorded torque differ from the model's, and the recording without each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Annotated
from xml.etree import ElementTree

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model.payload import Payload
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import MAX_FACTOR, Effort
from robot_energy.timeline.blocks import EffortMeaning, Float
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.torque_fit import (
    LARGEST_PAYLOAD,
    PAYLOAD_CENTRE,
    TorqueFit,
    same_motion,
)

FARTHEST = 3.0  # m of a payload from its link
PLACE = (0.0, 0.0, 0.1)  # of a body at a link that carries none [m]
OTHER_UNIT = "percent or thousandths of another unit"
SCALES = {
    "RMS instead of peak current, or the reverse": (2.0**0.5, 2.0**-0.5),
    "half or twice the value": (2.0, 0.5),
    "line instead of phase current, or the reverse": (3.0**0.5, 3.0**-0.5),
    OTHER_UNIT: (10.0, 0.1, 100.0, 0.01, 1000.0, 0.001),
}
RATIOS = (2.0, 0.5, 3.0, 1 / 3, 4.0, 0.25)
MIN_MOVE = 0.05  # rad of range, below which a joint does not show its zero
FAR_ZERO = 0.5  # std of a zero that is searched [rad]
FREE = 4.0  # of cost, that each figure that is free of size must gain
SURE = 2.0  # standard deviations of a payload, below which it is not tried
FAR = 150.0  # of the rough cost, beyond which a cause is not fitted
MOTION = ("position", "velocity", "acceleration")


def more_payload(evidence: Evidence, mass: float) -> tuple[Payload, ...]:
    """Return the payload of the robot with more mass in the same place.

    Args:
        mass: More than in the model. [kg]
    """
    carried = evidence.robot.payload
    if not carried or not carried[-1].mass:
        body = Payload(link=_last_link(evidence), mass=mass, centre_of_mass=PLACE, tag="assumed")
        return (*carried, body)
    last = carried[-1]
    factor = 1.0 + mass / last.mass
    inertia = tuple(factor * value for value in last.inertia)
    return (*carried[:-1], last.model_copy(update={"mass": factor * last.mass, "inertia": inertia}))


def _last_link(evidence: Evidence) -> str:
    root = ElementTree.fromstring(evidence.model.urdf_xml)
    child = root.find(f"joint[@name='{evidence.names[-1]}']/child")
    return "" if child is None else child.get("link", "")


def _carried(
    evidence: Evidence, mass: float, std: float, moment: Float
) -> tuple[Payload, ...] | None:
    """The payload with a body of ``mass`` [kg] and ``moment`` [kg m] added at the last link.

    None if it would be surely less than nothing, or if nothing would change.
    """
    robot, carried, last = evidence.robot, evidence.robot.payload, _last_link(evidence)
    link = carried[-1].link if carried else last
    rest = np.zeros(len(evidence.names))
    at, turn = robot.link_pose(rest, link)
    last_at, last_turn = robot.link_pose(rest, last)
    moments = turn.T @ (last_turn @ moment + (last_at - at) * mass)
    total, inertia = mass, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if carried:
        total, inertia = total + carried[-1].mass, carried[-1].inertia
        moments = moments + carried[-1].mass * np.asarray(carried[-1].centre_of_mass)
    others = tuple(body for body in carried[:-1] if body.link != link)
    total = round(total, 2)
    if carried and -2.0 * std < total <= 0.0:
        return others
    if total <= 0.0 or np.max(np.abs(moments)) > FARTHEST * total:
        return None
    x, y, z = (round(float(value), 3) for value in moments / total)
    body = Payload(link=link, mass=total, centre_of_mass=(x, y, z), inertia=inertia, tag="assumed")
    return (*others, body)


class Cause(Described):
    """One cause and the recording without it."""

    name: Annotated[str, "As in `Finding.cause`."]
    joints: tuple[int, ...]
    value: Annotated[float, "Its size, in the unit of the cause; 1 where it has none."]
    correct: Annotated[Callable[[Evidence], Evidence], "Gives the recording without it."]
    free: Annotated[int, "How many figures of it are free of size."] = 0
    std: Annotated[float, "Standard deviation of ``value``; NaN where it is a choice."] = float(
        "nan"
    )
    choice: Annotated[str, "What it should be instead; empty where ``value`` says it."] = ""
    payload: Annotated[tuple[Payload, ...], "What the robot carries instead."] = ()


def fit_without(cause: Cause, fit: TorqueFit) -> TorqueFit:
    evidence = cause.correct(fit.evidence)
    return TorqueFit(evidence, fit.bodies if same_motion(evidence, fit.evidence) else None)


def worth_a_fit(cause: Cause, fit: TorqueFit) -> bool:
    """Whether a cause is not far less likely than the recording as it is."""
    evidence = cause.correct(fit.evidence)
    # a joint that is exchanged has other columns; without other motion a fit is cheap
    if cause.name == "joint_order" or same_motion(evidence, fit.evidence):
        return True
    return fit.rough_cost(evidence) < fit.cost + FAR


def candidates(fit: TorqueFit) -> list[Cause]:
    evidence = fit.evidence
    count = len(evidence.names)
    known = np.flatnonzero(fit.known).tolist()
    everything, meanings = tuple(range(count)), _meanings(evidence)
    found = [_torque_factor("torque_sign", everything, -1.0)]
    if count > 1:
        found += [_torque_factor("torque_sign", (j,), -1.0) for j in known]
    found += [_joint_sign(j) for j in known]
    for words, factors in SCALES.items():
        if words == OTHER_UNIT and meanings:  # which says it better
            continue
        found += [_torque_factor("torque_scale", everything, factor) for factor in factors]
    found += [_gear_ratio(j, factor) for j in known for factor in RATIOS]
    found += [_effort_meaning(evidence, meaning) for meaning in meanings]
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
            found += _zeros(fit, j)
    return [*found, *_payloads(fit)]


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


def _torque_factor(name: str, joints: tuple[int, ...], factor: float) -> Cause:
    """The recorded torque is ``factor`` times what it should be."""

    def correct(evidence: Evidence) -> Evidence:
        torque = evidence.motor_torque.copy()
        torque[:, list(joints)] /= factor
        return replace(evidence, motor_torque=torque)

    return Cause(name, joints, factor, correct)


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

    return Cause("gear_ratio", (joint,), factor, correct)


def _effort_meaning(evidence: Evidence, meaning: EffortMeaning) -> Cause:
    """The effort means something else than was stated."""
    stated, joints = evidence.effort, range(len(evidence.names))

    def correct(evidence: Evidence) -> Evidence:
        was, now = (
            Effort.from_model(evidence.model, one, evidence.drivetrain).motor_torque(
                np.eye(len(joints))
            )
            for one in (stated, meaning)
        )
        torque = evidence.motor_torque @ np.linalg.inv(was) @ now
        return replace(evidence, motor_torque=torque, effort=meaning)

    factor, _ = evidence.remarks.effort_factors.get(stated, (float("nan"), 0.0))
    return Cause("effort_meaning", tuple(joints), factor, correct, choice=str(meaning))


def _joint_sign(joint: int) -> Cause:
    """Position, velocity and acceleration of a joint have the wrong sign."""

    def correct(evidence: Evidence) -> Evidence:
        changed: dict[str, Float] = {}
        for key in MOTION:
            changed[key] = getattr(evidence, key).copy()
            changed[key][:, joint] *= -1.0
        return replace(evidence, **changed)

    return Cause("joint_sign", (joint,), -1.0, correct)


def _joint_order(first: int, second: int) -> Cause:
    """Two joints have each other's position, velocity and torque."""

    def correct(evidence: Evidence) -> Evidence:
        order = list(range(evidence.position.shape[1]))
        order[first], order[second] = second, first
        unit = _motor_torque_of_effort(evidence)  # each effort was taken for the other joint's
        return replace(
            evidence,
            **{key: getattr(evidence, key)[:, order] for key in (*MOTION, "moving")},
            motor_torque=evidence.motor_torque[:, order] * (unit / unit[order]),
        )

    return Cause("joint_order", (first, second), 1.0, correct)


def _motor_torque_of_effort(evidence: Evidence) -> Float:
    """Motor torque of an effort of 1 of each joint, without coupling, shape (n,)."""
    if evidence.effort is EffortMeaning.JOINT_TORQUE:
        return np.asarray(1.0 / np.diag(evidence.drivetrain.transmission))
    constants = [joint.torque_constant for joint in evidence.model.joints]
    if evidence.effort is not EffortMeaning.MOTOR_CURRENT or None in constants:
        return np.ones(len(constants))
    return np.array([constant.value for constant in constants if constant is not None])


def zero_offset(joints: tuple[int, ...], value: float, std: float = float("nan")) -> Cause:
    """The zero of a joint is off by ``value``; that of a second one by ``-value``.

    Args:
        value: Recorded less true position of the first. [rad]
        std: Of it; NaN where it is a choice. [rad]
    """

    def correct(evidence: Evidence) -> Evidence:
        position = evidence.position.copy()
        for joint, sign in zip(joints, (1.0, -1.0), strict=False):
            position[:, joint] -= sign * value
        return replace(evidence, position=position)

    return Cause("zero_offset", joints, value, correct, 0 if np.isnan(std) else 1, std)


def _zeros(fit: TorqueFit, joint: int) -> Iterator[Cause]:
    """Zero offsets of a joint: the most likely one near 0, and near a quarter of a turn."""
    for start in (0.0, np.pi / 2, -np.pi / 2):
        value, here = start, fit
        if start:
            quarter = zero_offset((joint,), start)
            if not worth_a_fit(quarter, fit):
                continue
            yield quarter
            here = fit_without(quarter, fit)
        for _ in range(4):  # Newton's method: the torque is not linear in the zero
            free = here.freed("zeros", FAR_ZERO, joint)
            place = here.groups["zeros"].start + joint
            step, std = float(free.values[place]), float(free.std[place])
            value += step
            if free.cost > fit.cost or not abs(value) < np.pi:
                break
            if abs(step) < 0.5 * std:
                yield zero_offset((joint,), value, std)
                break
            here = fit_without(zero_offset((joint,), value), fit)


def _payloads(fit: TorqueFit) -> Iterator[Cause]:
    """What the robot may carry more or less than the model says."""
    robot, own = fit.evidence.robot, fit.groups["payload"]
    most = LARGEST_PAYLOAD * (robot.moving_mass - robot.payload_mass) + robot.payload_mass
    free = fit.freed(
        "payload", most * np.repeat([1.0, PAYLOAD_CENTRE, PAYLOAD_CENTRE**2], (1, 3, 6))
    )
    mass, std = float(free.values[own][0]), float(free.std[own][0])
    if not abs(mass) > SURE * std:
        return
    carried = _carried(fit.evidence, mass, std, free.values[own][1:4])
    if carried is None:
        return

    def correct(evidence: Evidence) -> Evidence:
        return replace(evidence, robot=evidence.robot.with_payload(carried))

    yield Cause("payload", (), mass, correct, 2, std, payload=carried)


def scale_words(factor: float) -> str:
    """Return what a factor of the torque usually means.

    Args:
        factor: Recorded over expected torque. [-]
    """
    for words, factors in SCALES.items():
        if any(abs(np.log(abs(factor) / value)) < 0.02 for value in factors):
            return words
    return "another unit or torque constant"
