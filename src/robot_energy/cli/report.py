"""`robot-energy report`: one page about recordings, or about a result that was written before."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.memory import keep_freed_memory
from robot_energy.cli.replay_options import BAG, DAMAGED, PAGE_PERIOD, add_replay, options_of
from robot_energy.cli.robots import model_named
from robot_energy.cli.terminal import add_command, console, progress, sign, wrote
from robot_energy.files.output_files import HTML, check_file

if TYPE_CHECKING:
    from robot_energy.report.replay import ReplayCurves
    from robot_energy.results.replay import ReplayReport

DESCRIPTION = """\
Write one page, a single HTML file: where the energy went, predicted against measured, joints,
temperatures and friction, data quality. From recorded bags with the model of their robot; or
from the JSON of `replay` or `predict`, then without figures over time.
"""
EPILOG = """\
examples:
  robot-energy report bag --model kr16 --out page.html
  robot-energy report cold warm hot --model kr16 --out page.html
  robot-energy report energy.json --out page.html
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    text = "one page about recorded bags, or about the JSON of a result"
    parser = add_command(commands, "report", run, text, DESCRIPTION, EPILOG)
    parser.add_argument("source", nargs="+", metavar="BAG|JSON", help=f"{BAG}; or a JSON file")
    parser.add_argument("--out", required=True, metavar="FILE", help="the page: .html")
    add_replay(parser)


def run(args: Namespace) -> int:
    """Replay or read, and write the page.

    Args:
        args: Of the sub-command.

    Returns:
        0, or 3 if a bag is damaged and was read in part.

    Raises:
        RobotEnergyError: If a source, the model or the output cannot be used.
    """
    from robot_energy.report.document import Document
    from robot_energy.report.html import write_page
    from robot_energy.report.prediction import prediction_document
    from robot_energy.report.replay import headline, replays_document
    from robot_energy.results.prediction import PredictionsReport
    from robot_energy.results.schema import read_result

    given = [*args.source, *(name for name in (args.model, args.inputs) if name)]
    check_file(args.out, HTML, "the report", given)
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
        replays_document(replays, page)
    sign(args, page)
    write_page(page, args.out)
    out = console()
    for report, _ in replays:
        out.print(f"{report.bag}: {headline(report)}", soft_wrap=True)
    wrote(out, args.out, "report")
    return DAMAGED if damaged else 0


def _replayed(args: Namespace, bag: str) -> tuple[ReplayReport, ReplayCurves, bool]:
    from robot_energy.api.replay import fixed_friction, replay_over_time
    from robot_energy.model import load
    from robot_energy.report.replay import ReplayCurves
    from robot_energy.report.series import curves_of
    from robot_energy.results.replay import replay_report

    model, change = load(model_named(args)), None
    if args.fixed_friction is not None:
        model, change = fixed_friction(model, args.fixed_friction)
    keep_freed_memory()
    with progress(f"replaying {Path(bag).name}") as show:
        result, power = replay_over_time(
            bag,
            model,
            power_period=PAGE_PERIOD,
            keep_curves=True,
            progress=show,
            **options_of(args),
        )
    curves = ReplayCurves(curves_of([result], [change]), power)
    return replay_report(result, change), curves, bool(result.problems)
