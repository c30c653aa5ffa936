"""`robot-energy identify auxiliary`: power of each state of loads outside of the cabinet."""

from __future__ import annotations

from argparse import Namespace

from robot_energy.cli.command import Command, Options
from robot_energy.cli.identify_inputs import (
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy.cli.terminal import present

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


def _run(args: Namespace) -> int:
    from robot_energy.api.identify import identify_auxiliary
    from robot_energy.report.document import Document
    from robot_energy.report.identification import states_document

    given = IdentifyInputs(args)
    given.check_results()
    result = identify_auxiliary(given.bags(), args.model, outlet_meter=args.outlet_meter)
    page = Document(
        f"Loads of the cell of {result.model.robot.type}",
        f"Powers of their states identified from {given.names()}.",
    )
    states_document(result.found, page)
    present(args, result.found, page, model=result.model)
    return 0


OPTIONS: Options = {
    **bag_options(effort=""),
    "--outlet-meter": "the power meter of the recordings sits at the outlet of the cell: it sees "
    "the cabinet and all loads",
    **SENSOR_OPTIONS,
    **result_options("these powers"),
}
COMMAND = Command(
    "auxiliary",
    "power of the states of loads outside of the cabinet",
    _run,
    OPTIONS,
    DESCRIPTION,
    EPILOG,
)
