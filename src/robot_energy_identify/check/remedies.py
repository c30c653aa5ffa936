"""The line of YAML that mends a mistake, and the file it belongs to.

What the recording was read with is taken into account: a line replaces the entry that is there.
"""

from __future__ import annotations

from collections.abc import Sequence

import yaml

from robot_energy.inputs.joint_states.correction import JointCorrection
from robot_energy.inputs.meter.source import LOAD_NEGATIVE, LOAD_POSITIVE
from robot_energy.inputs.parameters import POSITIONS, RECEIVE
from robot_energy.model.payload import Payload
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.finding import MODEL, PARAMETERS

Remedy = tuple[str, str]  # line of YAML, file


def corrected(
    evidence: Evidence,
    quantities: Sequence[str],
    joints: tuple[int, ...],
    sign: float = 1.0,
    scale: float | Sequence[float] = 1.0,
) -> Remedy:
    """Return the line that corrects quantities of some joints.

    Args:
        sign: 1 or -1. [-]
        scale: Factor, or one for each of ``joints``. [-]
    """
    scales = scale if isinstance(scale, Sequence) else [float(scale)] * len(joints)
    factors: dict[int, float] = dict(zip(joints, scales, strict=True))
    each = range(len(evidence.names))
    other = JointCorrection(
        sign=tuple(sign if joint in joints else 1.0 for joint in each),
        scale=tuple(float(f"{factors.get(joint, 1.0):.6g}") for joint in each),
    )
    return _joint_states(evidence, other, *quantities)


def zero(evidence: Evidence, joints: tuple[int, ...], value: float) -> Remedy:
    """Return the line that takes a zero off.

    Args:
        joints: One joint, or two of which the second is off by ``-value``.
        value: Recorded less true position. [rad]
    """
    found = [0.0] * len(evidence.names)
    for joint, sign in zip(joints, (-1.0, 1.0), strict=False):
        found[joint] = round(sign * value, 4)
    return _joint_states(evidence, JointCorrection(zero=tuple(found)), "position")


def _joint_states(evidence: Evidence, other: JointCorrection, *quantities: str) -> Remedy:
    """The line that adds a correction to those that the recording was read with."""
    lines: list[str] = []
    for one in quantities:
        present: JointCorrection = getattr(evidence.inputs.joint_states, one)
        lines.append(present.followed_by(other).line(one))
    return f"joint_states: {{{', '.join(lines)}}}", PARAMETERS


def no_velocity() -> Remedy:
    """Return the line that takes velocities from the positions."""
    return f"joint_states: {{velocity_source: {POSITIONS}}}", PARAMETERS


def receive() -> Remedy:
    """Return the line that takes times of receipt as stamps."""
    return f"joint_states: {{stamp_source: {RECEIVE}}}", PARAMETERS


def effort_meaning(meaning: str) -> Remedy:
    """Return the line that states the meaning of the effort."""
    return f"joint_states: {{effort_meaning: {meaning}}}", PARAMETERS


def joint_order(evidence: Evidence, first: int, second: int) -> Remedy:
    """Return the line that exchanges two joints."""
    names = list(evidence.inputs.joint_states.names_of(evidence.names))
    names[first], names[second] = names[second], names[first]
    return f"joint_states: {{joint_names: [{', '.join(names)}]}}", PARAMETERS


def gear_ratio(evidence: Evidence, joint: int, factor: float) -> Remedy:
    """Return the line that gives a joint its gear ratio.

    Args:
        factor: Ratio of the model over the true one. [-]
    """
    entry = evidence.model.joints[joint]
    ratio = f"{{value: {entry.gear_ratio.value / factor:.6g}, tag: assumed}}"
    return f"joints: [{{name: {entry.name}, gear_ratio: {ratio}}}]", MODEL


def payload(carried: Sequence[Payload]) -> Remedy:
    """Return the line that gives the robot its payload."""
    entries = [body.model_dump(exclude_none=True, mode="json") for body in carried]
    line = yaml.safe_dump(
        {"payload": entries}, default_flow_style=True, width=1000, sort_keys=False
    )
    return line.strip().removeprefix("{").removesuffix("}"), MODEL


def standstill(names: tuple[str, ...], value: float) -> Remedy:
    """Return the line that gives joints their velocity of rest.

    Args:
        value: Highest velocity that counts as rest. [rad/s] or [m/s]
    """
    entries = ", ".join(f"{{name: {name}, standstill_velocity: {value:g}}}" for name in names)
    return f"joints: [{entries}]", MODEL


def meter(evidence: Evidence, sign: bool = False, scale: float = 1.0, delay: float = 0.0) -> Remedy:
    """Return the line that corrects the meter.

    Args:
        scale: Factor that the readings lack. [-]
        delay: How far the readings are behind the joint states. [s]
    """
    source = evidence.inputs.meter
    entries: list[str] = []
    if sign:
        other = LOAD_POSITIVE if source.sign == LOAD_NEGATIVE else LOAD_NEGATIVE
        entries.append(f"sign: {other}")
    if scale != 1.0:
        entries.append(f"scale: {source.scale * scale:.9g}")
    if delay:
        entries.append(f"stamp_offset: {source.stamp_offset - delay:.2f}")
    return f"meter: {{{', '.join(entries)}}}", PARAMETERS
