"""What a check of a recording found: cause, evidence in a number, and what mends it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

ERROR = "error"
WARNING = "warning"
NOTE = "note"
SEVERITIES = (ERROR, WARNING, NOTE)
UNJUDGED = "unjudged."  # begins the cause of a note on what a recording cannot show
# What only the command has stands in brackets, which a node leaves out.
EFFORT = "joint_states.effort_meaning (--effort)"
PARAMETERS = "parameter file (--inputs)"
OF_THE_COMMAND = re.compile(r" \(--[a-z-]+\)")
MODEL = "model file"


@dataclass(frozen=True)
class Finding:
    """One thing that does not fit, or that cannot be known from the recording.

    Attributes:
        cause: Name of the cause, such as ``torque_sign``; stable, for programs. That of a note
            on what cannot be judged begins with ``unjudged.``.
        severity: ``error``: figures are wrong; ``warning``: they may be; ``note``: for reading.
        subject: Joint names, ``meter``, ``temperature`` or ``payload``.
        sentence: What was found, with the evidence in numbers.
        evidence: The number behind it, in the unit that the sentence states.
        certainty: How sure, 0 to 1: the share of the variance that this cause explains. NaN where
            the evidence is a count, or the size of the cause.
        remedy: The line of YAML that mends it, or the action; may be empty.
        remedy_in: The file that the line of YAML belongs to; empty where ``remedy`` is an action.
        alternatives: Other causes that explain the recording as well, so that none is blamed;
            ``bodies`` for masses and centres that are further off than the model says.
    """

    cause: str
    severity: str
    subject: tuple[str, ...]
    sentence: str
    evidence: float
    certainty: float
    remedy: str = ""
    remedy_in: str = ""
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True)
class CheckResult:
    """All findings of one recording with one model.

    Attributes:
        recording: Path of the bag.
        model: Type of the robot and id of the model.
        findings: Errors first.
        checked: Names of the checks that had what they need.
        skipped: The other checks, with what they lack.
    """

    recording: str
    model: str
    findings: tuple[Finding, ...]
    checked: tuple[str, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict[str, str])

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that make figures wrong."""
        return tuple(entry for entry in self.findings if entry.severity == ERROR)


def unjudged(cause: str, subject: tuple[str, ...], what: str, why: str) -> Finding:
    """Return a note that a recording cannot show a mistake.

    Args:
        subject: Joint names; empty for all.
    """
    sentence = f"cannot be judged from this recording: {what} ({why})"
    return Finding(UNJUDGED + cause, NOTE, subject, sentence, float(len(subject)), float("nan"))
