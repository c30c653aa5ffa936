"""What a recording cannot show: one note for each quantity, with the joints it concerns."""

from __future__ import annotations

import numpy as np

from robot_energy.check.evidence import Evidence
from robot_energy.check.finding import NOTE, UNJUDGED, Finding, unjudged
from robot_energy.check.hypotheses import Cause
from robot_energy.check.search import OFFSET, SearchResult

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


def unseen_findings(evidence: Evidence, result: SearchResult) -> list[Finding]:
    """Return one note for each kind of mistake that this recording cannot show.

    Args:
        evidence: The recording.
        result: Of the search for causes.
    """
    findings: list[Finding] = []
    for name, what in WHAT.items():
        causes = [cause for cause in result.unseen if cause.name == name]
        if not causes:
            continue
        joints = sorted({joint for cause in causes for joint in cause.joints})
        subject = tuple(evidence.names[joint] for joint in joints)
        shown = what.format(", ".join(dict.fromkeys(_named(evidence, one) for one in causes)))
        size = SIZE.get(name, "a mistake")
        findings.append(
            unjudged(name, subject, shown, f"{size} changes the unexplained torque too little")
        )
    if np.isfinite(result.payload):
        sentence = f"a payload that is off by less than {result.payload:.2g} kg would not be found"
    else:
        sentence = "cannot be judged from this recording: the payload (it moves no measured joint)"
    findings.append(
        Finding(UNJUDGED + "payload", NOTE, ("payload",), sentence, result.payload, float("nan"))
    )
    return findings


def _named(evidence: Evidence, cause: Cause) -> str:
    if len(cause.joints) == len(evidence.names) > 2:
        return "all joints"
    return " with ".join(evidence.names[joint] for joint in cause.joints)
