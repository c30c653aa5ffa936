"""Commands that print a text: `robot-energy kinds`, `schema` and `completion`."""

from __future__ import annotations

import json
import sys
from argparse import Namespace

from robot_energy_cli.command import Command


def _print_kinds(args: Namespace) -> int:
    from robot_energy_cli.kinds import kinds_listing

    del args
    print(kinds_listing(), end="")
    return 0


def _print_schema(args: Namespace) -> int:
    from robot_energy_cli.result_schema import schema_of

    print(json.dumps(schema_of(args.name), indent=1))
    return 0


def _print_completion(args: Namespace) -> int:
    import shtab

    from robot_energy_cli.main import build_parser

    sys.stdout.write(shtab.complete(build_parser(), args.shell))
    return 0


KINDS = Command(
    "kinds",
    "list drive models, friction laws, meters, temperatures, log formats, robots",
    _print_kinds,
    description="List the kinds of drive models, friction laws, meters, temperature sources "
    "and log formats, those of your own included, and the robots whose drivers are known, as "
    "Markdown.",
)
SCHEMA = Command(
    "schema",
    "print the JSON Schema of results",
    _print_schema,
    {"name RESULT": ("one result (default: all)", {"nargs": "?"})},
    """\
Print the JSON Schema of what a command writes with --json, by the value of its key "result":
replay, prediction, optimization, advice, friction, friction_study, thermal, cabinet,
auxiliary, drives, dynamics, excitation, identification, model, check, test, fleet_run,
fleet_report, fleet_friction. Without a name: one schema for all of them.
""",
)
COMPLETION = Command(
    "completion",
    "print the completion script of a shell",
    _print_completion,
    {"shell": ("the shell", {"choices": ("bash", "zsh", "tcsh")})},
    "Print a script that completes commands, options and files.",
    """\
bash: add  eval "$(robot-energy completion bash)"  to ~/.bashrc
zsh:  write it to a file _robot-energy in a folder of $fpath
""",
)
