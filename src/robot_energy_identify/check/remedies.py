"""The line of YAML that mends a mistake, and the file it belongs to.

What the recording was read with is taken into account: a line replaces the entry that is there.
"""

from __future__ import annotations

from collections.abc import Sequence

import yaml

from robot_energy.inputs.joint_states.correction import JointCorrection
from robot_energy.inputs.meter.source import LOAD_NEGATIVE, LOAD_POSITIVE
from robot_energy.inputs.parameters import POSITIONS, RECEIVE
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.finding import MODEL, PARAMETERS
from robot_energy_identify.check.possible_causes import Cause

Remedy = tuple[str, str]  # line of YAML, file
NO_VELOCITY: Remedy = f"joint_states: {{velocity_source: {POSITIONS}}}", PARAMETERS
RECEIPT: Remedy = f"joint_states: {{stamp_source: {RECEIVE}}}", PARAMETERS


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


def of_cause(evidence: Evidence, cause: Cause) -> Remedy:
    joints, value, source = cause.joints, cause.value, evidence.inputs.joint_states
    match cause.name:
        case "torque_sign":
            return corrected(evidence, ("effort",), joints, sign=-1.0)
        case "joint_sign":
            return corrected(evidence, ("position", "velocity"), joints, sign=-1.0)
        case "torque_scale":
            return corrected(evidence, ("effort",), joints, scale=1.0 / value)
        case "effort_meaning":
            return effort_meaning(cause.choice)
        case "zero_offset":
            zero = [0.0] * len(evidence.names)
            for joint, sign in zip(joints, (-1.0, 1.0), strict=False):
                zero[joint] = round(sign * value, 4)
            return _joint_states(evidence, JointCorrection(zero=tuple(zero)), "position")
        case "joint_order":
            names, (first, second) = list(source.names_of(evidence.names)), joints
            names[first], names[second] = names[second], names[first]
            return f"joint_states: {{joint_names: [{', '.join(names)}]}}", PARAMETERS
        case "gear_ratio":
            entry = evidence.model.joints[joints[0]]
            ratio = f"{{value: {entry.gear_ratio.value / value:.6g}, tag: assumed}}"
            return f"joints: [{{name: {entry.name}, gear_ratio: {ratio}}}]", MODEL
        case _:
            bodies = [one.model_dump(exclude_none=True, mode="json") for one in cause.payload]
            line = yaml.safe_dump(
                {"payload": bodies}, default_flow_style=True, width=1000, sort_keys=False
            )
            return line.strip().removeprefix("{").removesuffix("}"), MODEL


def _joint_states(evidence: Evidence, other: JointCorrection, *quantities: str) -> Remedy:
    """The line that adds a correction to those that the recording was read with."""
    lines: list[str] = []
    for one in quantities:
        present: JointCorrection = getattr(evidence.inputs.joint_states, one)
        lines.append(present.followed_by(other).line(one))
    return f"joint_states: {{{', '.join(lines)}}}", PARAMETERS


def effort_meaning(meaning: str) -> Remedy:
    return f"joint_states: {{effort_meaning: {meaning}}}", PARAMETERS


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
