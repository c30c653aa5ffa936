"""Does the recorded torque fit the bodies, gears and payload of the model?

For every cause the recording is corrected as if it were there, and fitted again with all that the
figures of the model leave open (`robot_energy_identify.check.torque_fit`). The likeliest cause is
named if it is far likelier than no cause, and than any other; then the search goes on with the
corrected recording. Where another explains as much, or bodies that are further off than their
priors say, both are named and none is blamed. What would change too little to be named cannot be
judged from the recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel, load, shipped_models
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import MAX_FACTOR, MIN_CORRELATION
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import EffortMeaning, Float
from robot_energy_identify.check import remedies
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.finding import (
    EFFORT,
    ERROR,
    NOTE,
    UNJUDGED,
    WARNING,
    Finding,
    unjudged,
)
from robot_energy_identify.check.possible_causes import (
    FREE,
    Cause,
    candidates,
    fit_without,
    more_payload,
    scale_words,
    worth_a_fit,
    zero_offset,
)
from robot_energy_identify.check.torque_fit import MIN_MOTION, MIN_SAMPLES, OWN, TorqueFit

MAX_CAUSES = 4  # found one after the other
NEEDED = 12.0  # of cost, that a cause must gain to be named
ALIKE = 6.0  # of cost: two causes that differ by less cannot be distinguished
FURTHER = 5.0  # times their priors, that the bodies of one link may be off; of all, half of it
RARE = 6.0  # of cost, that this must gain before it counts
CLEAR = 60.0  # of cost, beyond which it is not tried whether bodies explain a mistake
MAX_SURPRISE = 6.0  # of the errors that remain, from which a recording is not mended
OFFSET = 0.1  # rad: the least zero error that is to be found
UNITS = {"gear_ratio": (2.0, 0.5), "torque_scale": (2.0**0.5, 2.0**-0.5)}  # least to be found
MIN_MASS = 0.3  # kg: the least payload that is to be found
WIDE = 0.1  # of a gear ratio: a deviation from which it is a prior
UNEXPLAINED = "torque_unexplained"
LEAST = f"{MIN_MOTION:g} s and {MIN_SAMPLES} samples in motion"
POOR = 0.5  # share of unexplained torque from which a model does not fit
WHAT = {
    "zero_offset": "the zero of {}",
    "torque_sign": "the sign of the torque of {}",
    "joint_sign": "the sign of position and velocity of {}",
    "gear_ratio": "the gear ratio of {}",
    "torque_scale": "the scale of the torque of {}",
    "joint_order": "whether joints are exchanged: {}",
}
SIZE = {"zero_offset": f"{OFFSET:g} rad", "gear_ratio": "a factor of 2",
        "torque_scale": "a factor of 1.41"}  # fmt: skip


class Found(Described):
    """A cause, or several of which each explains the recording."""

    cause: Annotated[Cause, "The likeliest."]
    links: Annotated[tuple[int, ...], "Whose bodies explain it, if further off than their priors."]
    alternatives: Annotated[tuple[Cause, ...], "Other causes that do."]
    fit: Annotated[TorqueFit, "Of the recording with it."]


def search(fit: TorqueFit) -> tuple[list[Found], TorqueFit, list[Cause]]:
    """Return the causes, the strongest first, the recording without them, and what is not seen."""
    found: list[Found] = []
    while True:
        likely = [cause for cause in candidates(fit) if worth_a_fit(cause, fit)]
        tried = [(cause, fit_without(cause, fit)) for cause in likely]
        worst = max(MAX_SURPRISE, fit.errors.surprise)  # what needs worse bodies mends nothing
        costs = [
            corrected.cost + FREE * cause.free if corrected.errors.surprise <= worst else np.inf
            for cause, corrected in tried
        ]
        place = int(np.argmin(costs)) if costs else 0
        if not costs or fit.cost - costs[place] < NEEDED or len(found) == MAX_CAUSES:
            break
        cause, corrected = tried[place]
        alternatives = [
            other
            for (other, _), cost in zip(tried, costs, strict=True)
            if cost - costs[place] < ALIKE and not _same(other, cause)
        ]
        links = _links_alike(fit, costs[place] + ALIKE)
        found.append(Found(cause, links, tuple(alternatives), fit))
        if alternatives or links:
            break
        fit = corrected
    return found, fit, _unseen_causes(fit, tried)


def _least_payload(fit: TorqueFit) -> float:
    """The least mass that would be found, as the cost rises with its square; else inf. [kg]"""
    robot = fit.evidence.robot
    mass = 0.05 * robot.moving_mass
    heavier = replace(fit.evidence, robot=robot.with_payload(more_payload(fit.evidence, mass)))
    rise = TorqueFit(heavier).cost - fit.cost
    if rise <= 1.0:
        return np.inf
    return max(MIN_MASS, mass * float(np.sqrt((NEEDED + 2 * FREE) / rise)))


def _same(one: Cause, other: Cause) -> bool:
    """Whether two causes are one, of sizes within their deviations."""
    if one.name != other.name or one.joints != other.joints:
        return False
    spread = float(np.nan_to_num(np.hypot(one.std, other.std)))
    return abs(one.value - other.value) <= 3.0 * spread


def _links_alike(fit: TorqueFit, cost: float) -> tuple[int, ...]:
    """Links whose bodies, if they are further off than their priors, explain as much."""
    every = tuple(range(len(fit.known)))
    alone = [k for k in every if fit.widened(FURTHER, (k,)).cost + RARE < cost]
    if alone:
        return tuple(alone)
    return every if fit.widened(FURTHER / 2, every).cost + RARE < cost else ()


def _unseen_causes(fit: TorqueFit, tried: list[tuple[Cause, TorqueFit]]) -> list[Cause]:
    """Causes that raise the cost by less than they must lower it to be named.

    A recording with the mistake differs from one without it as the two differ here.
    """

    def hidden(cause: Cause, corrected: TorqueFit) -> bool:
        rise = corrected.cost - fit.cost - FREE * cause.free
        return rise < NEEDED or (rise < CLEAR and bool(_links_alike(corrected, fit.cost + ALIKE)))

    unseen = [
        cause
        for cause, corrected in tried
        if cause.name not in ("zero_offset", "effort_meaning", "payload")
        and not any(abs(cause.value) == skipped for skipped in (10.0, 0.1, 100.0, 0.01))
        and (cause.name not in UNITS or cause.value in UNITS[cause.name])
        and hidden(cause, corrected)
    ]
    for j in np.flatnonzero(~np.asarray(fit.evidence.robot.limits.prismatic)).tolist():
        shifted = [zero_offset((j,), value, OFFSET) for value in (OFFSET, -OFFSET)]
        if any(hidden(one, fit_without(one, fit)) for one in shifted):
            unseen.append(shifted[0])
    return unseen


def check_torque(evidence: Evidence, parts: Sequence[Evidence] = ()) -> tuple[list[Finding], str]:
    """Return findings on the torque against the model, and why there cannot be any.

    What makes one of the ``parts``, thinned, less likely is not blamed.
    """
    if evidence.effort is EffortMeaning.NONE:
        why = f"the meaning of the effort is not stated: set {EFFORT}"
        return list(_fitting_meanings(evidence)), why
    if not bool(np.isfinite(evidence.motor_torque).any()):
        return [], "the joint states carry no effort"
    if evidence.of_effort:
        return list(evidence.of_effort), ""
    fit = TorqueFit(evidence.thinned())
    if not fit.known.any():
        return [], f"no joint has {LEAST} with an acceleration"
    found, last, unseen = search(fit)
    alone = [TorqueFit(part) for part in parts]
    if found and (other := _other_robot(evidence, last, alone)) is not None:
        return [other], ""
    findings = [
        _finding(evidence, one, last)
        for one in found
        if not any(fit_without(one.cause, part).cost > part.cost + ALIKE for part in alone)
    ]
    findings += [*_poor(evidence, last), *_source(evidence, last), *_unseen(evidence, unseen)]
    least = _least_payload(last)
    sentence = f"a payload that is off by less than {least:.2g} kg would not be found"
    if np.isinf(least):
        sentence = "cannot be judged from this recording: the payload (it moves no measured joint)"
    findings.append(Finding(UNJUDGED + "payload", NOTE, ("payload",), sentence, least))
    unknown = tuple(np.array(evidence.names)[~last.known].tolist())
    if unknown:
        what, why = f"the torque of {', '.join(unknown)}", f"less than {LEAST}"
        findings.append(unjudged("torque", unknown, what, why))
    return findings, ""


def _other_robot(evidence: Evidence, last: TorqueFit, alone: Sequence[TorqueFit]) -> Finding | None:
    """The shipped model with the same joint names that explains the torque better than any cause.

    Robots of one maker have the same joint names in every size. What explains no more than the
    search did, or makes a recording ``alone`` less likely, is not named.
    """
    fits: dict[str, TorqueFit] = {}
    for name in shipped_models():
        model = load(name)
        if model.joint_names == evidence.names and model.robot.type != evidence.model.robot.type:
            fits[name] = TorqueFit(_as_model(evidence, model).thinned())
    best = clearly_likelier(fits, last)
    if not best or _not_mended(fits[best], ()):
        return None
    model = fits[best].evidence.model
    if any(TorqueFit(_as_model(part.evidence, model)).cost > part.cost + ALIKE for part in alone):
        return None
    return Finding(
        "other_robot", ERROR, evidence.names,
        f"the torque is that of the shipped model {best}, which has the same joint names, and not "
        f"of {evidence.model.robot.type}: no single mistake explains it as well",
        last.cost - fits[best].cost,
        f"take {best} as the model (--model), or one that began with it",
    )  # fmt: skip


def clearly_likelier(fits: Mapping[str, TorqueFit], last: TorqueFit) -> str:
    """Return the model that explains the torque of the same joints far better; empty for none.

    Args:
        fits: By the name of the model. One without the torque of a joint costs less.
        last: With the model of the recording.
    """
    same = {name: fit.cost for name, fit in fits.items() if np.array_equal(fit.known, last.known)}
    best = min(same, key=lambda name: same[name], default="")
    return best if best and last.cost - same[best] > NEEDED else ""


def _as_model(evidence: Evidence, model: RobotModel) -> Evidence:
    """The evidence with the same effort, taken for that of another model."""
    factor = _effort_factor(evidence.effort, model)
    return replace(
        evidence,
        model=model,
        robot=Robot.from_model(model),
        drivetrain=Drivetrain.from_model(model),
        motor_torque=evidence.motor_torque
        * (factor / _effort_factor(evidence.effort, evidence.model)),
    )


def _effort_factor(effort: EffortMeaning, model: RobotModel) -> Float:
    """Motor torque of each joint over the effort of this meaning, shape (n,)."""
    if effort is EffortMeaning.MOTOR_CURRENT:
        return np.array([one.torque_constant.value if one.torque_constant else np.nan
                         for one in model.joints])  # fmt: skip
    if effort is EffortMeaning.JOINT_TORQUE:
        return np.array([1.0 / joint.gear_ratio.value for joint in model.joints])
    return np.ones(len(model.joints))


def _fitting_meanings(evidence: Evidence) -> Iterator[Finding]:
    """What the effort seems to be, where nobody said it."""
    fitting = [
        (meaning, factor)
        for meaning, (factor, correlation) in evidence.remarks.effort_factors.items()
        if 1 / MAX_FACTOR < factor < MAX_FACTOR and correlation > MIN_CORRELATION
    ]
    if fitting:
        meaning, factor = min(fitting, key=lambda one: abs(np.log(one[1])))
        yield Finding(
            "effort_not_stated", NOTE, tuple(evidence.names),
            f"taken for {meaning}, the effort is {factor:.2g} times the torque of the bodies",
            factor, *remedies.effort_meaning(str(meaning)),
        )  # fmt: skip


def _finding(evidence: Evidence, found: Found, last: TorqueFit) -> Finding:
    cause, joints = found.cause, found.cause.joints
    names = tuple(evidence.names[j] for j in joints) or (cause.name,)
    sentence = _words(evidence, cause)
    if found.alternatives or found.links:
        others = [_words(evidence, one) for one in found.alternatives]
        if found.links:
            which = ", ".join(evidence.names[link] for link in found.links)
            others.append(
                f"the bodies behind {which} differ from the model by more than their "
                "standard deviations allow"
            )
        alike = tuple(
            dict.fromkeys([one.name for one in found.alternatives] + ["bodies"] * bool(found.links))
        )
        also = {evidence.names[j] for one in found.alternatives for j in one.joints} - {*names}
        return Finding(
            cause.name, WARNING, (*names, *sorted(also)),
            f"this recording does not distinguish: {'; or '.join([sentence, *others])}",
            cause.value, "record more poses and faster motion, and check again",
            alternatives=alike,
        )  # fmt: skip
    left = found.fit.errors.unexplained[list(joints) or slice(None)]
    shares = 1.0 - left[np.isfinite(left)]
    explained = f"{100 * max(shares.min(), 0.0):.0f} %" if len(shares) else "nothing"
    proof = f"without the correction the model explains {explained} of its torque"
    if found.fit.errors.surprise > 1.0:
        proof += (
            " and needs errors of its bodies of "
            f"{np.sqrt(found.fit.errors.surprise):.1f} standard deviations"
        )
    sentence = f"{sentence} ({proof})"
    if why := _not_mended(last, joints):
        return Finding(
            cause.name, WARNING, names,
            f"{sentence}; with the correction, {why}: there are further mistakes",
            cause.value,
        )  # fmt: skip
    ratios = [evidence.model.joints[joint].gear_ratio for joint in joints]
    # assumed with a stated, wide deviation, as in first models
    guessed = cause.name in ("gear_ratio", "torque_scale") and all(
        r.tag == "assumed" and (r.std or 0.0) > WIDE * abs(r.value) for r in ratios
    )
    return Finding(
        cause.name, WARNING if guessed else ERROR, names,
        sentence + "; the gear ratio is a prior" * guessed,
        cause.value, *remedies.of_cause(evidence, cause),
    )  # fmt: skip


def _words(evidence: Evidence, cause: Cause) -> str:
    """What is wrong, and by how much."""
    names, value = [evidence.names[j] for j in cause.joints], cause.value
    which = "all joints" if len(names) == len(evidence.names) > 1 else ", ".join(names)
    spread = f" +- {cause.std:.2g}" if np.isfinite(cause.std) else ""
    factors = evidence.remarks.effort_factors
    return {
        "torque_sign": lambda: f"the torque of {which} has the opposite sign",
        "joint_sign": lambda: (
            f"position and velocity of {which} have the opposite sign of the URDF"
        ),
        "torque_scale": lambda: (
            f"the torque of {which} is {value:.3g} times what the model expects: "
            f"{scale_words(value)}"
        ),
        "gear_ratio": lambda: (
            f"the motor torque of {which} is that of a gear ratio {1 / value:.3g} times the model's"
        ),
        "effort_meaning": lambda: (
            f"the effort is not {evidence.effort} but {cause.choice}: taken for the former it "
            f"is {value:.2g} times the torque that the bodies need, taken for {cause.choice} "
            f"{factors[EffortMeaning(cause.choice)][0]:.2g} times"
        ),
        "payload": lambda: (
            f"the robot carries {abs(value):.2f}{spread} kg {'more' if value > 0 else 'less'} "
            f"than the model's payload of {evidence.robot.payload_mass:.2f} kg"
        ),
        "joint_order": lambda: f"{' and '.join(names)} have each other's values",
        "zero_offset": lambda: (
            f"the zero of {names[0]} is off by {value:+.3f}{spread} rad"
            + (f", that of {names[1]} by {-value:+.3f} rad" if len(names) > 1 else "")
        ),
    }[cause.name]()


def _not_mended(last: TorqueFit, joints: Sequence[int]) -> str:
    """What a corrected recording needs beyond what the model leaves open; empty if nothing."""
    if last.errors.surprise > MAX_SURPRISE:
        return (
            "the recording still needs errors of the bodies of "
            f"{np.sqrt(last.errors.surprise):.1f} standard deviations"
        )
    left = last.errors.unexplained[list(joints) or slice(None)]
    if len(joints) < len(last.known) and np.nanmax(left, initial=0.0) > POOR:
        return f"{100 * np.nanmax(left):.0f} % of the torque remains unexplained"
    return ""


def _poor(evidence: Evidence, fit: TorqueFit) -> Iterator[Finding]:
    """Joints whose torque no single cause explains, by more than the model's Coulomb friction."""
    coulomb = [joint.friction.coulomb.value for joint in evidence.model.joints]
    share = fit.errors.unexplained
    rms = np.sqrt(share * fit.variance)  # of what no error explains, motor side [N m]
    poor = {
        evidence.names[j]: float(share[j])
        for j in np.flatnonzero((share > POOR) & (rms > coulomb)).tolist()
    }
    if poor:
        text = ", ".join(f"{name} {100 * share:.0f} %" for name, share in poor.items())
        yield Finding(
            UNEXPLAINED, WARNING, tuple(poor),
            f"bodies and friction leave torque unexplained: {text}",
            max(poor.values()),
            "check masses, gear ratios, the meaning of the effort, and forces from outside",
        )  # fmt: skip


