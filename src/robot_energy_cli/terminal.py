"""Output to a terminal, or plain lines to a pipe."""

from __future__ import annotations

import shlex
import sys
from argparse import Namespace
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import BagError, ReportError
from robot_energy.foundation.files.output_files import (
    HTML,
    JSON,
    PDF,
    PICTURE,
    STANDARD_OUTPUT,
    TEXT,
    FileKind,
    check_file,
    json_bytes,
    write_file,
)
from robot_energy.foundation.files.output_folder import check_folder, folder_path
from robot_energy.foundation.files.placement import all_or_none, place_all
from robot_energy.foundation.shown_text import shown, shown_lines

if TYPE_CHECKING:
    from rich.console import Console

    from robot_energy.model import RobotModel
    from robot_energy.results.base import Result
    from robot_energy_report.document import Document

JSON_OPTION = {"--json FILE": "write all figures as JSON; - for standard output, without tables"}
OUTPUTS = {**JSON_OPTION, "--report FILE": "write one HTML file with everything"}
TABLE_OUTPUTS = {**JSON_OPTION, "--report FILE": "write tables and figures as one HTML file"}
WIDTH = 100  # columns, where there is no terminal
_FILES: dict[str, tuple[tuple[FileKind, ...], str]] = {
    "json": (JSON, "the JSON report"),
    "report": ((*HTML, *PDF), "the report"),
    "plot": (PICTURE, "the figure"),
}


def console() -> Console:
    """Return the console for results: as wide as the terminal, or 100 plain columns.

    Text is made safe to show and keeps its lines; what is formatted already (tables) is left as
    it is.
    """
    from rich.console import Console

    from robot_energy_report.printing import terminal_text

    class PipeConsole(Console):
        """Leaves a closed pipe to `main`; the base class would exit with 1."""

        def print(self, *objects: Any, **options: Any) -> None:
            plain = (terminal_text(one, self) if isinstance(one, str) else one for one in objects)
            options.setdefault("soft_wrap", all(isinstance(one, str) for one in objects))
            super().print(*plain, **options)

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    tty = sys.stdout.isatty()
    return PipeConsole(
        file=sys.stdout,
        width=None if tty else WIDTH,
        highlight=False,
        markup=False,
        no_color=None if tty else True,
    )


@contextmanager
def progress(label: str) -> Generator[Callable[[float], None], None, None]:
    """Yield what takes the share done, 0 to 1: a bar on a terminal, nothing elsewhere."""
    if not (sys.stderr.isatty() and sys.stdout.isatty()):
        yield lambda share: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(escape(shown_lines(label)), total=1.0)
        yield lambda share: bar.update(task, completed=share)


def check_outputs(
    args: Namespace, inputs: Iterable[str | None] = (), model: str | None = None
) -> None:
    """Refuse the output files that a command has, before the work that they are for."""
    if getattr(args, "plot", None) is not None:
        from robot_energy_report.canvas import check_format

        check_format(Path(args.plot))
    known = [name for name in inputs if name]
    if getattr(args, "report", None) is not None:
        check_report(args.report, known)
    named = [(getattr(args, name, None), *rest) for name, rest in _FILES.items()]
    places: list[Path] = []
    for path, kinds, what in (*named, (model, TEXT, "the model file")):
        if path is None:
            continue
        check_file(path, kinds, what, known)
        place = Path(path).parent.resolve() / Path(path).name
        if place in places and (path == STANDARD_OUTPUT or place.is_file()):
            raise ReportError(f"'{shown(path)}' is named for two outputs", "another file for each")
        places.append(place)


def check_report(path: str, inputs: Iterable[str] = ()) -> None:
    """Refuse the file of a report before the work that it is for."""
    is_pdf = Path(path).suffix.lower() == ".pdf"
    check_file(path, PDF if is_pdf else HTML, "the report", inputs)
    if is_pdf:
        from robot_energy_report.page.headless_browser import need_browser

        need_browser()


def check_bag(
    path: str, overwrite: bool, inputs: Iterable[str | None] = (), files: Iterable[str | None] = ()
) -> None:
    """Refuse the folder of a new bag before the work that it is for."""
    from robot_energy.bag.metadata import foreign_entries

    known = [name for name in inputs if name]
    check_folder(path, foreign_entries, overwrite, known, BagError)
    place = folder_path(path, BagError).resolve()
    for file in files:
        above = None if file is None else Path(file).parent.resolve()
        if file is not None and above is not None and place in (above, *above.parents):
            raise BagError(f"'{shown(file)}' lies in the bag {shown(path)}", "another folder")


def write_json(path: str, summary: Mapping[str, Any]) -> None:
    """Write a JSON document whole or not at all; ``-`` is the standard output."""
    write_file(path, json_bytes(summary), JSON, "the JSON report")


def present(
    args: Namespace,
    result: Result,
    title: str = "",
    lead: str = "",
    made: str = "model file",
    plot: Callable[[str], object] | None = None,
    model: RobotModel | None = None,
    notes: Sequence[str] = (),
    **words: Any,
) -> None:
    """Write JSON, page and figure where they were asked for, put all in place, and print."""
    from robot_energy.model import save
    from robot_energy_report.document import document_of
    from robot_energy_report.printing import print_document

    page = document_of(result, title, lead, **words)
    page.notes(notes)
    kinds = {
        "out": made,
        "json": "all figures as JSON",
        "report": "report",
        "plot": "figure",
    }
    files = {name: getattr(args, name, None) for name in kinds}
    with all_or_none():
        if files["json"] is not None:
            write_json(files["json"], result.to_dict())
        if files["out"] is not None and model is not None:
            save(model, files["out"])
        if files["plot"] is not None and plot is not None:
            plot(files["plot"])
        if files["report"] is not None:
            from robot_energy_report.html import write_page

            sign(args, page)
            write_page(page, files["report"])
    place_all()
    if files["json"] == "-":
        return
    out = console()  # last: the reader of a pipe may close it early
    print_document(page, out)
    for name, what in kinds.items():
        path = files[name]
        if path is not None:
            drawn = plot is not None or name != "plot"
            wrote(out, path, what if drawn else "no figure, since there is nothing to draw", drawn)


def wrote(out: Console, path: str | Path, what: str, done: bool = True) -> None:
    """Say what was written, the path as it is."""
    from rich.text import Text

    verb = "wrote" if done else "did not write"
    out.print(Text(f"{verb} {shown(str(path))}: {what}"), soft_wrap=True)


def sign(args: Namespace, page: Document) -> None:
    """Add the command line that makes a page, as it was typed."""
    with page.only("page"):
        page.paragraph("This report was made by")
        page.paragraph(shlex.join(["robot-energy", *getattr(args, "command", ())]), "command")
