"""What a check of a recording finds, and its result."""

from __future__ import annotations

import re
from dataclasses import field
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.results.base import Result

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


class Finding(Described):
    """One thing that does not fit, or that cannot be known from the recording."""

    cause: Annotated[
        str, "Such as ``torque_sign``; stable. If it cannot be judged it begins with ``unjudged.``."
    ]
    severity: Annotated[str, "``error``: figures are wrong; ``warning``: they may be; ``note``."]
    subject: Annotated[tuple[str, ...], "Joint names, ``meter``, ``temperature`` or ``payload``."]
    sentence: Annotated[str, "What was found, with the evidence in numbers."]
    evidence: Annotated[
        float, "The number behind it, in the unit that the sentence states; NaN where it has none."
    ] = float("nan")
    remedy: Annotated[str, "The line of YAML that mends it, or the action; may be empty."] = ""
    remedy_in: Annotated[str, "The file of the line of YAML; empty for an action."] = ""
    alternatives: Annotated[
        tuple[str, ...],
        "Causes that explain it as well; ``bodies``: further off than the model says.",
    ] = ()

    @property
    def option(self) -> str:
        """The option of a command that stands for the line of YAML and counts before it."""
        meaning = re.search(r"effort_meaning: (\w+)", self.remedy)
        return f", or --effort {meaning[1]}" if meaning else ""


class CheckResult(Described):
    """All findings of one recording with one model."""

    recording: Annotated[str, "Path of the bag."]
    model: Annotated[str, "Type of the robot and id of the model."]
    findings: Annotated[tuple[Finding, ...], "Errors first."]
    checked: Annotated[tuple[str, ...], "Names of the checks that had what they need."] = ()
    skipped: Annotated[dict[str, str], "The other checks, with what they lack."] = field(
        default_factory=dict[str, str]
    )

    @property
    def errors(self) -> tuple[Finding, ...]:
        return tuple(entry for entry in self.findings if entry.severity == ERROR)


def unjudged(cause: str, subject: tuple[str, ...], what: str, why: str) -> Finding:
    """Return a note that a recording cannot show a mistake; of all joints without a subject."""
    sentence = f"cannot be judged from this recording: {what} ({why})"
    return Finding(UNJUDGED + cause, NOTE, subject, sentence)


class CheckReport(Result, name="check"):
    """Findings of recordings with one model."""

    recordings: Annotated[tuple[CheckResult, ...], "One for each."]
