"""Files for the user: whole or not at all, and never over what is not ours.

A file that exists is replaced only if this tool wrote one of the same kind there (it bears a
mark). Inputs of the same command and links are never written to; a device or pipe is
written to, not replaced.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import stat
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, BinaryIO

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
MAX_READER_ATTEMPTS = 200  # to open a pipe that nobody reads yet; a clock would count stalls too
_LOOK_PERIOD = 0.02  # s
_STREAMS = {"/dev/stdin": 0, "/dev/stdout": 1, "/dev/stderr": 2}
_STREAM_FOLDERS = ("/dev/fd", "/proc/self/fd")

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
        number = stream_number(target)
        if number is not None:
            if fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
                raise error(f"{place}, which is open for reading only", "an output")
            return
        try:
            mode = os.lstat(target).st_mode
        except FileNotFoundError:
            folder = target.parent
            if not folder.is_dir():
                where = f"{place}: there is no folder '{shown(str(folder))}'"
                raise error(where, "a folder that exists") from None
            refuse_inputs(target, inputs, place, error)
            return
        if stat.S_ISLNK(mode):
            raise error(f"{place}, which is a link", "a file", "name the file that it leads to")
        if stat.S_ISDIR(mode):
            raise error(f"{place}, which is a folder", "a file")
        if stat.S_ISCHR(mode) or stat.S_ISFIFO(mode):
            return
        if not stat.S_ISREG(mode):
            raise error(f"{place}, which is a disk or a socket", "a file, a pipe or a terminal")
        refuse_inputs(target, inputs, place, error)
        own = not target.stat().st_size or any(_is_marked(target, kind) for kind in kinds)
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
    if (stream := open_stream(target, failure)) is not None:
        try:
            with stream:
                stream.write(data)
        except BrokenPipeError:
            raise
        except OSError as trouble:
            raise failure(trouble) from trouble
        return
    placement = OutputPlacement(
        target, lambda place: check_file(place, kinds, what, (), error), failure
    )
    try:
        number = placement.open_file()
        try:
            write_all(number, data)
            os.fsync(number)
        except OSError as trouble:
            raise failure(trouble) from trouble
        with all_or_none() as waiting:
            waiting.append(placement)
    except BaseException:
        placement.undo()
        raise


def write_all(number: int, data: bytes | memoryview) -> None:
    """Write all bytes to a file descriptor."""
    left = memoryview(data)
    while left:
        left = left[os.write(number, left) :]


def is_own_file(path: Path, kinds: tuple[FileKind, ...]) -> bool:
    """Whether a path is a regular file that this tool wrote."""
    found = os.lstat(path)
    return stat.S_ISREG(found.st_mode) and any(_is_marked(path, kind) for kind in kinds)


def checked_path(path: str | os.PathLike[str], what: str, error: ErrorType) -> Path:
    """Return a path that a file can have."""
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
    inputs = [*inputs]
    if not inputs:
        return
    real_target = os.path.realpath(target)
    around = {_key(one) for one in (target, *target.absolute().parents)}
    inside = _keys_of(target)
    for name in inputs:
        try:
            source = Path(name)
            real = Path(os.path.realpath(source))
            keys = _keys_of(source)
            if not keys and str(real) != real_target:
                continue
        except (OSError, ValueError):
            continue
        held = _key(target) in {_key(one) for one in real.parents}
        lies = bool(keys) and _key(source) in around
        if str(real) == real_target or keys & inside or held or lies:
            raise error(
                f"{place}: it is, holds or lies in the input '{shown(str(name))}'",
                "another place",
                "inputs are never changed",
            )


def _key(path: Path) -> tuple[int, int] | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _keys_of(path: Path) -> set[tuple[int, int]]:
    """A file or folder, and the files in the folder; empty where there is nothing."""
    keys = {_key(path)}
    if path.is_dir():
        with os.scandir(path) as entries:
            for _, entry in zip(range(MAX_INPUT_FILES), entries, strict=False):
                keys.add(_key(Path(entry.path)))
    return {key for key in keys if key is not None}


def _is_marked(path: Path, kind: FileKind) -> bool:
    number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(number, "rb") as file:
        start = file.read(MAX_MARK_BYTES)
        if not start.startswith(kind.start):
            return False
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - MAX_MARK_BYTES))
        return kind.mark in start or kind.mark in file.read(MAX_MARK_BYTES)


def stream_number(target: Path) -> int | None:
    """Return the descriptor that a path such as /dev/stdout names; None for other paths."""
    if (text := str(target)) in _STREAMS:
        return _STREAMS[text]
    named = str(target.parent) in _STREAM_FOLDERS and target.name.isdecimal()
    return int(target.name) if named else None


def open_stream(target: Path, failure: Callable[[OSError], Exception]) -> BinaryIO | None:
    """Return a device, pipe or descriptor open for writing; None for a file or an unused path."""
    try:
        number = stream_number(target)
        if number is not None:
            if number in (1, 2):
                (sys.stdout if number == 1 else sys.stderr).flush()
            return os.fdopen(os.dup(number), "wb")
        mode = os.lstat(target).st_mode
        if stat.S_ISCHR(mode):
            return os.fdopen(os.open(target, os.O_WRONLY | os.O_CLOEXEC | os.O_NOCTTY), "wb")
        return _open_pipe(target) if stat.S_ISFIFO(mode) else None
    except FileNotFoundError:
        return None
    except OSError as trouble:
        raise failure(trouble) from trouble


def _open_pipe(target: Path) -> BinaryIO:
    """Open a pipe for writing once it has a reader."""
    attempts = 0
    while True:
        try:
            number = os.open(target, os.O_WRONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as trouble:
            if trouble.errno != errno.ENXIO:
                raise
            attempts += 1
            if attempts >= MAX_READER_ATTEMPTS:
                raise OSError(errno.ENXIO, "no program reads the pipe", str(target)) from trouble
            time.sleep(_LOOK_PERIOD)
            continue
        os.set_blocking(number, True)
        return os.fdopen(number, "wb")
