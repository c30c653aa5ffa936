"""`robot-energy reproduce paper-a`: energy over robot temperature."""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any

from robot_energy.cli.terminal import add_command, console, progress, write_json
from robot_energy.shown_text import shown
from robot_energy_papers.cli.study_folder import BAGS, FIGURES, FRONT, MODEL, REPORT, study_folder

DESCRIPTION = """\
Repeat the experiment of paper A on the virtual rig: sets of 20 motions while a robot of
the KR 16 class warms up from 20 to about 80 degC, identification from the recorded bags,
and grid energy of held-out motions with friction that is fixed and friction that follows
temperature. Writes report.html, figures.json, front.svg, the identified model and the bags.

Nothing is measured on a robot: the study shows that the method works.
"""
EPILOG = """\
example:
  robot-energy reproduce paper-a --quick --out build/paper_a
"""
WORKERS = 2


def add_parser(papers: Any) -> None:
    """Add the sub-command."""
    text = "energy over robot temperature"
    parser = add_command(papers, "paper-a", run, text, DESCRIPTION, EPILOG)
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a few temperatures, short sets, rigs that start at their temperature",
    )
    parser.add_argument(
        "--out", default="paper_a", metavar="FOLDER", help="to write to (default paper_a)"
    )
    parser.add_argument(
        "--seed", type=_count(0), default=0, metavar="N", help="of motions and rigs (default 0)"
    )
    parser.add_argument(
        "--workers",
        type=_count(1),
        metavar="N",
        help=f"processes at once (default {WORKERS}, with --quick 1); changes no figure",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier study")


def _count(least: int) -> Any:
    def parse(text: str) -> int:
        value = int(text) if text.isdecimal() else -1
        if value < least:
            raise ArgumentTypeError(f"'{text}' is no whole number from {least} on")
        return value

    return parse


def run(args: Namespace) -> int:
    """Do the study and write everything.

    Raises:
        RobotEnergyError: If the folder cannot be used, or a run or fit fails.
    """
    from robot_energy.model import save
    from robot_energy.report.document import Document
    from robot_energy.report.html import write_page
    from robot_energy.report.printing import print_document
    from robot_energy_papers.models import FOLLOWS
    from robot_energy_papers.paper_a import FULL, QUICK, study
    from robot_energy_papers.paper_a_figures import figures
    from robot_energy_papers.paper_a_numbers import hardest
    from robot_energy_papers.paper_a_page import front_picture, page, print_errors

    workers = args.workers or (1 if args.quick else WORKERS)
    with study_folder(args.out, args.overwrite) as folder:
        with progress("recording, identifying, testing") as report:
            result = study(folder / BAGS, args.seed, QUICK if args.quick else FULL, workers, report)
        write_page(page(result, _command(args)), folder / REPORT)
        write_json(str(folder / FIGURES), figures(result))
        save(result.identified.models[FOLLOWS], folder / MODEL)
        front_picture(result, folder / FRONT)
    out = Document()
    print_errors(result, out, short=True)
    out.paragraph(hardest(result))
    for name in (REPORT, FIGURES, FRONT, MODEL, BAGS):
        out.paragraph(f"wrote {shown(str(Path(args.out) / name))}")
    print_document(out, console())
    return 0


def _command(args: Namespace) -> str:
    """The command line that makes this page, without where and how fast."""
    seed = f" --seed {args.seed}" if args.seed else ""
    return f"robot-energy reproduce paper-a{' --quick' if args.quick else ''}{seed}"
