"""The command `robot-energy report`: one page about recordings."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

from robot_energy.replay.options import ReplayOptions
from robot_energy_cli.command import LIST, REQUIRED, Command, Options, flags
from robot_energy_cli.replay import model_given, replayed
from robot_energy_cli.replay_arguments import BAG, DAMAGED, PAGE_SETTINGS, replay_options
from robot_energy_cli.terminal import check_report, console, sign, wrote

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
    """`robot-energy report`: one page about recorded bags, or about the JSON of a result.

    Write one report, a single HTML or PDF file: where the energy went, predicted against measured,
    joints, temperatures and friction, phases, data quality, model. From recorded bags with the
    model of their robot; or from the JSON of `replay` or `predict`, then without figures over time.
    Several recordings come in order of time: totals, one row each, and how error and power change.
    For robots with models of their own, give the JSON that `replay` wrote for each.

    examples:
      robot-energy report bag --model kr16 --out page.html
      robot-energy report cold warm hot --model kr16 --out page.html
      robot-energy report monday tuesday --model kr16 --page-settings prices.yaml --out week.pdf
      robot-energy report left.json right.json --out page.html
    """
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
    replays: list[tuple[ReplayReport, ReplayCurves | None]] = []
    damage: list[str] = []
    page = Document("Where the energy went")
    for source in args.source:
        if not source.lower().endswith(".json"):
            report, curves, problems = _curves(args, source)
            replays.append((report, curves))
            damage += problems
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
    return DAMAGED if damage else 0


def _curves(args: Namespace, bag: str) -> tuple[ReplayReport, ReplayCurves, list[str]]:
    from robot_energy.results.replay import replay_report
    from robot_energy_report.replay import ReplayCurves
    from robot_energy_report.replay_figures import TemperatureHistory, curves_of

    model, change = model_given(args)
    temperatures = TemperatureHistory(model.joint_names)
    result = replayed(args, bag, model, [temperatures.take], True, {})
    curves = ReplayCurves(curves_of([result], [change]), temperatures)
    return replay_report(result, change), curves, result.problems


COMMAND = Command.of(_run.__doc__, _run, OPTIONS)
