"""`robot-energy reproduce paper-b`: energy of printing robots."""

from __future__ import annotations

import json
import shutil
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from pathlib import Path
from typing import Any

from robot_energy.cli.terminal import add_debug, console, progress, write_text

DESCRIPTION = """\
Do the studies of paper B again: a planar printing robot identified from an excitation motion
and validated on another; the electrical energy of its drives by efficiency maps and by a loss
model; and one wall printed by a planar arm, a gantry and an articulated arm. Writes report.html,
figures.json, front.svg, the identified model and the bags.

Measurements are those of a virtual rig, machines are models of their class: it proves the method.
"""
EPILOG = """\
example:
  robot-energy reproduce paper-b --quick --out build/paper_b
"""
REPORT, FIGURES, FRONT, MODEL = "report.html", "figures.json", "front.svg", "identified.yaml"
BAGS, OURS = "bags", "mantis_*"


def add_parser(papers: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = papers.add_parser(
        "paper-b",
        help="energy of printing robots",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--quick", action="store_true", help="layers at three heights instead of all 100"
    )
    parser.add_argument(
        "--out", default="paper_b", metavar="FOLDER", help="to write to (default paper_b)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of motions and rigs (default 0)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier study")
    add_debug(parser)
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Do the studies and write everything.

    Raises:
        RobotEnergyError: If the folder cannot be used, or a run or fit fails.
    """
    from robot_energy.model_file import save
    from robot_energy.report.printing import line
    from robot_energy.reproduce.paper_b import FULL, QUICK, study
    from robot_energy.reproduce.paper_b_figures import figures
    from robot_energy.reproduce.paper_b_machines_page import front_picture, print_machines
    from robot_energy.reproduce.paper_b_page import page, print_drives, print_mechanics

    folder = _folder(args)
    with progress("recording, identifying, printing") as report:
        result = study(folder / BAGS, args.seed, QUICK if args.quick else FULL, report)
    page(result, _command(args)).write(folder / REPORT)
    text = json.dumps(figures(result), indent=2, allow_nan=False) + "\n"
    write_text(str(folder / FIGURES), text)
    save(result.main.model, folder / MODEL)
    front_picture(result, folder / FRONT)
    out = console()
    line(out, "virtual rig and models of machine classes: nothing was measured on a robot")
    for show in (print_mechanics, print_drives, print_machines):
        show(result, out)
    for name in (REPORT, FIGURES, FRONT, MODEL, BAGS):
        line(out, f"wrote {folder / name}")
    return 0


def _command(args: Namespace) -> str:
    """The command line that makes this page, without where."""
    seed = f" --seed {args.seed}" if args.seed else ""
    return f"robot-energy reproduce paper-b{' --quick' if args.quick else ''}{seed}"


def _folder(args: Namespace) -> Path:
    """Make the folder, and clear what an earlier study left in it."""
    from robot_energy.errors import ReportError, RigError

    if args.seed < 0:
        raise RigError(f"the seed is {args.seed}", "a whole number from 0 on")
    folder = Path(args.out)
    if folder.exists() and not folder.is_dir():
        raise ReportError(f"'{folder}' is a file", "a folder", "name another one with --out")
    if folder.is_dir() and any(folder.iterdir()):
        if not args.overwrite:
            raise ReportError(
                f"the folder '{folder}' is not empty", "a new folder", "or give --overwrite"
            )
        for bag in (folder / BAGS).glob(OURS):
            shutil.rmtree(bag)
    (folder / BAGS).mkdir(parents=True, exist_ok=True)
    return folder
