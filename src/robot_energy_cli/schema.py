"""The command `robot-energy schema`: the JSON Schema of results."""

from __future__ import annotations

import json
from argparse import Namespace

from robot_energy_cli.command import Command


def _run(args: Namespace) -> int:
    from robot_energy_cli.result_schema import schema_of

    print(json.dumps(schema_of(args.name), indent=1, allow_nan=False))
    return 0


COMMAND = Command(
    "schema",
    "print the JSON Schema of results",
    _run,
    {"name RESULT": ("one result (default: all)", {"nargs": "?"})},
    """\
Print the JSON Schema of what a command writes with --json, by the value of its key "result":
replay, prediction, optimization, advice, friction, friction_study, thermal, cabinet,
auxiliary, drives, dynamics, excitation, identification, model, check, test, fleet_run,
fleet_report, fleet_friction. Without a name: one schema for all of them.
""",
)
