"""`robot-energy identify cabinet`: constant losses from measured power."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.terminal import add_debug, check_writable, console, progress, write_text

if TYPE_CHECKING:
    from robot_energy.identify.recordings import Recording

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
    parser.add_argument("bags", nargs="+", metavar="BAG", help="recordings of one robot")
    parser.add_argument("--model", required=True, metavar="FILE|NAME", help="model of the robot")
    parser.add_argument("--out", metavar="FILE", help="write the model with these losses")
    parser.add_argument("--json", metavar="FILE", help="write all figures as JSON; - for stdout")
    add_debug(parser)
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Identify and report.

    Raises:
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.identify.cabinet import fit_cabinet, with_cabinet
    from robot_energy.identify.recordings import read_recording
    from robot_energy.model_file import load, save
    from robot_energy.report.identification import cabinet_summary, print_cabinet

    check_writable(args.json, "the JSON report")
    check_writable(args.out, "the model file")
    model = load(args.model)
    recordings: list[Recording] = []
    for bag in args.bags:
        with progress(f"reading {Path(bag).name}") as report:
            recordings.append(read_recording(bag, model, progress=report))
    fit = fit_cabinet(recordings)
    summary = cabinet_summary(fit)
    if args.out is not None:
        save(with_cabinet(model, fit, ", ".join(Path(bag).name for bag in args.bags)), args.out)
    if args.json is not None:
        write_text(args.json, json.dumps(summary, indent=2, allow_nan=False) + "\n")
    if args.json != "-":
        print_cabinet(summary, console())
    return 0
