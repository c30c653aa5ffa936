"""`robot-energy identify cabinet`: constant losses from measured power."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from typing import Any

from robot_energy.cli.identify_inputs import (
    add_bags,
    add_results,
    check_results,
    present,
    read_recordings,
    source_of,
)

DESCRIPTION = """\
Identify the constant losses of the cabinet from recordings with a power meter (paper A,
section II-A): while nothing moves the meter shows the sum of both sides, while the robot
brakes hard it shows the grid side alone. Both phases are found by themselves.

Record at least ten seconds of rest with active drives, and fast motions.
"""
EPILOG = """\
example:
  robot-energy identify cabinet bag --model kr16 --out my_robot.yaml
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "cabinet",
        help="constant losses of the grid side and the DC side",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    add_bags(parser, effort="")
    add_results(parser, "these losses")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Identify and report.

    Raises:
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.identify.cabinet import fit_cabinet, with_cabinet
    from robot_energy.model_file import load, save
    from robot_energy.report.identification import cabinet_summary, print_cabinet

    check_results(args)
    model = load(args.model)
    fit = fit_cabinet(read_recordings(args, model))
    summary = cabinet_summary(fit)
    if args.out is not None:
        save(with_cabinet(model, fit, source_of(args)), args.out)
    present(
        args,
        f"Cabinet of {model.robot.type}",
        summary,
        lambda page: print_cabinet(summary, page),
        lead=f"Constant losses identified from {source_of(args)}.",
    )
    return 0
