"""Does the recorded torque fit the bodies, gears and payload of the model?

The cause that lowers the unexplained torque most is named, if it lowers it far enough. Then the
search goes on with the corrected recording, so that several causes are found. What would change
the unexplained torque too little to be named cannot be judged from the recording.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robot_energy.timeline.blocks import EffortMeaning
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
from robot_energy_identify.check.hypotheses import (
    MAX_FACTOR,
    MIN_MOTION,
    MIN_SAMPLES,
    Cause,
    Trial,
    attempt,
    candidates,
    scale_words,
    zero_offset,
)
from robot_energy_identify.check.payload import fitted_payload, payload_cause

MAX_CAUSES = 4  # found one after the other
WORTH = 0.05  # share of unexplained torque of a joint, below which it needs no gear ratio
ALIKE = 0.1  # of cost: two causes that differ by less explain the same
OFFSET = 0.1  # rad: the least zero error that is to be found
UNITS = {"gear_ratio": (2.0, 0.5), "torque_scale": (2.0**0.5, 2.0**-0.5)}  # least to be found
WIDE = 0.1  # of a gear ratio: a deviation from which it is a prior
MIN_CORRELATION = 0.6  # of measured and body torque, below which a factor means nothing
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


@dataclass(frozen=True)
class SearchResult:
    """Causes of a recording, and what it cannot show.

    Attributes:
        causes: The strongest first; each with the share of unexplained variance that it takes
            away, and the names of causes that explain it as well.
        first: The recording as it is.
        last: The recording without the causes.
        unseen: Causes that change too little to be named if they were there.
        payload: The least mass that would be found; infinite for none. [kg]
    """

    causes: tuple[tuple[Cause, float, tuple[str, ...]], ...]
    first: Trial
    last: Trial
    unseen: tuple[Cause, ...]
    payload: float


def check_torque(evidence: Evidence) -> tuple[list[Finding], str]:
    """Return findings on the torque against the model, and why there cannot be any.

    Args:
        evidence: The recording.
    """
    if evidence.effort is EffortMeaning.NONE:
        why = f"the meaning of the effort is not stated: set {EFFORT}"
        return list(_fitting_meanings(evidence)), why
    if not bool(np.isfinite(evidence.motor_torque).any()):
        return [], "the joint states carry no effort"
    thin = evidence.thinned()
    if not bool(np.isfinite(attempt(thin).unexplained).any()):
        return [], f"no joint has {LEAST} with an acceleration"
    result = _search(thin)
    findings = [
        _finding(evidence, cause, share, alike, result.first)
        for cause, share, alike in result.causes
    ]
    findings += _poor(evidence, result.last)
    findings += _unseen(evidence, result)
    unknown = [name for name, share in zip(evidence.names, result.last.unexplained, strict=True)
               if not np.isfinite(share)]  # fmt: skip
    if unknown:
        why = f"less than {LEAST}"
        findings.append(
            unjudged("torque", tuple(unknown), f"the torque of {', '.join(unknown)}", why)
        )
    return findings, ""


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
            factor, float("nan"), *remedies.effort_meaning(str(meaning)),
        )  # fmt: skip


def _finding(
    evidence: Evidence, cause: Cause, share: float, alike: tuple[str, ...], first: Trial
) -> Finding:
    names = tuple(evidence.names[j] for j in cause.joints) or (cause.name,)
    which = "all joints" if len(names) == len(evidence.names) > 1 else ", ".join(names)
    proof = f"as it is, the model explains {_explained(first, cause.joints)} of its torque"
    value, joints = cause.value, cause.joints
    words = {
        "torque_sign": lambda: (
            f"the torque of {which} has the opposite sign ({proof})",
            remedies.corrected(evidence, ("effort",), joints, sign=-1.0),
        ),
        "joint_sign": lambda: (
            f"position and velocity of {which} have the opposite sign of the URDF ({proof})",
            remedies.corrected(evidence, ("position", "velocity"), joints, sign=-1.0),
        ),
        "torque_scale": lambda: (
            f"the torque of {which} is {value:.3g} times what the model expects: "
            f"{scale_words(value)} ({proof})",
            remedies.corrected(evidence, ("effort",), joints, scale=1.0 / value),
        ),
        "gear_ratio": lambda: (
            f"the motor torque of {which} is that of a gear ratio {1 / value:.3g} times the "
            f"model's ({proof})",
            remedies.gear_ratio(evidence, joints[0], value),
        ),
        "effort_meaning": lambda: (
            f"the effort is no {evidence.effort} but {cause.choice}: taken for the former it "
            f"is {value:.2g} times the torque that the bodies need, taken for {cause.choice} "
            f"{evidence.remarks.effort_factors[EffortMeaning(cause.choice)][0]:.2g} times",
            remedies.effort_meaning(cause.choice),
        ),
        "payload": lambda: (
            f"the robot carries {abs(value):.2f} +- {cause.std:.2f} kg "
            f"{'more' if value > 0 else 'less'} than the model's payload of "
            f"{evidence.robot.payload_mass:.2f} kg",
            remedies.payload(evidence, value, cause.moment),
        ),
        "joint_order": lambda: (
            f"{' and '.join(names)} have each other's values ({proof})",
            remedies.joint_order(evidence, *joints),
        ),
        "zero_offset": lambda: (
            f"the zero of {names[0]} is off by {value:+.3f} rad"
            + (f", that of {names[1]} by {-value:+.3f} rad" if len(names) > 1 else "")
            + f" ({proof})",
            remedies.zero(evidence, joints, value),
        ),
    }
    sentence, (remedy, place) = words[cause.name]()
    if alike:
        sentence += f"; as well explained by {', '.join(alike)}"
    severity = ERROR
    ratios = [evidence.model.joints[joint].gear_ratio for joint in cause.joints]
    # assumed with a stated, wide deviation, as in first models
    guessed = all(r.tag == "assumed" and (r.std or 0.0) > WIDE * abs(r.value) for r in ratios)
    if cause.name in ("gear_ratio", "torque_scale") and guessed:
        severity = WARNING
        sentence += "; the gear ratio is a prior"
    certainty = max(share, 0.0)  # one of several causes may explain nothing by itself
    return Finding(cause.name, severity, names, sentence, value, certainty, remedy, place, alike)


def _explained(trial: Trial, joints: tuple[int, ...]) -> str:
    """Least share of torque variance that the model explains, of some joints."""
    shares = [1.0 - trial.unexplained[j] for j in joints if np.isfinite(trial.unexplained[j])]
    return f"{100 * max(min(shares), 0.0):.0f} %" if shares else "nothing"


def _poor(evidence: Evidence, trial: Trial) -> Iterator[Finding]:
    """Joints whose torque no single cause explains."""
    poor = [
        (name, float(share))
        for name, share in zip(evidence.names, trial.unexplained, strict=True)
        if share > POOR
    ]
    if poor:
        text = ", ".join(f"{name} {100 * share:.0f} %" for name, share in poor)
        yield Finding(
            "torque_unexplained", WARNING, tuple(name for name, _ in poor),
            f"bodies and friction leave torque unexplained: {text}",
            max(share for _, share in poor), float("nan"),
            "check masses, gear ratios, the meaning of the effort, and forces from outside",
        )  # fmt: skip


def _unseen(evidence: Evidence, result: SearchResult) -> Iterator[Finding]:
    """One note for each kind of mistake that this recording cannot show, with its joints."""
    for name, what in WHAT.items():
        causes = [cause for cause in result.unseen if cause.name == name]
        if not causes:
            continue
        joints = sorted({joint for cause in causes for joint in cause.joints})
        subject = tuple(evidence.names[joint] for joint in joints)
        shown = what.format(", ".join(dict.fromkeys(_named(evidence, one) for one in causes)))
        size = SIZE.get(name, "a mistake")
        yield unjudged(name, subject, shown, f"{size} changes the unexplained torque too little")
    if np.isfinite(result.payload):
        sentence = f"a payload that is off by less than {result.payload:.2g} kg would not be found"
    else:
        sentence = "cannot be judged from this recording: the payload (it moves no measured joint)"
    yield Finding(UNJUDGED + "payload", NOTE, ("payload",), sentence, result.payload, float("nan"))


def _named(evidence: Evidence, cause: Cause) -> str:
    if len(cause.joints) == len(evidence.names) > 2:
        return "all joints"
    return " with ".join(evidence.names[joint] for joint in cause.joints)


def _search(evidence: Evidence) -> SearchResult:
    """The causes, the strongest first, and what cannot be seen."""
    first = trial = attempt(evidence)
    found: list[tuple[Cause, float, tuple[str, ...]]] = []
    while True:
        fit = fitted_payload(trial)
        tried = [
            (cause, attempt(cause.correct(trial.evidence), trial))
            for cause in (*candidates(trial), *payload_cause(trial, fit))
        ]
        gains = [
            (trial.cost() - corrected.cost() - cause.least_gain, place)
            for place, (cause, corrected) in enumerate(tried)
            if _worth(cause, trial)
        ]
        gain, place = max(gains, default=(0.0, 0))
        if gain <= 0.0 or len(found) == MAX_CAUSES:
            break
        cause, corrected = tried[place]
        alike = [
            other.name
            for other, result in tried
            if other.name != cause.name
            and other.joints == cause.joints
            and abs(result.cost() - corrected.cost()) < ALIKE
        ]
        before, after = np.nansum(trial.unexplained), np.nansum(corrected.unexplained)
        share = float(1.0 - after / before) if before > 0 else 0.0
        found.append((cause, share, tuple(dict.fromkeys(alike))))
        trial = corrected
    return SearchResult(tuple(found), first, trial, tuple(_unseen_causes(trial, tried)), fit.least)


def _worth(cause: Cause, trial: Trial) -> bool:
    return cause.name != "gear_ratio" or bool(trial.unexplained[cause.joints[0]] > WORTH)


def _unseen_causes(trial: Trial, tried: list[tuple[Cause, Trial]]) -> list[Cause]:
    """Causes that raise the cost by less than they must lower it to be named.

    A recording with the mistake differs from one without it as the two differ here.
    """
    unseen = [
        cause
        for cause, corrected in tried
        if cause.name not in ("zero_offset", "effort_meaning", "payload")
        and not any(abs(cause.value) == skipped for skipped in (10.0, 0.1, 100.0, 0.01))
        and (cause.name not in UNITS or cause.value in UNITS[cause.name])
        and (corrected.cost() - trial.cost() < cause.least_gain or not _worth(cause, corrected))
    ]
    for j in np.flatnonzero(~np.asarray(trial.evidence.robot.limits.prismatic)).tolist():
        shifted = [zero_offset((j,), value) for value in (OFFSET, -OFFSET)]
        rise = min(attempt(one.correct(trial.evidence)).cost() for one in shifted) - trial.cost()
        if rise < shifted[0].least_gain:
            unseen.append(shifted[0])
    return unseen
