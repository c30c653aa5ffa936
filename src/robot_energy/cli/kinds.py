"""`robot-energy kinds`: what is known of drive models, friction laws, meters ..."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from robot_energy.cli.terminal import add_debug


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "kinds",
        help="list drive models, friction laws, meters, temperatures, log formats, robots",
        description="List the kinds of drive models, friction laws, meters, temperature sources "
        "and log formats, those of your own included, and the robots whose drivers are known, as "
        "Markdown.",
    )
    add_debug(parser)
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Print the tables of kinds."""
    from robot_energy.report.kinds import kinds_listing

    print(kinds_listing(), end="")
    return 0
