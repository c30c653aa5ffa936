"""Which causes explain the torque that the model leaves unexplained, the strongest first.

The cause that lowers the unexplained torque most is named, if it lowers it far enough. Then the
search goes on with the corrected recording, so that several causes are found. What would change
the unexplained torque too little to be named cannot be judged from the recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.check.evidence import Evidence
from robot_energy.check.hypotheses import Cause, Trial, attempt, candidates, zero_offset
from robot_energy.check.payload import fitted_payload, payload_cause

MAX_CAUSES = 4  # found one after the other
WORTH = 0.05  # share of unexplained torque of a joint, below which it needs no gear ratio
ALIKE = 0.1  # of cost: two causes that differ by less explain the same
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
    """Return the causes, the strongest first, and what cannot be seen.

    Args:
        evidence: The recording, thinned.
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
    for j in np.flatnonzero(~np.asarray(trial.evidence.robot.limits.prismatic)).tolist():
        shifted = [zero_offset((j,), value) for value in (OFFSET, -OFFSET)]
        rise = min(attempt(one.correct(trial.evidence)).cost() for one in shifted) - trial.cost()
        if rise < shifted[0].least_gain:
            unseen.append(shifted[0])
    return unseen
