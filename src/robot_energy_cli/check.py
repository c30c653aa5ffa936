"""`robot-energy check`: does a recording fit a model, and what is wrong if not.

Check recordings against a model: units, order, sign and zero of every joint, scale and meaning of
the torque, gear ratios, payload, meter, temperatures, noise at rest, and what could be
identified. Each finding has its size and the setting that corrects it, tried on the recording.
Causes that explain a recording equally well are listed together; the recording does not decide
between them. Several recordings of one
robot are judged together.

examples:
  robot-energy check bag --model kr16 --effort motor_torque
  robot-energy check monday tuesday --model my_robot.yaml --inputs energy_monitor.yaml --json c.json

exit codes: 0 no mistake found; 2 a mistake found, or input refused
"""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

from robot_energy_cli.command import Command
from robot_energy_cli.identify_inputs import IdentifyInputs, bag_options
from robot_energy_cli.replay_arguments import model_named
from robot_energy_cli.terminal import (
    JSON_OPTION,
    check_outputs,
    console,
    write_json,
    wrote,
)

if TYPE_CHECKING:
    from robot_energy_identify.check import CheckResult

MISTAKES = 2  # exit code: a recording does not fit
STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


def _run(args: Namespace) -> int:
    from robot_energy.model import load
    from robot_energy_identify.check import check_together
    from robot_energy_identify.check.finding import CheckReport

    named = model_named(args)
    check_outputs(args, [*args.bags, named, args.inputs])
    effort, inputs = IdentifyInputs(args).bags().meaning()
    model = load(named)
    results = check_together(args.bags, model, effort, inputs)
    if args.json != "-":
        for result in results:
            _show(result)
    if args.json is not None:
        write_json(args.json, CheckReport(results).to_dict())
    if args.json not in (None, "-"):
        wrote(console(), args.json, "all figures as JSON")
    return MISTAKES if any(result.errors for result in results) else 0


def _show(result: CheckResult) -> None:
    show = console().print
    errors = len(result.errors)
    show(f"{result.recording} with {result.model}", style="bold")
    if errors:
        show(f"{errors} mistake{'s' if errors > 1 else ''} found", style=STYLES["error"])
    else:
        show(f"no mistake found; checked: {', '.join(result.checked) or 'nothing'}")
    for finding in result.findings:
        show(f"{finding.severity}: {finding.sentence}", style=STYLES[finding.severity])
        if finding.remedy:
            place = f"   # {finding.remedy_in}{finding.option}" if finding.remedy_in else ""
            show(f"    remedy: {finding.remedy}{place}")
    for name, why in result.skipped.items():
        show(f"not checked: {name} ({why})", style=STYLES["note"])
    show("")


COMMAND = Command.of(__doc__, _run, {**bag_options(robot=True), **JSON_OPTION})
