"""`robot-energy identify`: a model from recordings."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

from robot_energy.cli import (
    identify_all,
    identify_auxiliary,
    identify_cabinet,
    identify_drives,
    identify_dynamics,
    identify_excitation,
    identify_friction,
    identify_thermal,
)


def add_parser(commands: Any) -> None:
    """Add the sub-command and what can be identified.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    parser: ArgumentParser = commands.add_parser(
        "identify",
        help="a model of your robot from recordings",
        description="Identify a model from recordings; held-out figures say how good it is.",
    )
    subjects = parser.add_subparsers(title="what", metavar="WHAT", required=True)
    for module in (
        identify_all,
        identify_excitation,
        identify_friction,
        identify_dynamics,
        identify_cabinet,
        identify_drives,
        identify_thermal,
        identify_auxiliary,
    ):
        module.add_parser(subjects)
