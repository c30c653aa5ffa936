"""Does the recorded torque fit the bodies, gears and payload of the model?"""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import EffortMeaning
from robot_energy.check.evidence import Evidence
from robot_energy.check.finding import ERROR, NOTE, WARNING, Finding
from robot_energy.check.hypotheses import Cause, Trial, attempt, scale_words
from robot_energy.check.search import search

WIDE = 0.1  # of a gear ratio: a deviation from which it is a prior
POOR = 0.5  # share of unexplained torque from which a model does not fit


def check_torque(evidence: Evidence) -> tuple[list[Finding], str]:
    """Compare the recorded torque with the model.

    Args:
        evidence: The recording.

    Returns:
        The findings, and why there are none where the check cannot be made.
    """
    if evidence.effort is EffortMeaning.NONE:
        return [], "the meaning of the effort is not stated (--effort)"
    if not bool(np.isfinite(evidence.motor_torque).any()):
        return [], "the joint states carry no effort"
    thin = evidence.thinned()
    if not bool(np.isfinite(attempt(thin).unexplained).any()):
        return [], "no joint moves long enough"
    causes, first, last = search(thin)
    findings = [_finding(evidence, cause, share, first) for cause, share in causes]
    findings += _poor(evidence, last)
    unknown = [name for name, share in zip(evidence.names, last.unexplained, strict=True)
               if not np.isfinite(share)]  # fmt: skip
    if unknown:
        findings.append(
            Finding(
                "torque_unknown", NOTE, tuple(unknown),
                f"{', '.join(unknown)}: too little motion to check the torque",
                float(len(unknown)), float("nan"),
            )
        )  # fmt: skip
    return findings, ""


def _finding(evidence: Evidence, cause: Cause, share: float, first: Trial) -> Finding:
    names = tuple(evidence.names[j] for j in cause.joints) or (cause.name,)
    which = "all joints" if len(names) == len(evidence.names) > 1 else ", ".join(names)
    proof = f"as it is, the model explains {_explained(first, cause.joints)} of its torque"
    ratios = [evidence.model.joints[j].gear_ratio.value / cause.value for j in cause.joints]
    ratio = ratios[0] if ratios else float("nan")
    words = {
        "torque_sign": (
            f"the torque of {which} has the opposite sign ({proof})",
            _torque_remedy(evidence, names, "sign: -1"),
        ),
        "joint_sign": (
            f"position and velocity of {which} have the opposite sign of the URDF ({proof})",
            f"turn the axis of {which} in the URDF, or its sign where the recording is imported",
        ),
        "torque_scale": (
            f"the torque of {which} is {cause.value:.3g} times what the model expects: "
            f"{scale_words(cause.value)} ({proof})",
            _torque_remedy(evidence, names, f"scale: {1 / cause.value:.4g}"),
        ),
        "gear_ratio": (
            f"the motor torque of {which} is that of a gear ratio {1 / cause.value:.3g} times the "
            f"model's ({proof})",
            f"joints: {names[0]}: gear_ratio: {ratio:.5g} if that is the true ratio, else check "
            "its torque_constant",
        ),
        "effort_meaning": (
            f"the effort has the size of {'motor' if cause.value > 0 else 'joint'} torque, but "
            f"{'joint' if cause.value > 0 else 'motor'}_torque is stated ({proof})",
            f"effort: {'motor' if cause.value > 0 else 'joint'}_torque",
        ),
        "payload": (
            f"the robot carries {abs(cause.value):.2f} +- {cause.std:.2f} kg "
            f"{'more' if cause.value > 0 else 'less'} than the model's payload of "
            f"{evidence.robot.payload_mass:.2f} kg",
            f"payload: mass: {max(evidence.robot.payload_mass + cause.value, 0.0):.2f}",
        ),
        "joint_order": (
            f"{' and '.join(names)} have each other's values ({proof})",
            f"exchange {' and '.join(names)} in the names of the joint states or in the mapping",
        ),
        "zero_offset": (
            f"the zero of {names[0]} is off by {cause.value:+.3f} rad"
            + (f", that of {names[1]} by {-cause.value:+.3f} rad" if len(names) > 1 else "")
            + f" ({proof})",
            "take it off the recorded positions (zero, where the recording is imported), or turn "
            "the origin of the joint in the URDF",
        ),
    }
    sentence, remedy = words[cause.name]
    severity = ERROR
    if cause.name in ("gear_ratio", "torque_scale") and _ratio_is_a_guess(evidence, cause.joints):
        severity = WARNING
        remedy = f"the gear ratio is a prior: {remedy}"
    return Finding(cause.name, severity, names, sentence, cause.value, share, remedy)


def _ratio_is_a_guess(evidence: Evidence, joints: tuple[int, ...]) -> bool:
    """Whether the gear ratios are assumed with a stated, wide deviation, as in first models."""
    ratios = [evidence.model.joints[joint].gear_ratio for joint in joints]
    return all(
        ratio.tag == "assumed" and (ratio.std or 0.0) > WIDE * abs(ratio.value) for ratio in ratios
    )


def _explained(trial: Trial, joints: tuple[int, ...]) -> str:
    """Least share of torque variance that the model explains, of some joints."""
    shares = [1.0 - trial.unexplained[j] for j in joints if np.isfinite(trial.unexplained[j])]
    return f"{100 * max(min(shares), 0.0):.0f} %" if shares else "nothing"


def _torque_remedy(evidence: Evidence, names: tuple[str, ...], entry: str) -> str:
    if evidence.effort is EffortMeaning.MOTOR_CURRENT:
        return f"torque_constant of {', '.join(names)} in the model file ({entry})"
    return f"{entry} of the effort of {', '.join(names)}, where the recording is imported"


def _poor(evidence: Evidence, trial: Trial) -> list[Finding]:
    """Joints whose torque no single cause explains."""
    poor = [
        (name, float(share))
        for name, share in zip(evidence.names, trial.unexplained, strict=True)
        if share > POOR
    ]
    if not poor:
        return []
    text = ", ".join(f"{name} {100 * share:.0f} %" for name, share in poor)
    return [
        Finding(
            "torque_unexplained", WARNING, tuple(name for name, _ in poor),
            f"bodies and friction leave torque unexplained: {text}",
            max(share for _, share in poor), float("nan"),
            "check masses, gear ratios, the meaning of the effort, and forces from outside",
        )
    ]  # fmt: skip
