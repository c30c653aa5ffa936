"""`robot-energy report`: one page about recorded bags, or about the JSON of a result.

Write one report, a single HTML or PDF file: where the energy went, predicted against measured,
joints, temperatures and friction, phases, data quality, model. From recorded bags with the model
of their robot; or from the JSON of `replay` or `predict`, then without figures over time.
Several recordings come in order of time: totals, one row each, and how error and power change.
For robots with models of their own, give the JSON that `replay` wrote for each.

examples:
  robot-energy report bag --model kr16 --out page.html
  robot-energy report cold warm hot --model kr16 --out page.html
  robot-energy report monday tuesday --model kr16 --page-settings prices.yaml --out week.pdf
  robot-energy report left.json right.json --out page.html
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy.replay.options import ReplayOptions
from robot_energy_cli.command import LIST, REQUIRED, Command, Options, flags
from robot_energy_cli.replay_arguments import (
    BAG,
    DAMAGED,
    PAGE_SETTINGS,
    model_named,
    options_given,
    replay_options,
)
from robot_energy_cli.terminal import check_report, console, progress, sign, wrote

if TYPE_CHECKING:
    from robot_energy.results.replay import ReplayReport
    from robot_energy_report.replay import ReplayCurves


OPTIONS: Options = {
    "source BAG|JSON": (f"{BAG}; or a JSON file", LIST),
    "--out FILE": ("the report: .html, or .pdf where a Chromium is installed", REQUIRED),
    **replay_options(),
    **PAGE_SETTINGS,
    **flags(ReplayOptions, "jobs"),
}


def _run(args: Namespace) -> int:
    from robot_energy_cli.result_schema import read_result
    from robot_energy_plan.results.prediction import PredictionsReport
    from robot_energy_report.document import Document
    from robot_energy_report.headline import headline
    from robot_energy_report.html import write_page
    from robot_energy_report.page.settings import load_settings
    from robot_energy_report.prediction import prediction_document
    from robot_energy_report.recordings import recordings_document

    names = (args.model, args.inputs, args.jobs, args.page_settings)
    given = [*args.source, *filter(None, names)]
    check_report(args.out, given)
    settings = load_settings(args.page_settings or "")
    damaged = False
    replays: list[tuple[ReplayReport, ReplayCurves | None]] = []
    page = Document("Where the energy went")
    for source in args.source:
        if not source.lower().endswith(".json"):
            report, curves, is_damaged = _replayed(args, source)
            damaged = damaged or is_damaged
            replays.append((report, curves))
            continue
        result = read_result(source)
        if isinstance(result, PredictionsReport):
            page.title = "Predicted energy"
            prediction_document(result, page)
        else:
            replays.append((result, None))
    if replays:
        robots = sorted({report.model.robot for report, _ in replays})
        page.title = f"Where the energy went: {', '.join(robots)}"
        recordings_document(replays, page, settings)
    sign(args, page)
    write_page(page, args.out)
    out = console()
    for report, _ in replays:
        out.print(f"{report.bag}: {headline(report)}")
    wrote(out, args.out, "report")
    return DAMAGED if damaged else 0


def _replayed(args: Namespace, bag: str) -> tuple[ReplayReport, ReplayCurves, bool]:
    from robot_energy.model import load
    from robot_energy.replay.api import fixed_friction
    from robot_energy.replay.bag_replay import replay
    from robot_energy.replay.setup import ReplaySetup
    from robot_energy.results.replay import replay_report
    from robot_energy_report.replay import ReplayCurves
    from robot_energy_report.replay_figures import TemperatureHistory, curves_of

    model, change = load(model_named(args)), None
    if args.fixed_friction is not None:
        model, change = fixed_friction(model, args.fixed_friction)
    keep_freed_memory()
    temperatures = TemperatureHistory(model.joint_names)
    with progress(f"replaying {Path(bag).name}") as show:
        setup = ReplaySetup.of(options_given(args) | {"progress": show})
        result = replay(bag, model, setup, on_output=temperatures.take, keep_curves=True)
    curves = ReplayCurves(curves_of([result], [change]), temperatures)
    return replay_report(result, change), curves, bool(result.problems)


COMMAND = Command.of(__doc__, _run, OPTIONS)
