"""`robot-energy reproduce`: the experiments of the papers, done again, and how sure the tool is.

The folder that a study writes appears whole, or not at all.
"""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from robot_energy.foundation.files.output_files import HTML, JSON, PICTURE, TEXT, is_own_file
from robot_energy.foundation.files.output_folder import OutputFolder
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import Command, Group, add_option
from robot_energy_cli.terminal import console, progress, write_json

PAPER_A = """\
Repeat the experiment of paper A on the virtual rig: sets of 20 motions while a robot of
the KR 16 class warms up from 20 to about 80 degC, identification from the recorded bags,
and grid energy of held-out motions with friction that is fixed and friction that follows
temperature. Writes report.html, figures.json, front.svg, the identified model and the bags.

Nothing is measured on a robot: the study shows that the method works.
"""
PAPER_B = """\
Repeat the studies of paper B: a planar printing robot identified from an excitation motion
and validated on another; the electrical energy of its drives by efficiency maps and by a loss
model; and one wall printed by a planar arm, a gantry and an articulated arm. Writes report.html,
figures.json, front.svg, the identified model and the bags.

Measurements are those of a virtual rig, and machines are models of their class: the study shows
that the method works.
"""
CERTAINTY = """\
Count how often the tool is right about its own certainty, on plants of the virtual rig that are
drawn at random: intervals of identified figures, bands of predicted power and energy,
temperatures without a sensor, learning at work. Writes report.html and figures.json.
"""
SAVINGS = """\
Make random programs cheaper with identified models, and let the virtual rig, which the optimiser
has not seen, run them before and after: how often claimed savings are right, how often their
bands hold, how far the choice is from the best. With --waits, each cycle has 3 to 8 s to spend on
slower moves. Writes report.html and figures.json.
"""
ECBOT = """\
Predict the total electrical power of real cobots, each recording by a fit to the others, and
compare the RMS error with what EcBot publishes. The recordings are public, not part of the
project: --data or ROBOT_ENERGY_DATA names their folder. Writes report.html and figures.json.
"""
INDEPENDENT = """\
Repeat the experiment of paper A on a second simulator that shares no code with the model: bodies by
MuJoCo, other laws of friction, motors, heat and cabinet, robots drawn at random. Error of the grid
energy of held-out motions with friction that is fixed, friction that follows temperature, and all
that is identified. Writes report.html and figures.json.
"""
PAPERS = ("paper-a", "paper-b")  # what identifies one model; the others count our own claims
WORKERS = 2
REPORT, FIGURES, FRONT, MODEL = "report.html", "figures.json", "front.svg", "identified.yaml"
BAGS = "bags"
_FILES = {REPORT: HTML, FIGURES: JSON, FRONT: PICTURE, MODEL: TEXT}


def _study(name: str, title: str, text: str, quick: str = "", workers: bool = True) -> Command:
    """The command of one study; without a quick form it reads recordings instead of making them."""
    folder = name.replace("-", "_")

    def options(parser: ArgumentParser) -> None:
        add_option(parser, "--out FOLDER", f"to write to (default {folder})", default=folder)
        add_option(parser, "--overwrite", "replace an earlier study")
        parser.set_defaults(paper=name, seed=0, quick=False)
        if quick:
            add_option(parser, "--quick", quick)
            text = "of motions and rigs (default 0)"
            add_option(parser, "--seed N", text, type=_count(0), default=0)
        else:
            add_option(parser, "--data FOLDER", "of the recordings (default: ROBOT_ENERGY_DATA)")
        if name == "savings":
            add_option(parser, "--waits", "cycles with 3 to 8 s of waiting alone, on twelve plants")
        if workers:
            add_option(
                parser,
                "--workers N",
                f"processes at once (default {WORKERS}, with --quick 1); changes no figure",
                type=_count(1),
            )

    words = " --quick" if quick else ""
    epilog = f"example:\n  robot-energy reproduce {name}{words} --out build/{folder}\n"
    return Command(name, title, _run, options, text, epilog)


