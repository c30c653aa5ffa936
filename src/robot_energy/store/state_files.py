"""Opens files of the state folder: regular files only, no links, nothing that blocks.

The folder itself may be a link, which its user has set; a file in it may not, since
whoever can put one there would decide what is overwritten.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

SAFE = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY


def open_regular(path: Path, flags: int, mode: int = 0o644) -> int:
    """Return the descriptor of a regular file.

    Args:
        path: The file; its last part must not be a link.

    Raises:
        OSError: If it cannot be opened, or is a link, pipe, device or folder.
    """
    try:
        file = os.open(path, flags | SAFE, mode)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
            raise OSError(error.errno, "is not a regular file", str(path)) from error
        raise
    if stat.S_ISREG(os.fstat(file).st_mode):
        return file
    os.close(file)
    raise OSError(errno.EINVAL, "is not a regular file", str(path))


def read_regular(path: Path, limit: int) -> bytes | None:
    """Return the content of a regular file; None where there is nothing.

    Raises:
        OSError: If it cannot be read, is not a regular file or is larger.
    """
    try:
        file = open_regular(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    with os.fdopen(file, "rb") as opened:
        if os.fstat(file).st_size > limit:
            raise OSError(errno.EFBIG, f"has over {limit} bytes", str(path))
        return opened.read(limit)
