"""`robot-energy schema`: the JSON Schema of results."""

from __future__ import annotations

import json
from argparse import Namespace
from typing import Any

from robot_energy.cli.terminal import add_command

DESCRIPTION = """\
Print the JSON Schema of what a command writes with --json, by the value of its key "result":
replay, prediction, optimization, advice, friction, friction_study, thermal, cabinet,
auxiliary, drives, dynamics, excitation, identification, model, check, test, fleet_run,
fleet_report, fleet_friction. Without a name: one schema for all of them.
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    text = "print the JSON Schema of results"
    parser = add_command(commands, "schema", run, text, DESCRIPTION)
    parser.add_argument("name", nargs="?", metavar="RESULT", help="one result (default: all)")


def run(args: Namespace) -> int:
    """Print the schema.

    Args:
        args: Of the sub-command.

    Returns:
        0.

    Raises:
        ReportError: If there is no such result.
    """
    from robot_energy.results.schema import schema_of

    print(json.dumps(schema_of(args.name), indent=1))
    return 0
