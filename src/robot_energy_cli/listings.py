"""Commands that print a text: `robot-energy kinds`, `schema` and `completion`."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Iterable

from robot_energy.foundation.kinds import Kind
from robot_energy_cli.command import Command


def _print_kinds(args: Namespace) -> int:
    del args
    print(kinds_listing(), end="")
    return 0


def _print_schema(args: Namespace) -> int:
    from robot_energy_cli.result_schema import schema_of

    print(json.dumps(schema_of(args.name), indent=1, allow_nan=False))
    return 0


def _print_completion(args: Namespace) -> int:
    import shtab

    from robot_energy_cli.main import build_parser

    sys.stdout.write(shtab.complete(build_parser(), args.shell))
    return 0


def kinds_listing() -> str:
    """Return all tables of kinds, one line for each kind, as Markdown."""
    from robot_energy.inputs.meter.kinds import METER_KINDS, OTHER
    from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
    from robot_energy.model.drive_models import DRIVE_MODELS
    from robot_energy.model.friction_laws import FRICTION_LAWS
    from robot_energy.presets import ROBOTS
    from robot_energy_logs.log_formats import LOG_FORMATS

    parts = [
        _table(
            "Drive models",
            ("`drive`", "entry of each joint", "identified", "meaning"),
            (
                (f"`{k.name}`", f"`{k.key}`" if k.key else "", _yes(k.fitted), k.line)
                for k in DRIVE_MODELS.values()
            ),
        ),
        _table(
            "Friction laws",
            ("`law`", "follows temperature", "identified", "meaning"),
            (
                (f"`{k.name}`", _yes(k.follows_temperature), _yes(k.fit), k.line)
                for k in FRICTION_LAWS.values()
            ),
        ),
        _table("Meters", ("`type`", "meaning"), _lines((*METER_KINDS.values(), OTHER))),
        _table("Temperature sources", ("`type`", "meaning"), _lines(TEMPERATURE_KINDS.values())),
        _table("Log formats", ("`robot-energy import`", "meaning"), _lines(LOG_FORMATS.values())),
        _table(
            "Robots",
            ("`--robot`", "shipped model", "robot, driver"),
            (
                (f"`{k.name}`", f"`{k.model}`" if k.model else "", f"{k.label}: {k.line}")
                for k in ROBOTS.values()
            ),
        ),
    ]
    return "\n".join(parts)


def _lines(kinds: Iterable[Kind]) -> Iterable[tuple[str, str]]:
    return ((f"`{kind.name}`", kind.line) for kind in kinds)


def _yes(part: object) -> str:
    return "yes" if part else "no"


def _table(title: str, heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return f"### {title}\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)


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
