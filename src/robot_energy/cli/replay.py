"""`robot-energy replay`: run a bag through the model and say where its energy went."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.memory import keep_freed_memory
from robot_energy.cli.page import add_page, recorded_page, serve_page, write_page
from robot_energy.cli.replay_options import BAG, DAMAGED, PAGE_PERIOD, add_replay, options_of
from robot_energy.cli.robots import model_named
from robot_energy.cli.terminal import (
    add_command,
    add_json,
    check_bag,
    check_outputs,
    present,
    progress,
)
from robot_energy.errors import ReportError

if TYPE_CHECKING:
    from robot_energy.bag_replay import Replay
    from robot_energy.model import RobotModel
    from robot_energy.page.recording import RecordedPage
    from robot_energy.time_series import TimeSeries

DESCRIPTION = """\
Run a recorded bag through the model of its robot and print where the energy went:
predicted and measured over the same time, per joint, per loss and per phase, and which
samples were rejected for which reason.

Topics are found by their type: sensor_msgs/JointState, MotorTemperatures or
sensor_msgs/Temperature (frame_id = joint), PowerReading. If there are several of one type,
name the one to use. Describe other types in the parameter file of the monitor (--inputs).
"""
EPILOG = """\
examples:
  robot-energy replay bag --model kr16
  robot-energy replay bag --model my_robot.yaml --out bag_energy --json energy.json
  robot-energy replay bag --robot ur5e --compare --plot power.png --report page.html
  robot-energy replay bag --model ur3e --compare 20 --temperatures /driver/temperatures
  robot-energy replay bag --model my_robot.yaml --inputs energy_monitor.yaml
  robot-energy replay bag --model kr16 --effort motor_torque
  robot-energy replay bag --model kr16 --serve
  robot-energy replay bag --robot fr3 --model my_fr3.yaml --json - | jq .comparison
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    text = "where the energy of a recorded bag went"
    parser = add_command(commands, "replay", run, text, DESCRIPTION, EPILOG)
    parser.add_argument("bag", help=BAG)
    outputs = parser.add_argument_group("outputs")
    outputs.add_argument(
        "--out", metavar="BAG", help="write the energy topics (/energy/...) into a new bag"
    )
    outputs.add_argument("--overwrite", action="store_true", help="replace the bag of --out")
    add_json(outputs)
    outputs.add_argument(
        "--plot", metavar="FILE", help="draw power and energy over time (.png, .svg, .pdf)"
    )
    outputs.add_argument(
        "--report", metavar="FILE", help="write tables and figures as one HTML file"
    )
    add_page(parser)
    add_replay(
        parser,
        "averaging period of /energy/power (default 0.02 s)",
        "run a second time with friction fixed at this temperature (default: the model's "
        "fallback temperature) and set both side by side",
    )


def run(args: Namespace) -> int:
    """Replay and report.

    Args:
        args: Of the sub-command.

    Returns:
        0, or 3 if the bag is damaged and was read in part.

    Raises:
        RobotEnergyError: If model, bag or outputs cannot be used.
    """
    from robot_energy.api.replay import fixed_friction
    from robot_energy.files.placement import all_or_none
    from robot_energy.model import load
    from robot_energy.report.document import Document
    from robot_energy.report.replay import ReplayCurves, replay_document
    from robot_energy.report.series import curves_of
    from robot_energy.results.replay import replay_report

    named = model_named(args)
    inputs = [args.bag, named, args.inputs]
    check_outputs(args, inputs)
    if args.out is not None:
        check_bag(args.out, args.overwrite, inputs, (args.json, args.plot, args.report, args.page))
    model, change = load(named), None
    if args.fixed_friction is not None:
        model, change = fixed_friction(model, args.fixed_friction)
    recorded = recorded_page(args, model)
    runs = [(model, change)]
    if args.compare is not None:
        runs.append(fixed_friction(model, args.compare))
    with all_or_none():
        replayed = [
            _replay(
                args,
                used,
                "with fixed friction" if number else "replaying",
                not number,
                None if number else recorded,
            )
            for number, (used, _) in enumerate(runs)
        ]
        results, changes = [result for result, _ in replayed], [change for _, change in runs]
        second = replay_report(results[1], changes[1]) if len(runs) > 1 else None
        report = replay_report(results[0], change, second)
        page, curves = Document(f"Where the energy went: {report.model.robot}"), None
        table = replayed[0][1]
        if table is not None:
            curves = ReplayCurves(curves_of(results, changes), table)
        replay_document(report, page, curves)
        write_page(args, recorded, results[0])
        present(args, report, page, "bag", lambda path: _plot(path, results, changes))
    serve_page(args, recorded)
    return DAMAGED if results[0].problems else 0


def _replay(
    args: Namespace, model: RobotModel, label: str, writes: bool, page: RecordedPage | None
) -> tuple[Replay, TimeSeries | None]:
    """Replay; the table over time is for the report alone, and coarse where no bag is written."""
    from robot_energy.api.replay import replay_over_time, run_replay

    options = options_of(args)
    options |= {"out": args.out if writes else None, "overwrite": args.overwrite}
    reported, take = args.report is not None and writes, None if page is None else page.take
    period = args.power_period
    if period is None and args.out is None:
        period = page.period if page is not None else PAGE_PERIOD if reported else None
    keep_freed_memory()
    with progress(label) as show:
        options["progress"] = show
        if reported:
            return replay_over_time(
                args.bag, model, power_period=period, keep_curves=True, on_output=take, **options
            )
        curves = args.plot is not None or args.report is not None
        return run_replay(
            args.bag, model, power_period=period, keep_curves=curves, on_output=take, **options
        ), None


def _plot(path: str, results: list[Replay], changes: list[str | None]) -> None:
    from robot_energy.blocks import MeterLocation
    from robot_energy.report.power_figure import power_and_energy
    from robot_energy.report.series import curves_of

    first = results[0]
    curves = curves_of(results, changes)
    if not curves:
        raise ReportError(f"{first.bag} gave no two samples in a row", "something to plot")
    measured = curves[0].role == "measured"
    at_bus = measured and first.ledger.comparison.location is MeterLocation.DC_BUS
    title = f"{first.model.robot.type}, model {first.model.model_id}, {Path(first.bag).name}"
    if first.origin:
        title = f"{title}\n{first.origin}"
    power_and_energy(curves, path, title, "the DC bus" if at_bus else "the grid")
