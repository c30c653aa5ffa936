"""Does a recording fit a model? Causes named with evidence and the line that mends them."""

from robot_energy_identify.check.finding import CheckResult, Finding
from robot_energy_identify.check.run import check, check_together

__all__ = ["CheckResult", "Finding", "check", "check_together"]
