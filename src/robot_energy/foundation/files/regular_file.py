"""Reads files that others name: regular ones alone, at once, and no more than is asked for.

A pipe would be waited for, a device may never end, and opening one can have effects. So a file
is opened without waiting, looked at, and read only if it is a regular one. What is wrong is an
``OSError`` whose ``strerror`` completes "cannot be read (...)".
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

_KINDS = {
    stat.S_IFIFO: "it is a pipe; write its content to a file and name that",
    stat.S_IFCHR: "it is a device; write its content to a file and name that",
    stat.S_IFBLK: "it is a device; write its content to a file and name that",
    stat.S_IFSOCK: "it is a socket; write its content to a file and name that",
    stat.S_IFDIR: "it is a folder",
}


def open_regular(path: str | Path, buffering: int = -1) -> BinaryIO:
    """Return a regular file, or one that a link leads to, open for reading.

    Raises:
        OSError: If it cannot be opened or is not a regular file.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    try:
        _require_regular(os.stat(path).st_mode, path)  # not even opened otherwise
        number = os.open(path, flags)
    except ValueError as error:
        raise OSError(errno.EINVAL, "its name holds a NUL", repr(path)) from error
    try:
        _require_regular(os.fstat(number).st_mode, path)
    except OSError:
        os.close(number)
        raise
    return os.fdopen(number, "rb", buffering)


def read_regular(path: str | Path, max_bytes: int) -> bytes:
    """Return the content of a regular file of bounded size.

    Raises:
        OSError: If it cannot be read, is not a regular file or is larger.
    """
    with open_regular(path) as file:
        data = b""
        if os.fstat(file.fileno()).st_size <= max_bytes:
            data = file.read(max_bytes + 1)  # it may grow
            if len(data) <= max_bytes:
                return data
    raise OSError(errno.EFBIG, f"it is larger than {max_bytes} bytes", str(path))


def read_regular_text(
    path: str | Path, max_bytes: int, encoding_of: Callable[[bytes], str] | None = None
) -> str:
    """Return the text of a regular file of bounded size, with line feeds alone.

    Args:
        encoding_of: Finds the encoding; by default it is UTF-8.

    Raises:
        OSError: If it cannot be read, is not a regular file, is larger or has no known encoding.
        UnicodeDecodeError: If it does not have its encoding.
    """
    data = read_regular(path, max_bytes)
    try:
        text = data.decode("utf-8" if encoding_of is None else encoding_of(data))
    except UnicodeDecodeError:
        raise
    except (LookupError, UnicodeError) as error:
        raise OSError(errno.EINVAL, f"it has no known encoding: {error}", str(path)) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def why_unreadable(error: OSError | UnicodeDecodeError) -> str:
    """Return what is wrong with a file, to stand in brackets."""
    if isinstance(error, OSError):
        return str(error.strerror)
    return f"it is not {error.encoding.upper().removesuffix('-SIG')}"


def _require_regular(mode: int, path: str | Path) -> None:
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "it is not a regular file")
        number = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
        raise OSError(number, kind, str(path))
