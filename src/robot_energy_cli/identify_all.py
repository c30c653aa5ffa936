r"""`robot-energy identify all`: everything the recordings allow, with one report.

Identify everything that the recordings allow, in this order: bodies and rotors from measured
torque, friction over temperature, constant losses of the cabinet, losses of the drives, energy
that the DC link stores, thermal networks of the motors. Other parameters keep the values of the
model, and a sentence says what to record for them. Then the energy of the old and the new model
is compared with the meter on recordings that the fit has not seen: whole recordings in turn, or
those of --test.

examples:
  robot-energy identify all cold warm hot --model my_robot.yaml --effort motor_torque \
      --out identified.yaml --report report.html
  robot-energy identify all cold warm hot --test another_day --model my_robot.yaml \
      --effort motor_current --drive-power /drive_power --out identified.yaml
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import ModelFileError
from robot_energy_cli.command import Command, Options, flags, keywords_of
from robot_energy_cli.identify_inputs import (
    LINK_VOLTAGES,
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import present, progress
from robot_energy_identify.options import OF_DRIVES, SUBJECTS, IdentifyOptions

OPTIONS: Options = {
    **bag_options(
        effort="what the effort in the joint states means; without it neither bodies nor "
        "friction can be identified"
    ),
    **flags(IdentifyOptions, "test", OF_DRIVES, "skip"),
    "--no-test": "do not test the energy on held-out recordings",
    "--details": "print tables and notes of every step",
    **LINK_VOLTAGES,
    **flags(IdentifyOptions, "share_shape"),
    **SENSOR_OPTIONS,
    **result_options("all that was identified"),
}


def _run(args: Namespace) -> int:
    from robot_energy_identify.api.identify import identify_all
    from robot_energy_report.identify_all import identification_lead

    IdentifyInputs(args).check_results()
    _check(args)
    options: dict[str, Any] = keywords_of(identify_all, args) | {
        "held_out": not args.no_test,
        "link_voltages": IdentifyInputs(args).link_voltages(),
        "sensors": IdentifyInputs(args).sensor_limits(),
        "progress": progress,
    }
    result = identify_all(args.bags, args.model, args.effort, **options)
    found = result.found
    title, lead = f"Identification of {result.model.robot.type}", identification_lead(found)
    present(args, found, title, lead, model=result.model, details=args.details)
    return 0


def _check(args: Namespace) -> None:
    from robot_energy_identify.provenance import require_distinct

    IdentifyInputs(args).drive_power()
    if args.test and args.no_test:
        raise ModelFileError("--test and --no-test exclude each other", "one of them")
    if set(args.skip) == set(SUBJECTS):
        raise ModelFileError("--skip leaves nothing to identify", "fewer subjects")
    require_distinct([Path(bag) for bag in args.bags], [Path(bag) for bag in args.test])


COMMAND = Command.of(__doc__, _run, OPTIONS)