def _source(evidence: Evidence, fit: TorqueFit) -> Iterator[Finding]:
    """Whether joint torque was computed from motor current, or measured behind the gear."""
    if evidence.effort is not EffortMeaning.JOINT_TORQUE:
        return
    places = [
        fit.groups[f"joint {j}"].start + OWN.index("rotor") for j in np.flatnonzero(fit.known)
    ]
    weight = fit.errors.std[places] ** -2.0
    share = 0.5 + float(weight @ fit.errors.values[places] / weight.sum())
    std = float(weight.sum() ** -0.5)
    share_words = f"it holds {share:.2f} +- {std:.2f} of the torque that turns the model's rotors"
    if share - 3.0 * std > 0.2:
        words = f"the joint torque is computed from the motor current, not measured: {share_words}"
    elif share + 3.0 * std < 0.5:
        words = f"the joint torque is measured behind the gear: {share_words}"
    else:
        words = f"whether joint torque is measured or computed from current is open: {share_words}"
    yield Finding("effort_source", NOTE, (), words, share)


def _unseen(evidence: Evidence, unseen: Sequence[Cause]) -> Iterator[Finding]:
    """One note for each kind of mistake that this recording cannot show, with its joints."""
    for name, what in WHAT.items():
        causes = [cause for cause in unseen if cause.name == name]
        if not causes:
            continue
        joints = sorted({joint for cause in causes for joint in cause.joints})
        subject = tuple(evidence.names[joint] for joint in joints)
        which = (
            "all joints"
            if len(one.joints) == len(evidence.names) > 2
            else " with ".join(evidence.names[joint] for joint in one.joints)
            for one in causes
        )
        size = SIZE.get(name, "a mistake")
        why = f"{size} changes the torque by no more than the uncertainty of the model"
        yield unjudged(name, subject, what.format(", ".join(dict.fromkeys(which))), why)
