"""Which causes explain the torque that the model leaves unexplained, the strongest first.

The cause that lowers the unexplained torque most is named, if it lowers it far enough. Then the
search goes on with the corrected recording, so that several causes are found. What would change
the unexplained torque too little to be named cannot be judged from the recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import EffortMeaning
from robot_energy.check.evidence import Evidence
from robot_energy.check.hypotheses import (
    SCALES,
    Cause,
    Trial,
    attempt,
    best_offset,
    effort_meaning,
    gear_ratio,
    home_pose,
    joint_order,
    joint_sign,
    offset,
    torque_factor,
)
from robot_energy.check.payload import fitted_payload, payload_cause

MAX_CAUSES = 4  # found one after the other
WORTH = 0.05  # share of unexplained torque of a joint, below which it needs no gear ratio
RATIOS = (2.0, 0.5, 3.0, 1 / 3, 4.0, 0.25)
MIN_MOVE = 0.05  # rad of range, below which a joint does not show its zero
ALIKE = 0.1  # of cost: two causes that differ by less explain the same
MAX_FACTOR = 3.0  # of measured over body torque, for a meaning of the effort that fits
OFFSET = 0.1  # rad: the least zero error that is to be found
UNITS = {"gear_ratio": (2.0, 0.5), "torque_scale": (2.0**0.5, 2.0**-0.5)}  # least to be found


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


def search(evidence: Evidence) -> SearchResult:
    """Find the causes, the strongest first.

    Args:
        evidence: The recording, thinned.

    Returns:
        Causes, and what cannot be seen.
    """
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
    return SearchResult(tuple(found), first, trial, tuple(_unseen(trial, tried)), fit.least)


def _worth(cause: Cause, trial: Trial) -> bool:
    return cause.name != "gear_ratio" or bool(trial.unexplained[cause.joints[0]] > WORTH)


def _unseen(trial: Trial, tried: list[tuple[Cause, Trial]]) -> list[Cause]:
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
    prismatic = trial.evidence.robot.limits.prismatic
    for j in range(len(prismatic)):
        if prismatic[j]:
            continue
        shifted = [offset(j, value) for value in (OFFSET, -OFFSET)]
        rise = min(attempt(one.correct(trial.evidence)).cost() for one in shifted) - trial.cost()
        if rise < shifted[0].least_gain:
            unseen.append(shifted[0])
    return unseen


def candidates(trial: Trial) -> list[Cause]:
    """Return the causes worth a trial with a recording.

    Args:
        trial: The recording as it is now.
    """
    evidence = trial.evidence
    count = len(evidence.names)
    known = [j for j in range(count) if np.isfinite(trial.unexplained[j])]
    everything = tuple(range(count))
    found = [torque_factor("torque_sign", everything, -1.0, 0.3)]
    if count > 1:
        found += [torque_factor("torque_sign", (j,), -1.0, 0.3) for j in known]
    found += [joint_sign(j) for j in known]
    for factors in SCALES.values():
        least = 0.15 * len(known)
        found += [torque_factor("torque_scale", everything, factor, least) for factor in factors]
    found += [gear_ratio(j, factor) for j in known for factor in RATIOS]
    found += [effort_meaning(evidence, meaning) for meaning in _meanings(evidence)]
    found += [joint_order(i, j) for i in known for j in known if i < j]
    prismatic = evidence.robot.limits.prismatic
    found += [
        home_pose(j, j + 1, value)
        for j in everything[:-1]
        for value in (-np.pi / 2, np.pi / 2)
        if not prismatic[j] and not prismatic[j + 1]
    ]
    for j in everything:
        if not prismatic[j] and np.ptp(evidence.position[:, j]) > MIN_MOVE:
            best = best_offset(evidence, j)
            if best is not None:
                found.append(best)
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
