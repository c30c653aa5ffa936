"""`robot-energy models`: list shipped models, check a model file."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from robot_energy.cli.terminal import add_debug, check_outputs, console, write_json


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "models",
        aliases=["model"],
        help="list the shipped models; check a model file",
        description="List the models that come with the tool, or check one (models check).",
    )
    add_debug(parser)
    parser.set_defaults(run=run_list)
    actions = parser.add_subparsers(title="actions", metavar="ACTION")
    listing: ArgumentParser = actions.add_parser("list", help="list shipped models (default)")
    listing.set_defaults(run=run_list)
    check: ArgumentParser = actions.add_parser(
        "check",
        help="validate a model file and print what it models",
        description="Validate a model file with its URDF and print what is modelled, and how "
        "many of its figures are published, identified, derived or assumed.",
    )
    check.add_argument("model", metavar="FILE|NAME", help="model file, or name of a shipped one")
    check.add_argument("--json", metavar="FILE", help="write it as JSON; - for standard output")
    check.set_defaults(run=run_check)
    add_debug(check)


def run_list(args: Namespace) -> int:
    """List the shipped models.

    Raises:
        RobotEnergyError: If a shipped model is broken.
    """
    from robot_energy.model import load, shipped_models
    from robot_energy.report.model_summary import count_tags

    out = console()
    for name, path in shipped_models().items():
        model = load(path)
        tags = ", ".join(f"{n} {tag}" for tag, n in count_tags(model).items() if n)
        out.print(
            f"{name:<8} {model.robot.type}; {len(model.joints)} joints; figures: {tags}",
            soft_wrap=True,
        )
    return 0


def run_check(args: Namespace) -> int:
    """Validate a model and print what it holds.

    Raises:
        RobotEnergyError: If the file or its URDF cannot be used.
    """
    from robot_energy.model import load
    from robot_energy.physics.rigid_body import Robot
    from robot_energy.report import summarise_model
    from robot_energy.report.listings import print_model

    check_outputs(args, [args.model])
    model = load(args.model)
    summary = summarise_model(model, Robot.from_model(model))
    if args.json != "-":
        print_model(summary, console())
    if args.json is not None:
        write_json(args.json, summary)
    return 0
