"""Which causes explain the torque that the model leaves unexplained, the strongest first.

The cause that lowers the unexplained torque most is named, if it lowers it far enough. Then the
search goes on with the corrected recording, so that several causes are found.
"""

from __future__ import annotations

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
    torque_factor,
)
from robot_energy.check.payload import payload_cause

MAX_CAUSES = 4  # found one after the other
WORTH = 0.05  # share of unexplained torque of a joint, below which it needs no gear ratio
RATIOS = (2.0, 0.5, 3.0, 1 / 3, 4.0, 0.25)
MIN_MOVE = 0.05  # rad of range, below which a joint does not show its zero


def search(evidence: Evidence) -> tuple[list[tuple[Cause, float]], Trial, Trial]:
    """Find the causes, the strongest first.

    Args:
        evidence: The recording, thinned.

    Returns:
        Each cause with the share of unexplained variance that it takes away; the trial of the
        recording as it is; the trial without the causes.
    """
    first = trial = attempt(evidence)
    found: list[tuple[Cause, float]] = []
    for _ in range(MAX_CAUSES):
        best: tuple[float, Cause, Trial] | None = None
        for cause in (*candidates(trial), *payload_cause(trial)):
            if cause.name == "gear_ratio" and not (trial.unexplained[cause.joints[0]] > WORTH):
                continue
            corrected = attempt(cause.correct(trial.evidence))
            gain = trial.cost() - corrected.cost() - cause.least_gain
            if gain > 0.0 and (best is None or gain > best[0]):
                best = (gain, cause, corrected)
        if best is None:
            break
        _, cause, corrected = best
        before, after = np.nansum(trial.unexplained), np.nansum(corrected.unexplained)
        found.append((cause, float(1.0 - after / before) if before > 0 else 0.0))
        trial = corrected
    return found, first, trial


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
    found += [torque_factor("torque_sign", (j,), -1.0, 0.3) for j in known]
    found += [joint_sign(j) for j in known]
    for factors in SCALES.values():
        least = 0.15 * len(known)
        found += [torque_factor("torque_scale", everything, factor, least) for factor in factors]
    found += [gear_ratio(j, factor) for j in known for factor in RATIOS]
    if evidence.effort is not EffortMeaning.MOTOR_CURRENT:
        found.append(effort_meaning(evidence))
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
