"""Output to a terminal, or plain lines to a pipe."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.errors import ReportError

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 100  # columns, where there is no terminal


def console() -> Console:
    """Return the console for results: as wide as the terminal, or 100 plain columns."""
    from rich.console import Console

    class PipeConsole(Console):
        """Leaves a closed pipe to `main`; the base class would exit with 1."""

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
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(label, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def add_debug(parser: ArgumentParser) -> None:
    """Add the option that every sub-command has."""
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")


def check_writable(path: str | None, what: str) -> None:
    """Refuse an output file before the work that it is for.

    Args:
        path: The file, or None.
        what: Its content, for the message.

    Raises:
        ReportError: If its folder does not exist, or it is one itself.
    """
    if path is None or path == "-":
        return
    target = Path(path)
    if target.is_dir():
        raise ReportError(f"{what} cannot be written to '{path}', which is a folder", "a file")
    if not target.parent.is_dir():
        raise ReportError(
            f"{what} cannot be written to '{path}': there is no folder '{target.parent}'",
            "a folder that exists",
        )


def write_text(path: str, text: str) -> None:
    """Write a file whole or not at all; ``-`` is the standard output."""
    if path == "-":
        sys.stdout.write(text)
        return
    draft = Path(f"{path}.part")
    draft.write_text(text, encoding="utf-8")
    os.replace(draft, path)
