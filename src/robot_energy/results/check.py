"""Whether recordings fit a model."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from robot_energy.check import CheckResult
from robot_energy.results.base import Result


@dataclass(frozen=True)
class CheckReport(Result):
    """Findings of recordings with one model."""

    NAME: ClassVar[str] = "check"

    recordings: Annotated[tuple[CheckResult, ...], "One for each."]
