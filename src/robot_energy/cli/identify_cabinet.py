"""`robot-energy identify cabinet`: constant losses and DC link from measured power."""

from __future__ import annotations

from argparse import Namespace

from robot_energy.cli.command import Command, Options
from robot_energy.cli.identify_inputs import (
    LINK_VOLTAGES,
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy.cli.terminal import present

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


def _run(args: Namespace) -> int:
    from robot_energy.api.identify import identify_cabinet
    from robot_energy.report.document import Document
    from robot_energy.report.identification import cabinet_document

    given = IdentifyInputs(args)
    given.check_results()
    result = identify_cabinet(given.bags(), args.model, link_voltages=given.link_voltages())
    page = Document(
        f"Cabinet of {result.model.robot.type}",
        f"Constant losses and DC link identified from {given.names()}.",
    )
    cabinet_document(result.found, page)
    present(args, result.found, page, model=result.model)
    return 0


OPTIONS: Options = {
    **bag_options(effort=""),
    **LINK_VOLTAGES,
    **SENSOR_OPTIONS,
    **result_options("these figures"),
}
COMMAND = Command(
    "cabinet",
    "constant losses of the grid side and the DC side, energy of the DC link",
    _run,
    OPTIONS,
    DESCRIPTION,
    EPILOG,
)
