"""Devices, pipes and open descriptors named as outputs: written to, not replaced."""

from __future__ import annotations

import errno
import os
import stat
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

MAX_READER_ATTEMPTS = 200  # to open a pipe that nobody reads yet; a clock would count stalls too
_LOOK_PERIOD = 0.02  # s
_STREAMS = {"/dev/stdin": 0, "/dev/stdout": 1, "/dev/stderr": 2}
_STREAM_FOLDERS = ("/dev/fd", "/proc/self/fd")


def stream_number(target: Path) -> int | None:
    """Return the descriptor that a path such as /dev/stdout names; None for other paths."""
    if (text := str(target)) in _STREAMS:
        return _STREAMS[text]
    named = str(target.parent) in _STREAM_FOLDERS and target.name.isdecimal()
    return int(target.name) if named else None


def open_stream(target: Path, failure: Callable[[OSError], Exception]) -> BinaryIO | None:
    """Return a device, pipe or descriptor open for writing; None for a file or an unused path.

    Args:
        failure: Makes the exception to raise of an error of the disk.
    """
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
