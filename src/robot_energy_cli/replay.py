"""The command `robot-energy replay`."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import PageError, ReportError
from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy.replay.options import OUTPUTS as WRITTEN
from robot_energy.replay.options import ReplayOptions
from robot_energy_cli.command import Command, Options, flags
from robot_energy_cli.replay_arguments import (
    BAG,
    DAMAGED,
    PAGE,
    model_named,
    options_given,
    replay_options,
)
from robot_energy_cli.terminal import (
    JSON_OPTION,
    check_bag,
    check_outputs,
    present,
    progress,
)

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy.pipeline import Output
    from robot_energy.replay.bag_replay import Replay
    from robot_energy.results.replay import ReplayReport
    from robot_energy_report.page.recording import RecordedPage

CHECKED_TIME = 600.0  # s of a recording
DIFFERENCE = 0.03  # of shaft energies, over measured out + back: more has a cause


OPTIONS: Options = {
    "bag": BAG,
    **flags(ReplayOptions, "processes"),
    "outputs": {
        **flags(ReplayOptions, WRITTEN),
        **JSON_OPTION,
        "--plot FILE": "draw power and energy over time (.png, .svg, .pdf)",
        "--report FILE": "write tables and figures as one file: .html, or .pdf where a Chromium "
        "is installed",
    },
    "energy page": PAGE,
    **flags(ReplayOptions, "jobs"),
    **replay_options(
        "",
        "run a second time with friction fixed at this temperature (default: the model's "
        "fallback temperature) and compare both",
    ),
}


def _run(args: Namespace) -> int:
    """`robot-energy replay`: where the energy of a recorded bag went.

    Run a recorded bag through the model of its robot and print where the energy went: predicted and
    measured over the same time, per joint, per loss and per phase, and which samples were rejected
    for which reason.

    Topics are found by their type: sensor_msgs/JointState, MotorTemperatures or
    sensor_msgs/Temperature (frame_id = joint), PowerReading. If there are several of one type, name
    the one to use. Describe other types in the parameter file of the monitor (--inputs).

    examples:
      robot-energy replay bag --model kr16
      robot-energy replay bag --model my_robot.yaml --out bag_energy --json energy.json
      robot-energy replay bag --robot ur5e --compare --plot power.png --report page.html
      robot-energy replay bag --model ur3e --compare 20 --temperatures /driver/temperatures
      robot-energy replay bag --model my_robot.yaml --inputs energy_monitor.yaml
      robot-energy replay bag --model kr16 --effort motor_torque
      robot-energy replay bag --model kr16 --serve
      robot-energy replay long_bag --model kr16 --processes 2
      robot-energy replay bag --robot fr3 --model my_fr3.yaml --json - | jq .comparison
    """
    from robot_energy.foundation.files.placement import all_or_none
    from robot_energy.replay.api import fixed_friction
    from robot_energy.results.replay import replay_report
    from robot_energy_report.replay import ReplayCurves
    from robot_energy_report.replay_figures import TemperatureHistory, curves_of

    inputs = [args.bag, model_named(args), args.inputs, args.jobs, args.page_settings]
    check_outputs(args, inputs)
    if args.out is not None:
        check_bag(args.out, args.overwrite, inputs, (args.json, args.plot, args.report))
    if args.page_settings is not None and not args.serve and args.report is None:
        raise PageError("--page-settings was given alone", "--serve or --report FILE")
    if args.port is not None and not args.serve:
        raise PageError("--port was given without --serve", "--serve --port N")
    model, change = model_given(args)
    settings = None
    if args.page_settings is not None or args.serve:
        from robot_energy_report.page.settings import load_settings

        settings = load_settings(args.page_settings or "")
    written = {"out": args.out, "overwrite": args.overwrite}
    temperatures = TemperatureHistory(model.joint_names)
    take, page = [temperatures.take], None
    if settings is not None and args.serve:
        from robot_energy_report.page.recording import RecordedPage

        page = RecordedPage(Path(args.bag).name, model, settings)
        take.append(page.take)
        if args.power_period is None and args.out is None:
            written["power_period"] = page.period
    kept = args.plot is not None or args.report is not None
    with all_or_none():
        results = [replayed(args, args.bag, model, take, kept, written)]
        changes, second = [change], None
        if args.compare is not None:
            other, changed = fixed_friction(model, args.compare)
            results.append(replayed(args, args.bag, other, (), kept, {}))
            changes.append(changed)
            second = replay_report(results[1], changed)
        report = _explained(args, replay_report(results[0], change, second), model)
        curves = None
        if args.report is not None:
            curves = ReplayCurves(curves_of(results, changes), temperatures)
        present(
            args,
            report,
            f"Where the energy went: {report.model.robot}",
            made="bag",
            plot=lambda path: _plot(path, results, changes),
            curves=curves,
            settings=settings,
        )
    if page is not None:
        page.finish(results[0])
        _serve(args, page)
    return DAMAGED if results[0].problems else 0


def model_given(args: Namespace) -> tuple[RobotModel, str | None]:
    """The model, and how its friction was changed."""
    from robot_energy.model import load
    from robot_energy.replay.api import fixed_friction

    model = load(model_named(args))
    fixed = args.fixed_friction
    return (model, None) if fixed is None else fixed_friction(model, fixed)


def replayed(
    args: Namespace,
    bag: str,
    model: RobotModel,
    take: Sequence[Callable[[Output], None]],
    curves: bool,
    written: dict[str, Any],
) -> Replay:
    """Return the replay of a bag with what was typed; each output goes to all of ``take``."""
    from robot_energy.replay.bag_replay import replay
    from robot_energy.replay.setup import ReplaySetup

    def take_all(output: Output) -> None:
        for one in take:
            one(output)

    keep_freed_memory()
    label = f"replaying {Path(bag).name}" if take else "with fixed friction"
    with progress(label) as show:
        setup = ReplaySetup.of(options_given(args) | written | {"progress": show})
        return replay(bag, model, setup, on_output=take_all, keep_curves=curves)


def _explained(args: Namespace, report: ReplayReport, model: RobotModel) -> ReplayReport:
    """Add the mistakes that `check` finds, where measured shaft energies say that something is off.

    The first ten minutes are read again for it, but not where topics were named one by one.
    """
    if not _shafts_differ(report) or any((args.joint_states, args.meter, args.payload)):
        return report
    from robot_energy.bag.reader import TimeRange
    from robot_energy.replay.setup import driver_inputs, effort_meaning
    from robot_energy_identify.check import check

    assert report.shaft is not None
    inputs, _ = driver_inputs(args.inputs, args.robot)
    part = TimeRange(args.start, args.end) or TimeRange(None, CHECKED_TIME)
    effort = effort_meaning(report.shaft.effort)
    found = [
        f"what check finds: {one.sentence}" + (f"; remedy: {one.remedy}" if one.remedy else "")
        for one in check(args.bag, model, effort, inputs, part).errors
    ]
    return replace(report, notes=(*report.notes, *found))


def _shafts_differ(report: ReplayReport) -> bool:
    """Whether shaft energies given and taken back are off by more than noise and friction make."""
    error = measured = 0.0
    for joint in () if report.shaft is None else report.shaft.joints:
        for way in ("positive", "negative"):
            known, predicted = (
                getattr(joint, f"shaft_energy_{way}_{kind}") for kind in ("measured", "compared")
            )
            if known is not None and predicted is not None:
                error, measured = error + abs(predicted - known), measured + abs(known)
    return error > DIFFERENCE * measured


def _serve(args: Namespace, page: RecordedPage) -> None:
    from robot_energy_report.page.access import page_access
    from robot_energy_report.page.web_server import PageServer

    access = page_access(port=int(args.port or 0))
    server = PageServer(page.hub, access)
    try:
        for sentence in access.sentences(server.url):
            print(sentence, flush=True)
        while True:
            time.sleep(3600.0)
    finally:
        server.close()


def _plot(path: str, results: list[Replay], changes: list[str | None]) -> None:
    from robot_energy.timeline.blocks import MeterLocation
    from robot_energy_report.replay_figures import curves_of, power_and_energy

    first = results[0]
    curves = curves_of(results, changes)
    if not curves:
        raise ReportError(f"{first.bag} gave no two samples in a row", "something to plot")
    measured = curves[0].role == "measured"
    at_bus = measured and first.account.comparison.location is MeterLocation.DC_BUS
    title = f"{first.model.robot.type}, model {first.model.model_id}, {Path(first.bag).name}"
    if first.origin:
        title = f"{title}\n{first.origin}"
    power_and_energy(curves, path, title, "the DC bus" if at_bus else "the grid")


COMMAND = Command.of(_run.__doc__, _run, OPTIONS)
