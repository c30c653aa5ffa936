"""Output to a terminal, or plain lines to a pipe."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.errors import BagError, ReportError
from robot_energy.files.output_files import (
    HTML,
    JSON,
    PICTURE,
    STANDARD_OUTPUT,
    TEXT,
    FileKind,
    check_file,
    json_bytes,
    write_file,
)
from robot_energy.files.output_folder import check_folder, folder_path
from robot_energy.shown_text import shown, shown_lines

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 100  # columns, where there is no terminal
_FILES: dict[str, tuple[tuple[FileKind, ...], str]] = {
    "json": (JSON, "the JSON report"),
    "report": (HTML, "the HTML report"),
    "plot": (PICTURE, "the figure"),
}


def console() -> Console:
    """Return the console for results: as wide as the terminal, or 100 plain columns.

    Text is made safe to show; what is formatted already (tables) is left as it is.
    """
    from rich.console import Console

    class PipeConsole(Console):
        """Leaves a closed pipe to `main`; the base class would exit with 1."""

        def print(self, *objects: Any, **options: Any) -> None:
            plain = (shown_lines(one) if isinstance(one, str) else one for one in objects)
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
    """Show a bar on a terminal, nothing elsewhere.

    Args:
        label: What is going on.

    Yields:
        To be called with the share done, 0 to 1.
    """
    if not (sys.stderr.isatty() and sys.stdout.isatty()):
        yield lambda share: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(escape(shown_lines(label)), total=1.0)
        yield lambda share: bar.update(task, completed=share)


def add_debug(parser: ArgumentParser) -> None:
    """Add the option that every sub-command has."""
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")


def check_outputs(
    args: Namespace, inputs: Iterable[str | None] = (), model: str | None = None
) -> None:
    """Refuse output files before the work that they are for.

    Args:
        args: Of the command, with ``json``, ``report`` and ``plot`` where it has them.
        inputs: Files and folders that it reads.
        model: Model file that it writes.

    Raises:
        ReportError: If one cannot be written, must not be replaced, or is named twice.
    """
    known = [name for name in inputs if name]
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


def check_bag(
    path: str,
    overwrite: bool,
    inputs: Iterable[str | None] = (),
    files: Iterable[str | None] = (),
) -> None:
    """Refuse the folder of a new bag before the work that it is for.

    Args:
        path: The folder.
        overwrite: Whether a bag of this tool may be replaced.
        inputs: Files and folders that the command reads.
        files: Files that it writes as well.

    Raises:
        BagError: If it must not be replaced, or one of the files lies in it.
    """
    from robot_energy.bag.ownership import foreign_entries

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
