"""Whether recordings fit a model."""

from typing import Annotated

from robot_energy.check import CheckResult
from robot_energy.results.base import Result


class CheckReport(Result, name="check"):
    """Findings of recordings with one model."""

    recordings: Annotated[tuple[CheckResult, ...], "One for each."]
