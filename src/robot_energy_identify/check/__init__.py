"""Does a recording fit a model? Causes named with evidence and the line that mends them."""

from robot_energy.check.finding import CheckResult, Finding
from robot_energy.check.run import check

__all__ = ["CheckResult", "Finding", "check"]
