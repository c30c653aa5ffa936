"""Whether recordings fit a model."""

from typing import Annotated

from robot_energy.results.base import Result
from robot_energy_identify.check import CheckResult


class CheckReport(Result, name="check"):
    """Findings of recordings with one model."""

    recordings: Annotated[tuple[CheckResult, ...], "One for each."]
