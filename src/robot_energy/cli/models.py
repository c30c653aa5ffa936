"""`robot-energy models`: list shipped models, check a model file."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from robot_energy.cli.terminal import add_command, add_json, check_outputs, console, present


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "models",
        aliases=["model"],
        help="list the shipped models; check a model file",
        description="List the models that come with the tool, or check one (models check).",
    )
    parser.set_defaults(run=run_list)
    actions = parser.add_subparsers(title="actions", metavar="ACTION")
    listing: ArgumentParser = actions.add_parser("list", help="list shipped models (default)")
    listing.set_defaults(run=run_list)
    check = add_command(
        actions,
        "check",
        run_check,
        "validate a model file and print what it models",
        "Validate a model file with its URDF and print what is modelled, and how "
        "many of its figures are published, identified, derived or assumed.",
    )
    check.add_argument("model", metavar="FILE|NAME", help="model file, or name of a shipped one")
    add_json(check)


def run_list(args: Namespace) -> int:
    """List the shipped models.

    Raises:
        RobotEnergyError: If a shipped model is broken.
    """
    from robot_energy.model import load, shipped_models
    from robot_energy.report.formats import tags_text
    from robot_energy.results.model import count_tags

    out = console()
    for name, path in shipped_models().items():
        model = load(path)
        tags = tags_text(count_tags(model))
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
    from robot_energy.report.document import Document
    from robot_energy.report.model import model_document
    from robot_energy.results.model import model_report

    check_outputs(args, [args.model])
    model = load(args.model)
    report, page = model_report(model, Robot.from_model(model)), Document()
    model_document(report, page)
    present(args, report, page)
    return 0
