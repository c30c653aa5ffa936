"""`robot-energy kinds`: what is known of drive models, friction laws, meters ..."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy.cli.terminal import add_command


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    add_command(
        commands,
        "kinds",
        run,
        "list drive models, friction laws, meters, temperatures, log formats, robots",
        "List the kinds of drive models, friction laws, meters, temperature sources "
        "and log formats, those of your own included, and the robots whose drivers are known, as "
        "Markdown.",
    )


def run(args: Namespace) -> int:
    """Print the tables of kinds.

    Args:
        args: Of the command; none is used.

    Returns:
        Exit code 0.
    """
    from robot_energy.report.kinds import kinds_listing

    print(kinds_listing(), end="")
    return 0
