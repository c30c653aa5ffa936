"""Commands `robot-energy identify cabinet` and `auxiliary`: what power meters determine."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from robot_energy_cli.command import Command, Options
from robot_energy_cli.identify_inputs import (
    LINK_VOLTAGES,
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import present

if TYPE_CHECKING:
    from robot_energy_identify.api.identify import IdentificationResult


def _cabinet(args: Namespace) -> int:
    """`robot-energy identify cabinet`: constant losses of grid and DC side, energy of the DC link.

    Identify the constant losses of the cabinet from recordings with a power meter (paper A, section
    II-A): while nothing moves, the meter shows the sum of both sides; while the robot brakes hard,
    it shows the grid side alone. The command finds both phases, rest by the noise of the
    velocities. After hard braking the DC link feeds the drives; how much energy it stores is found
    from that, with an interval, and taken if held-out readings are predicted better with it. A fan
    of the cabinet that starts while the robot warms up is found by the step in the power at rest,
    one that runs in warm recordings alone by the levels of their power.

    Record at least ten seconds of rest with active drives, and fast motions that stop hard; for the
    fan a warm-up with pauses and motor temperatures. Identify the drives first (or use `identify
    all`): drive losses that the model lacks can hide the effect of the DC link.

    example:
      robot-energy identify cabinet bag --model kr16 --out my_robot.yaml
    """
    from robot_energy_identify.api.identify import identify_cabinet

    given = IdentifyInputs(args)
    given.check_results()
    result = identify_cabinet(given.bags(), args.model, link_voltages=given.link_voltages())
    return _present(given, result, "Cabinet", "Constant losses and DC link")


def _auxiliary(args: Namespace) -> int:
    """`robot-energy identify auxiliary`: power of the states of loads outside of the cabinet.

    Identify what pump, extruder and other loads outside of the cabinet draw in each of their
    states. A load with a meter of its own needs its readings and its states. For the others the
    recordings need a meter of the outlet that feeds cabinet and loads (--outlet-meter): while the
    robot stands still, what changes with their states is theirs.

    Let each load be in each state for some seconds, several times. For the meter of the outlet,
    switch them on their own and not together, while the robot stands with active drives.

    example:
      robot-energy identify auxiliary cell --model cell.yaml --out identified.yaml
    """
    from robot_energy_identify.api.identify import identify_auxiliary

    given = IdentifyInputs(args)
    given.check_results()
    result = identify_auxiliary(given.bags(), args.model, outlet_meter=args.outlet_meter)
    return _present(given, result, "Loads of the cell", "Powers of their states")


def _present(
    given: IdentifyInputs, result: IdentificationResult[Any], whose: str, what: str
) -> int:
    title = f"{whose} of {result.model.robot.type}"
    lead = f"{what} identified from {given.names()}."
    present(given.args, result.found, title, lead, model=result.model)
    return 0


CABINET_OPTIONS: Options = {
    **bag_options(effort=""),
    **LINK_VOLTAGES,
    **SENSOR_OPTIONS,
    **result_options("these figures"),
}
CABINET = Command.of(_cabinet.__doc__, _cabinet, CABINET_OPTIONS)
AUXILIARY_OPTIONS: Options = {
    **bag_options(effort=""),
    "--outlet-meter": "the power meter of the recordings sits at the outlet of the cell: it sees "
    "the cabinet and all loads",
    **SENSOR_OPTIONS,
    **result_options("these powers"),
}
AUXILIARY = Command.of(_auxiliary.__doc__, _auxiliary, AUXILIARY_OPTIONS)
