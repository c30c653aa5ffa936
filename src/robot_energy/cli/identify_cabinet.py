"""`robot-energy identify cabinet`: constant losses and DC link from measured power."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy.cli.identify_inputs import (
    add_bags,
    add_link_voltages,
    add_results,
    add_sensors,
    check_results,
    link_voltages,
    sensor_limits,
    source_of,
)
from robot_energy.cli.terminal import add_command, present, progress

DESCRIPTION = """\
Identify the constant losses of the cabinet from recordings with a power meter (paper A,
section II-A): while nothing moves, the meter shows the sum of both sides; while the
robot brakes hard, it shows the grid side alone. The command finds both phases, rest by the
noise of the velocities. After hard braking the DC link feeds the drives; how much energy it
stores is found from that, with an interval, and taken if held-out readings are predicted
better with it.

Record at least ten seconds of rest with active drives, and fast motions that stop hard.
Identify the drives first (or use `identify all`): drive losses that the model lacks can hide
the effect of the DC link.
"""
EPILOG = """\
example:
  robot-energy identify cabinet bag --model kr16 --out my_robot.yaml
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: Sub-parsers of ``identify``.
    """
    text = "constant losses of the grid side and the DC side, energy of the DC link"
    parser = add_command(commands, "cabinet", run, text, DESCRIPTION, EPILOG)
    add_bags(parser, effort="")
    add_link_voltages(parser)
    add_sensors(parser)
    add_results(parser, "these figures")


def run(args: Namespace) -> int:
    """Identify and report.

    Args:
        args: Of the command.

    Returns:
        Exit code 0.

    Raises:
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.api.identify import identify_cabinet
    from robot_energy.report.document import Document
    from robot_energy.report.identification import cabinet_document

    check_results(args)
    result = identify_cabinet(
        args.bags,
        args.model,
        link_voltages=link_voltages(args),
        inputs=args.inputs,
        sensors=sensor_limits(args),
        progress=progress,
    )
    page = Document(
        f"Cabinet of {result.model.robot.type}",
        f"Constant losses and DC link identified from {source_of(args)}.",
    )
    cabinet_document(result.found, page)
    present(args, result.found, page, model=result.model)
    return 0
