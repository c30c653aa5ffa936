"""`robot-energy identify auxiliary`: power of each state of loads outside of the cabinet."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from robot_energy.cli.command import Command, add_option
from robot_energy.cli.identify_inputs import (
    add_bags,
    add_results,
    add_sensors,
    check_results,
    sensor_limits,
    source_of,
)
from robot_energy.cli.terminal import present, progress

DESCRIPTION = """\
Identify what pump, extruder and other loads outside of the cabinet draw in each of their
states. A load with a meter of its own needs its readings and its states. For the others the
recordings need a meter of the outlet that feeds cabinet and loads (--outlet-meter): while the
robot stands still, what changes with their states is theirs.

Let each load be in each state for some seconds, several times. For the meter of the outlet,
switch them on their own and not together, while the robot stands with active drives.
"""
EPILOG = """\
example:
  robot-energy identify auxiliary cell --model cell.yaml --out identified.yaml
"""


def _options(parser: ArgumentParser) -> None:
    add_bags(parser, effort="")
    add_option(
        parser,
        "--outlet-meter",
        "the power meter of the recordings sits at the outlet of the cell: it sees the "
        "cabinet and all loads",
    )
    add_sensors(parser)
    add_results(parser, "these powers")


def _run(args: Namespace) -> int:
    from robot_energy.api.identify import identify_auxiliary
    from robot_energy.report.document import Document
    from robot_energy.report.identification import states_document

    check_results(args)
    result = identify_auxiliary(
        args.bags,
        args.model,
        outlet_meter=args.outlet_meter,
        inputs=args.inputs,
        sensors=sensor_limits(args),
        progress=progress,
    )
    page = Document(
        f"Loads of the cell of {result.model.robot.type}",
        f"Powers of their states identified from {source_of(args)}.",
    )
    states_document(result.found, page)
    present(args, result.found, page, model=result.model)
    return 0


COMMAND = Command(
    "auxiliary",
    "power of the states of loads outside of the cabinet",
    _run,
    _options,
    DESCRIPTION,
    EPILOG,
)
