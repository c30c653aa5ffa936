"""Whether recordings fit a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robot_energy.check import CheckResult
from robot_energy.results.base import Result


@dataclass(frozen=True)
class CheckReport(Result):
    """Findings of recordings with one model.

    Attributes:
        recordings: One for each.
    """

    NAME: ClassVar[str] = "check"

    recordings: tuple[CheckResult, ...]
