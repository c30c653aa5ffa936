r"""`robot-energy identify thermal`: motor temperatures from losses.

Identify the heat capacity and the time constants of every motor from recordings with motor
temperatures. The heat is that of the model's own losses, so identify friction and drives first.
With them the monitor estimates a motor temperature where no sensor measures it, or the sensor
is stuck.

Record from a cold start, for hours, with work and rest. A free run from the first reading is
compared with the readings that follow; the error stated is on what the fit has not seen.

examples:
  robot-energy identify thermal monday tuesday --model my_robot.yaml --ambient 21 \
      --out my_robot_thermal.yaml
  robot-energy identify thermal --log dataset.csv --mapping ur3_cobotops.yaml
"""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace
from typing import TYPE_CHECKING

from robot_energy_cli.command import Command, Options, number
from robot_energy_cli.identify_inputs import LOG, IdentifyInputs, bag_options, result_options
from robot_energy_cli.terminal import present

if TYPE_CHECKING:
    from robot_energy_identify.friction_and_thermal import ThermalReport


def _degc(text: str) -> float:
    value = float(number(text))
    if not -40.0 <= value <= 60.0:
        raise ArgumentTypeError(f"{value:g} degC is not the air that a robot works in")
    return value


def _run(args: Namespace) -> int:
    given = IdentifyInputs(args)
    given.check_results()
    given.check_source(relative="the heat of a log is relative and makes no model file")
    model = None
    if args.log:
        report = _of_log(given, args.ambient)
    else:
        from robot_energy_identify.api.identify import identify_thermal

        result = identify_thermal(given.bags(), args.model, ambient_degc=args.ambient)
        report, model = result.found, result.model
    title, lead = "Thermal networks of the motors", f"Identified from {given.names()}."
    present(args, report, title, lead, model=model, notes=given.log_notes)
    return 0


def _of_log(given: IdentifyInputs, ambient_degc: float | None) -> ThermalReport:
    from robot_energy_identify.friction_and_thermal import ThermalReport
    from robot_energy_identify.thermal.network import fit_networks, runs_of_log

    parts, names = given.columns_of_log()
    runs = [runs_of_log(parts, joint) for joint in range(len(names))]
    ambient, fits, refused = fit_networks(names, runs, ambient_degc)
    return ThermalReport("squared_current", ambient, tuple(fits), tuple(refused))


OPTIONS: Options = {
    **bag_options(required=False, effort=""),
    "--ambient DEGC": (
        "temperature of the air around the robot [degC] (default: the coldest first reading "
        "of all motors)",
        {"type": _degc},
    ),
    **result_options("these networks"),
    "from a log with motor currents, without a model": LOG,
}
COMMAND = Command.of(__doc__, _run, OPTIONS)
