"""`robot-energy reproduce paper-b`: energy of printing robots."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

from robot_energy.cli.numbers import whole
from robot_energy.cli.terminal import add_command, console, progress, write_json
from robot_energy.errors import RigError
from robot_energy.shown_text import shown
from robot_energy_papers.cli.study_folder import BAGS, FIGURES, FRONT, MODEL, REPORT, study_folder

DESCRIPTION = """\
Repeat the studies of paper B: a planar printing robot identified from an excitation motion
and validated on another; the electrical energy of its drives by efficiency maps and by a loss
model; and one wall printed by a planar arm, a gantry and an articulated arm. Writes report.html,
figures.json, front.svg, the identified model and the bags.

Measurements are those of a virtual rig, and machines are models of their class: the study shows
that the method works.
"""
EPILOG = """\
example:
  robot-energy reproduce paper-b --quick --out build/paper_b
"""


def add_parser(papers: Any) -> None:
    """Add the sub-command."""
    text = "energy of printing robots"
    parser = add_command(papers, "paper-b", run, text, DESCRIPTION, EPILOG)
    parser.add_argument(
        "--quick", action="store_true", help="layers at three heights instead of all 100"
    )
    parser.add_argument(
        "--out", default="paper_b", metavar="FOLDER", help="to write to (default paper_b)"
    )
    parser.add_argument(
        "--seed", type=whole, default=0, metavar="N", help="of motions and rigs (default 0)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier study")


def run(args: Namespace) -> int:
    """Do the studies and write everything.

    Raises:
        RobotEnergyError: If the folder cannot be used, or a run or fit fails.
    """
    from robot_energy.model import save
    from robot_energy.report.document import Document
    from robot_energy.report.html import write_page
    from robot_energy.report.printing import print_document
    from robot_energy_papers.paper_b import FULL, QUICK, study
    from robot_energy_papers.paper_b_figures import figures
    from robot_energy_papers.paper_b_machines_page import front_picture, print_machines
    from robot_energy_papers.paper_b_page import page, print_drives, print_mechanics

    if args.seed < 0:
        raise RigError(f"the seed is {args.seed}", "a whole number from 0 on")
    with study_folder(args.out, args.overwrite) as folder:
        with progress("recording, identifying, printing") as report:
            result = study(folder / BAGS, args.seed, QUICK if args.quick else FULL, report)
        write_page(page(result, _command(args)), folder / REPORT)
        write_json(str(folder / FIGURES), figures(result))
        save(result.main.model, folder / MODEL)
        front_picture(result, folder / FRONT)
    out = Document()
    out.paragraph("virtual rig and models of machine classes: nothing was measured on a robot")
    for show in (print_mechanics, print_drives, print_machines):
        show(result, out)
    for name in (REPORT, FIGURES, FRONT, MODEL, BAGS):
        out.paragraph(f"wrote {shown(str(Path(args.out) / name))}")
    print_document(out, console())
    return 0


def _command(args: Namespace) -> str:
    """The command line that makes this page, without where."""
    seed = f" --seed {args.seed}" if args.seed else ""
    return f"robot-energy reproduce paper-b{' --quick' if args.quick else ''}{seed}"
