"""One state file: a line of text that guards what follows, and the JSON it guards.

The line names format, sequence number, length and CRC-32; the CRC covers the line itself
as well. ``head -1`` shows it, ``tail -n +2`` gives plain JSON.

It must be a regular file, no link and nothing that blocks: whoever can put a link there would
decide what is overwritten. The folder itself may be a link, which its user has set.
"""

from __future__ import annotations

import errno
import os
import re
import stat
import zlib
from pathlib import Path

from robot_energy.foundation.errors import StateFileError

SAFE = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY


def open_unlinked(path: Path, flags: int, mode: int = 0o644) -> int:
    """Return the descriptor of a regular file.

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
        file = open_unlinked(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    with os.fdopen(file, "rb") as opened:
        if os.fstat(file).st_size > limit:
            raise OSError(errno.EFBIG, f"has over {limit} bytes", str(path))
        return opened.read(limit)


MAGIC = "robot-energy-registers"
MAX_BYTES = 16 * 1024 * 1024  # of a payload; 49 totals of a thousand joints
MAX_SEQUENCE = 10**18 - 1  # the number after it is 1
MAX_LINE = 200
_LINE = re.compile(
    rb"robot-energy-registers version=(\d{1,9}) sequence=(\d{1,18}) bytes=(\d{1,9}) "
    rb"crc32=([0-9a-f]{8})\n"
)


def wrap(version: int, sequence: int, payload: bytes) -> bytes:
    """Return the content of a state file."""
    if len(payload) > MAX_BYTES:
        raise StateFileError(f"a state of {len(payload)} bytes", f"at most {MAX_BYTES}")
    line = f"{MAGIC} version={version} sequence={sequence} bytes={len(payload)}".encode()
    check = zlib.crc32(payload, zlib.crc32(line))
    return line + f" crc32={check:08x}\n".encode() + payload


def follows(sequence: int) -> int:
    """Return the sequence number after one; after the largest comes 1."""
    return sequence % MAX_SEQUENCE + 1


def is_newer(sequence: int, other: int) -> bool:
    """Whether a sequence number comes after another, also where the numbers began again at 1."""
    return sequence != other and (sequence - other) % MAX_SEQUENCE < MAX_SEQUENCE // 2


def unwrap(version: int, content: bytes) -> tuple[int, bytes]:
    """Return sequence number and payload of a state file.

    What stands behind the payload is ignored: a shorter state may lie over a longer one.
    """
    if not content:
        raise StateFileError("an empty file", "a state file")
    found = _LINE.match(content[:MAX_LINE])
    if found is None:
        raise StateFileError("a file without the first line of a state file", "a state file")
    number, sequence, size = (int(found[group]) for group in (1, 2, 3))
    payload = content[found.end() : found.end() + size]
    if len(payload) < size:
        raise StateFileError(f"a file cut after {len(payload)} bytes", f"{size}")
    if wrap(number, sequence, payload) != content[: found.end() + size]:
        raise StateFileError("a damaged file, whose CRC does not fit", "the CRC in its first line")
    if number != version:
        raise StateFileError(
            f"a state file of format {number}", f"format {version}", "use the release that wrote it"
        )
    return sequence, payload
