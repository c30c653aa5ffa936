"""Do positions and velocities fit each other, the limits of the URDF and the noise at rest?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robot_energy.inputs.joint_states.plausibility import ALWAYS_ZERO, FAR
from robot_energy.inputs.joint_states.publisher_conflicts import shortest
from robot_energy.replay.bag_replay import LONGER_WINDOW
from robot_energy.timeline.blocks import NANOSECOND, Float
from robot_energy_identify.check import remedies
from robot_energy_identify.check.evidence import Evidence, velocity_noise
from robot_energy_identify.check.field_lag import field_lag
from robot_energy_identify.check.finding import ERROR, MODEL, WARNING, Finding, unjudged

MIN_SAMPLES = 50
MIN_FIT = 0.5  # correlation of velocity with the change of position, below which they differ
MAX_SCALE_ERROR = 0.15
DEGREES = 180.0 / np.pi
STAMPS_UNEVEN = "stamps_uneven"
MIN_BEYOND = 0.02  # share of samples beyond a limit

MIN_REST = 2.0  # s of a joint, below which its noise may be motion
MIN_TRAVEL = 0.05  # rad or m that a joint moves, beyond the noise of one at rest
MIN_STEPS = 40  # of held velocities while the robot moves
MIN_HELD = 0.9  # share of the steps that come after a velocity was held
MIN_SHARE = 0.05  # of its range that a joint moves
LATE = 0.025  # s: some drivers filter velocities, and those of sound recordings are 0.01 s late
APART = 0.2  # of the longest way in a second, that velocities may miss it: sound ones miss 0.03
MIN_APART = 3  # seconds in which they do
MIN_SAMPLED = 10  # samples in a second
NEAR = 0.3  # of the logarithm of a factor


class _Unit(NamedTuple):
    """What positions of a joint may be stated in instead of SI."""

    name: str
    factor: float  # of the value in SI
    margin: float  # beyond a limit of the URDF, in SI


UNITS = {False: _Unit("degrees", DEGREES, 0.2), True: _Unit("millimetres", 1e3, 0.05)}
"""By whether a joint is prismatic."""


def check_motion(evidence: Evidence) -> tuple[list[Finding], str]:
    """Return findings on velocities, positions and limits, and why there cannot be any."""
    if len(evidence.stamp_ns) < MIN_SAMPLES:
        return [], f"{len(evidence.stamp_ns)} samples with a full derivative window"
    joints = range(len(evidence.names))
    foreign = [_in_other_unit(evidence, joint) for joint in joints]
    findings = [
        finding
        for joint in joints
        for finding in (
            _units(evidence, joint, foreign) if foreign[joint] else _limits(evidence, joint)
        )
    ]
    held = [*_held(evidence)]  # which are late as well
    slopes = [] if held or any(foreign) else [*_late(evidence)]
    if not slopes:
        slopes = [one for joint in joints if not foreign[joint] for one in _slope(evidence, joint)]
    findings += _together(evidence, slopes)
    if not any(finding.severity == ERROR for finding in findings):
        # joints that would need more torque than the robot has
        findings += [
            Finding("torque_limit", WARNING, (name,), sentence, remedy=LONGER_WINDOW)
            for name, sentence in evidence.beyond_torque.items()
        ]
    return [*findings, *held, *_rest(evidence), *_degrees_unseen(evidence)], ""


def _held(evidence: Evidence) -> Iterator[Finding]:
    """Velocities of all joints that stay the same together and then step, while positions move."""
    if evidence.derived or evidence.remarks.repeating:
        return
    moved = (np.diff(evidence.position, axis=0) != 0).any(axis=1)
    moved &= np.diff(evidence.segment) == 0
    stepped = (np.diff(evidence.velocity, axis=0) != 0).any(axis=1)
    steps = np.flatnonzero(moved & stepped)
    held = np.diff(steps)[moved[steps[1:] - 1]] if len(steps) > 1 else np.empty(0)
    if len(steps) < MIN_STEPS or np.count_nonzero(held > 1) < MIN_HELD * len(steps):
        return
    time = float(np.median(held)) * float(np.median(np.diff(evidence.stamp_ns))) * NANOSECOND
    yield Finding(
        "velocity_held", WARNING, (),
        f"velocities stay the same for {1e3 * time:.0f} ms and then step, while positions move "
        "on: their slope, and so the acceleration, is a staircase",
        time, *remedies.NO_VELOCITY,
    )  # fmt: skip


def _degrees_unseen(evidence: Evidence) -> Iterator[Finding]:
    """Say so if positions in degrees would not leave the limits either."""
    limits, position = evidence.robot.limits, evidence.position
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    turning = bounded & ~np.asarray(limits.prismatic)
    if not turning.any():
        return
    limit = np.maximum(np.abs(limits.lower), np.abs(limits.upper))[turning]
    if np.any(np.max(np.abs(DEGREES * position[:, turning]), axis=0) > FAR * limit):
        return
    why = "in degrees they would lie inside the limits of the URDF as well"
    yield unjudged("degrees", (), "whether positions are in radians", why)


class _Steps(NamedTuple):
    """Steps of a joint from sample to sample, shape (N,) each."""

    change: Float  # mean velocity, of its positions
    velocity: Float  # mean of the recorded velocities
    time: Float  # s
    middle: Float  # since the first stamp [s]


def _change(evidence: Evidence, joint: int) -> _Steps:
    time = np.diff(evidence.stamp_ns) * NANOSECOND
    same = (np.diff(evidence.segment) == 0) & (time > 0)
    position, velocity = evidence.position[:, joint], evidence.velocity[:, joint]
    step = np.diff(position)
    if evidence.robot.limits.wraps[joint]:
        step = shortest(step)
    change = step[same] / time[same]
    middle = (evidence.stamp_ns[1:] - evidence.stamp_ns[0]) * NANOSECOND - 0.5 * time
    return _Steps(change, 0.5 * (velocity[1:] + velocity[:-1])[same], time[same], middle[same])


def _late(evidence: Evidence) -> Iterator[Finding]:
    """Velocities of all joints that are behind their positions, or ahead of them."""
    if evidence.derived or evidence.remarks.repeating:
        return
    steps = [_change(evidence, joint) for joint in range(len(evidence.names))]
    lag = field_lag(steps[0].middle, [(one.change[:, None], one.velocity) for one in steps], LATE)
    if lag:
        where = "behind" if lag > 0.0 else "ahead of"
        yield Finding(
            "velocity_late", ERROR, evidence.names,
            f"velocities are {abs(lag):.2f} s {where} the change of the positions, as filtered "
            "or delayed ones are", lag, *remedies.NO_VELOCITY,
        )  # fmt: skip


def _apart(evidence: Evidence, joint: int, steps: _Steps) -> Iterator[Finding]:
    """A velocity that does not sum to the change of its position in some of the seconds."""
    second = steps.middle.astype(np.int64)

    def total(values: Float) -> Float:
        return np.bincount(second, values * steps.time).astype(np.float64)

    off, way = total(steps.change - steps.velocity), total(np.abs(steps.change))
    if not evidence.robot.limits.prismatic[joint]:
        off = shortest(off)  # a position may be wrapped at half a turn
    longest = float(max(way.max(), total(np.abs(steps.velocity)).max()))
    sampled = np.bincount(second) >= MIN_SAMPLED
    apart = np.flatnonzero(sampled & (np.abs(off) > max(APART * longest, MIN_TRAVEL)))
    if len(apart) < max(MIN_APART, MIN_BEYOND * np.count_nonzero(sampled)):
        return
    name, since = evidence.names[joint], f"{len(apart)} s, first {apart[0]} s after the begin"
    if np.median(way[apart]) > 0.0:
        yield Finding(
            "velocity_apart", ERROR, (name,),
            f"the velocity of {name} does not sum to the change of its position in {since}",
            float(len(apart)), *remedies.NO_VELOCITY,
        )  # fmt: skip
    else:
        yield Finding(
            "position_held", ERROR, (name,),
            f"the position of {name} stays the same although its velocity is not 0 in {since}",
            float(len(apart)), "leave this recording out, or record again",
        )  # fmt: skip


def _slope(evidence: Evidence, joint: int) -> Iterator[Finding]:
    if evidence.derived:
        return
    name, position = evidence.names[joint], evidence.position[:, joint]
    away = position - position[0]
    travel = float(np.ptp(shortest(away) if evidence.robot.limits.wraps[joint] else away))
    steps = _change(evidence, joint)
    change, velocity, time, _ = steps
    if travel > MIN_TRAVEL and not velocity.any():
        yield Finding(
            "velocity_zero", ERROR, (name,),
            f"{ALWAYS_ZERO.format(name)} by {travel:.3g} {evidence.robot.limits.unit(joint)}",
            travel, *remedies.NO_VELOCITY,
        )  # fmt: skip
    if len(change) < MIN_SAMPLES or not change.std() > 1e-3 or not velocity.std() > 1e-4:
        return
    correlation = float(np.corrcoef(change, velocity)[0, 1])
    slope = float(velocity @ change / (change @ change))
    way = np.abs(velocity) @ time / (np.abs(change) @ time)  # stamps that are rounded leave it
    if correlation < -MIN_FIT:
        yield Finding(
            "velocity_sign", ERROR, (name,),
            f"the velocity of {name} has the opposite sign of the change of its position "
            f"(correlation {correlation:.2f})",
            correlation,
        )  # fmt: skip
    elif correlation < MIN_FIT and not evidence.remarks.repeating:
        yield Finding(
            "velocity_unrelated", WARNING, (name,),
            f"the velocity of {name} does not follow its position "
            f"(correlation {correlation:.2f})",
            correlation, *remedies.NO_VELOCITY,
        )  # fmt: skip
    elif abs(slope - 1.0) > MAX_SCALE_ERROR and correlation > 0.9:
        if abs(way - 1.0) <= MAX_SCALE_ERROR:
            yield Finding(
                STAMPS_UNEVEN, WARNING, (name,),
                f"the position of {name} changes unevenly from stamp to stamp, its velocity does "
                "not: stamps are rounded or late",
                slope, *remedies.RECEIPT,
            )  # fmt: skip
            return
        yield Finding(
            "velocity_scale", ERROR, (name,),
            f"the velocity of {name} is {slope:.3g} times the change of its position"
            + (": one of them is in degrees" if _in_degrees(slope) != slope else ""),
            slope,
        )  # fmt: skip
    else:
        yield from _apart(evidence, joint, steps)


def _in_degrees(slope: float) -> float:
    """The factor of degrees or of radians where a slope is near it, else the slope."""
    near = [unit for unit in (DEGREES, 1.0 / DEGREES) if abs(np.log(slope / unit)) < NEAR]
    return near[0] if near else slope


def _together(evidence: Evidence, findings: Sequence[Finding]) -> Iterator[Finding]:
    """One finding, and one line that mends it, for all joints whose velocity has one cause."""
    for cause in dict.fromkeys(one.cause for one in findings):
        alike = [one for one in findings if one.cause == cause]
        names = tuple(name for one in alike for name in one.subject)
        joints = tuple(map(evidence.names.index, names))
        remedy = alike[0].remedy, alike[0].remedy_in
        if cause == "velocity_sign":
            remedy = remedies.corrected(evidence, ("velocity",), joints, sign=-1.0)
        elif cause == "velocity_scale":
            scales = [1.0 / _in_degrees(one.evidence) for one in alike]
            remedy = remedies.corrected(evidence, ("velocity",), joints, scale=scales)
        more = f"; likewise that of {', '.join(names[1:])}" if alike[1:] else ""
        yield replace(
            alike[0], subject=names, sentence=alike[0].sentence + more,
            remedy=remedy[0], remedy_in=remedy[1],
        )  # fmt: skip


def _unit(evidence: Evidence, joint: int) -> _Unit:
    return UNITS[bool(evidence.robot.limits.prismatic[joint])]


def _outside(evidence: Evidence, joint: int) -> float:
    """Share of the positions outside the limits of the URDF; 0 where it has none."""
    limits, margin = evidence.robot.limits, _unit(evidence, joint).margin
    position = evidence.position[:, joint]
    low, high = limits.lower[joint] - margin, limits.upper[joint] + margin
    beyond = np.count_nonzero((position < low) | (position > high)) / len(position)
    return beyond if beyond >= MIN_BEYOND else 0.0


def _in_other_unit(evidence: Evidence, joint: int) -> bool:
    """Whether positions lie far outside the limits, and inside them in the other unit."""
    if not _outside(evidence, joint):
        return False
    limits, unit = evidence.robot.limits, _unit(evidence, joint)
    low, high = float(limits.lower[joint]), float(limits.upper[joint])
    if not np.isfinite([low, high]).all():
        return False
    position = evidence.position[:, joint] / unit.factor
    within = np.all((position > low - unit.margin) & (position < high + unit.margin))
    most = unit.factor * float(np.max(np.abs(position)))
    return bool(within) and most > FAR * max(abs(low), abs(high))


def _beyond_limits(evidence: Evidence, joint: int, beyond: float) -> str:
    """How much of the positions of a joint lies outside its limits, and where, in words."""
    limits, position = evidence.robot.limits, evidence.position[:, joint]
    return (
        f"{100 * beyond:.0f} % of the positions of {evidence.names[joint]} lie outside the limits "
        f"of the URDF ({limits.lower[joint]:.3g} to {limits.upper[joint]:.3g} "
        f"{limits.unit(joint)}; recorded {position.min():.3g} to {position.max():.3g})"
    )


def _units(evidence: Evidence, joint: int, foreign: Sequence[bool]) -> Iterator[Finding]:
    """Name the unit, and correct all joints of its kind: most drivers state them alike."""
    unit, beyond = _unit(evidence, joint), _outside(evidence, joint)
    kinds = {_unit(evidence, one) for one, is_foreign in enumerate(foreign) if is_foreign}
    limits = evidence.robot.limits
    # a joint that moves far between its limits as it is moves hardly in another unit
    far = np.ptp(evidence.position, axis=0) > MIN_SHARE * (limits.upper - limits.lower)
    joints = tuple(
        one
        for one, is_foreign in enumerate(foreign)
        if is_foreign or (_unit(evidence, one) in kinds and not far[one])
    )
    scales = [1.0 / _unit(evidence, one).factor for one in joints]
    change, velocity, *_ = _change(evidence, joint)
    slope = float(velocity @ change / (change @ change)) if change.any() else 1.0
    sound = slope > 0 and abs(np.log(slope * unit.factor)) < NEAR  # the velocity is in SI
    quantities = ("position",) if sound else ("position", "velocity")
    yield Finding(
        unit.name, ERROR, (evidence.names[joint],),
        f"{_beyond_limits(evidence, joint, beyond)}, and inside them as {unit.name}",
        beyond, *remedies.corrected(evidence, quantities, joints, scale=scales),
    )  # fmt: skip


def _limits(evidence: Evidence, joint: int) -> Iterator[Finding]:
    if beyond := _outside(evidence, joint):
        yield Finding(
            "position_limit", WARNING, (evidence.names[joint],),
            _beyond_limits(evidence, joint, beyond), beyond,
            "check the zero and the sign of the joint, or the limits of the URDF",
        )  # fmt: skip


def _rest(evidence: Evidence) -> Iterator[Finding]:
    """Joints whose noise at rest exceeds the model's standstill velocity."""
    noise = velocity_noise(evidence.stamp_ns, evidence.velocity)
    rested = evidence.durations @ (np.abs(evidence.velocity) < 4.0 * noise) >= MIN_REST
    noise = np.where(rested, noise, np.nan)
    noisy = {
        name: float(value)
        for name, value, joint in zip(evidence.names, noise, evidence.model.joints, strict=True)
        if np.isfinite(value) and 0.5 * joint.standstill_velocity < value < 0.02
    }
    if not noisy:
        return
    names, worst = tuple(noisy), max(noisy.values())
    rest = float(f"{4.0 * worst:.1g}")
    entries = ", ".join(f"{{name: {name}, standstill_velocity: {rest:g}}}" for name in names)
    yield Finding(
        "standstill_velocity", WARNING, names,
        f"at rest the velocity of {', '.join(names)} still varies by up to "
        f"{1e3 * worst:.2g} mrad/s, near or above standstill_velocity: rest is rarely detected",
        worst, f"joints: [{entries}]", MODEL,
    )  # fmt: skip