def _count(least: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        value = int(text) if text.isdecimal() else -1
        if value < least:
            raise ArgumentTypeError(f"'{text}' is not a whole number from {least} on")
        return value

    return parse


def _run(args: Namespace) -> int:
    from robot_energy.model import save
    from robot_energy_papers.job_pool import StudyRun
    from robot_energy_papers.pages import document, print_template
    from robot_energy_report.document import Document
    from robot_energy_report.html import write_page
    from robot_energy_report.printing import print_document

    name = args.paper.replace("-", "_")
    package = "robot_energy_papers" if args.paper in PAPERS else "robot_energy_studies"
    paper = import_module(f"{package}.{name}")
    page = import_module(f"{package}.{name}_page") if args.paper in PAPERS else paper
    workers = getattr(args, "workers", 1) or (1 if args.quick else WORKERS)
    with study_folder(args.out, args.overwrite) as folder:
        with progress("recording, identifying, testing") as report:
            if "data" in args:
                scale = paper.data_folder(args.data)
            else:
                scale = paper.QUICK if args.quick else paper.FULL
            if getattr(args, "waits", False):
                scale = replace(scale, waits=True) if args.quick else paper.WAITS
            result = paper.study(StudyRun(folder / BAGS, args.seed, workers, report), scale)
        # the command line that makes this page, without where and how fast
        words = [f" --{word}" for word in ("quick", "waits") if getattr(args, word, False)]
        words += [f" --seed {args.seed}"] * bool(args.seed)
        command = f"robot-energy reproduce {args.paper}{''.join(words)}"
        context = {**page.context(result), "command": command}
        write_page(document(name, context, page.pieces(result), package), folder / REPORT)
        write_json(str(folder / FIGURES), page.figures(result))
        written = [REPORT, FIGURES]
        if args.paper in PAPERS:
            save(result.model, folder / MODEL)
            page.front_picture(result, folder / FRONT)
            written += [FRONT, MODEL, BAGS]
    out = Document()
    print_template(f"{name}_terminal", context, out, package)
    for file in written:
        out.paragraph(f"wrote {shown(str(Path(args.out) / file))}")
    print_document(out, console())
    return 0


@contextmanager
def study_folder(name: str, overwrite: bool) -> Generator[Path]:
    """Yield a draft of the folder, with a place for bags, which is put into place at the end."""
    folder = OutputFolder(name, _foreign, overwrite)
    try:
        folder.make(BAGS)
        yield folder.draft
        folder.place()
    except BaseException:
        folder.discard()
        raise


def _foreign(folder: Path) -> list[str]:
    """What in a folder no study wrote."""
    found: list[str] = []
    for path in sorted(folder.iterdir()):
        if path.name == BAGS and path.is_dir() and not path.is_symlink():
            found += [f"{BAGS}/{bag.name}" for bag in sorted(path.iterdir()) if not _is_bag(bag)]
        elif not is_own_file(path, _FILES.get(path.name, ())):
            found.append(path.name)
    return found


def _is_bag(path: Path) -> bool:
    from robot_energy.bag.metadata import foreign_entries  # imports much, at every command

    return path.is_dir() and not path.is_symlink() and not foreign_entries(path)


STUDIES = (
    _study(
        "paper-a", "energy over robot temperature", PAPER_A,
        "a few temperatures, short sets, rigs that start at their temperature",
    ),
    _study(
        "independent", "paper A on a second simulator", INDEPENDENT,
        "two robots, short sets: shows that it runs, judges nothing",
    ),
    _study(
        "certainty", "how often intervals and bands hold", CERTAINTY,
        "one repetition of each: shows that it runs, judges nothing",
    ),
    _study(
        "savings", "how often claimed savings are right", SAVINGS,
        "one plant at one temperature: shows that it runs, judges nothing",
    ),
    _study(
        "paper-b", "energy of printing robots", PAPER_B,
        "layers at two heights instead of all 100", workers=False,
    ),
    _study("ecbot", "total power of real cobots, held out", ECBOT, workers=False),
)  # fmt: skip
add_parser = Group(
    "reproduce",
    "repeat the experiments of papers, on the virtual rig and on real recordings",
    "Repeat the experiments of a paper; every figure states its data.",
    "papers",
    "PAPER",
    lambda: STUDIES,
).add_parser  # what the entry point of the package gives
