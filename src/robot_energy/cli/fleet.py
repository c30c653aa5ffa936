"""`robot-energy fleet`: many bags of many robots."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

from robot_energy.cli import fleet_identify, fleet_report, fleet_run


def add_parser(commands: Any) -> None:
    """Add the sub-command and what can be done with a fleet.

    Args:
        commands: Sub-parsers of the command above.
    """
    parser: ArgumentParser = commands.add_parser(
        "fleet",
        help="many bags of many robots: replay them, report, identify",
        description="Many bags of many robots: replay them into a dataset, report, identify.",
    )
    subjects = parser.add_subparsers(title="what", metavar="WHAT", required=True)
    for module in (fleet_run, fleet_report, fleet_identify):
        module.add_parser(subjects)
