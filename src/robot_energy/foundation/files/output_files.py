"""Files for the user: whole or not at all, and never over what is not ours.

A file that exists is replaced only if this tool wrote one of the same kind there (it bears a
mark). Inputs of the same command and links are never written to; a device or pipe is
written to, not replaced.
"""

from __future__ import annotations

import itertools
import json
import os
import stat
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ReportError, RobotEnergyError
from robot_energy.foundation.files.placement import OutputPlacement, all_or_none, remove_remains
from robot_energy.foundation.shown_text import shown

GENERATOR = "robot-energy"
COMMENT = f"# Written by {GENERATOR}.\n"  # first line of model files
HTML_MARK = f'<meta name="generator" content="{GENERATOR}">'
STANDARD_OUTPUT = "-"
MAX_MARK_BYTES = 8192  # at each end of a file that are searched for its mark
MAX_INPUT_FILES = 10_000  # of an input folder that are compared with outputs

_REFUSED = {
    stat.S_IFLNK: ("a link", "name the file that it leads to, or give - to print text"),
    stat.S_IFDIR: ("a folder", "name a file in it"),
    stat.S_IFBLK: ("a disk", ""),
    stat.S_IFSOCK: ("a socket", ""),
}

Names = Iterable[str | os.PathLike[str]]
ErrorType = type[RobotEnergyError]


class FileKind(Described):
    """A kind of file and what its beginning or end holds if this tool wrote it."""

    name: str
    start: Annotated[bytes, "First bytes of the file; empty for any."]
    mark: bytes


JSON = (FileKind("JSON", f'{{\n  "generator": "{GENERATOR}"'.encode(), b""),)
HTML = (FileKind("HTML", b"<!DOCTYPE html>", HTML_MARK.encode()),)
TEXT = (FileKind("text", COMMENT.encode(), b""),)
CSV = (FileKind("CSV", b"stamp_ns,predicted_grid_power,", b""),)
MARKED_CSV = (FileKind("CSV", b"resolution,timezone,robot,start_ns,stop_ns", b""),)
SQL = (FileKind("SQL", f"-- Written by {GENERATOR}.".encode(), b""),)
METRICS = (FileKind("OpenMetrics", b"# HELP robot_energy_history_joules ", b""),)
PARQUET = (FileKind("Parquet", b"PAR1", GENERATOR.encode()),)
PICTURE = (
    FileKind("PNG", b"\x89PNG\r\n\x1a\n", b"tEXtSoftware\0" + GENERATOR.encode()),
    FileKind("SVG", b"<?xml", f"<dc:title>{GENERATOR}</dc:title>".encode()),
    FileKind("PDF", b"%PDF-", f"/Creator ({GENERATOR})".encode()),
)
PDF = PICTURE[2:]


def json_bytes(summary: Mapping[str, Any]) -> bytes:
    """Return a JSON document that bears the mark of this tool."""
    document = {"generator": GENERATOR, **summary}
    return f"{json.dumps(document, indent=2, allow_nan=False)}\n".encode()


def check_file(
    path: str | os.PathLike[str],
    kinds: tuple[FileKind, ...],
    what: str = "the file",
    inputs: Names = (),
    error: ErrorType = ReportError,
) -> None:
    """Refuse an output file before the work that it is for; missing inputs are ignored."""
    if os.fspath(path) == STANDARD_OUTPUT:
        return
    target = checked_path(path, what, error)
    place = f"{what} cannot be written to '{shown(str(path))}'"
    try:
        if is_stream(target):
            return
        own = True
        if os.path.lexists(target):
            kind = stat.S_IFMT(os.lstat(target).st_mode)
            if kind in _REFUSED:
                name, remedy = _REFUSED[kind]
                raise error(f"{place}, which is {name}", "a file, a pipe or a terminal", remedy)
            own = not target.stat().st_size or is_own_file(target, kinds)
        elif not target.parent.is_dir():
            where = f"{place}: there is no folder '{shown(str(target.parent))}'"
            raise error(where, "a folder that exists")
        refuse_inputs(target, inputs, place, error)
    except OSError as trouble:
        raise error(f"{place} ({trouble.strerror})", "a file that can be written") from trouble
    if not own:
        names = " or ".join(kind.name for kind in kinds)
        raise error(
            f"{place}: it exists and was not written by {GENERATOR} as {names}",
            f"a new file, or one of {GENERATOR}",
            "choose another name, or remove the file",
        )


def write_file(
    path: str | os.PathLike[str],
    data: bytes,
    kinds: tuple[FileKind, ...],
    what: str = "the file",
    error: ErrorType = ReportError,
    remains: bool = True,
) -> None:
    """Write a file whole or not at all; a device or pipe is written to.

    Where a killed run may have left some of it (``remains``), the folder is looked through.
    """
    if os.fspath(path) == STANDARD_OUTPUT:
        sys.stdout.write(data.decode("utf-8"))
        return

    def failure(trouble: OSError) -> Exception:
        return error(
            f"{what} cannot be written to '{shown(str(path))}' ({trouble.strerror or trouble})",
            "a folder that can be written to, with room",
        )

    target = checked_path(path, what, error)
    if remains:
        remove_remains(target)
    check_file(path, kinds, what, (), error)
    try:
        if is_stream(target):
            with target.open("wb") as stream:
                stream.write(data)
            return
    except BrokenPipeError:
        raise
    except OSError as trouble:
        raise failure(trouble) from trouble
    placement = OutputPlacement(
        target, lambda place: check_file(place, kinds, what, (), error), failure
    )
    try:
        placement.write_draft(data)
        with all_or_none() as waiting:
            waiting.append(placement)
    except BaseException:
        placement.undo()
        raise


def is_own_file(path: Path, kinds: tuple[FileKind, ...]) -> bool:
    """Whether a path is a regular file that this tool wrote."""
    found = os.lstat(path)
    return stat.S_ISREG(found.st_mode) and any(_is_marked(path, kind) for kind in kinds)


def checked_path(path: str | os.PathLike[str], what: str, error: ErrorType) -> Path:
    text = os.fspath(path)
    try:
        valid = bool(text) and b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:
        valid = False
    if not valid:
        raise error(f"{what} has no name that a file can have: '{shown(str(text))}'", "a path")
    return path if isinstance(path, Path) else Path(text)


def refuse_inputs(target: Path, inputs: Names, place: str, error: ErrorType) -> None:
    """Refuse a target that is an input, holds one, or lies in one: by files, not by names."""
    real = Path(os.path.realpath(target))
    written = _files(real)
    for name in inputs:
        try:
            source = Path(os.path.realpath(name))
            same = source == real or bool(written & _files(source))
        except (OSError, ValueError):  # of what cannot be read, or is no name of a file
            continue
        if same or source in real.parents or real in source.parents:
            raise error(
                f"{place}: it is, holds or lies in the input '{shown(str(name))}'",
                "another place",
                "inputs are never changed",
            )


def _files(path: Path) -> set[tuple[int, int]]:
    """A file or folder, and the files in the folder; empty where there is nothing."""
    if not path.exists():
        return set()
    inside = itertools.islice(path.iterdir(), MAX_INPUT_FILES) if path.is_dir() else ()
    found = [one.stat() for one in (path, *inside) if one.exists()]
    return {(one.st_dev, one.st_ino) for one in found}


def _is_marked(path: Path, kind: FileKind) -> bool:
    number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(number, "rb") as file:
        start = file.read(MAX_MARK_BYTES)
        if not start.startswith(kind.start):
            return False
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - MAX_MARK_BYTES))
        return kind.mark in start or kind.mark in file.read(MAX_MARK_BYTES)


def is_stream(target: Path) -> bool:
    """Whether a path is, or leads to, a device or a pipe."""
    if not target.exists():
        return False
    mode = target.stat().st_mode
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)
