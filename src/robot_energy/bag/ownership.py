"""Which bags this library wrote: only these are replaced."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from robot_energy.bag.metadata import FILE_NAME
from robot_energy.foundation.files.first_bytes import MCAP

LIBRARY = "robot_energy"  # in the header of every MCAP file that `BagWriter` makes
_HEADER = 1  # opcode
_MAX_HEADER_BYTES = 512
_MAX_METADATA_BYTES = 2**20
_METADATA_START = b"rosbag2_bagfile_information:"


def foreign_entries(folder: Path) -> list[str]:
    """Return what in a folder is not of one bag of this library: an MCAP file and metadata."""
    names = sorted(entry.name for entry in folder.iterdir())
    own = [name for name in names if name.endswith(".mcap") and _is_own(folder / name)]
    if len(own) == 1 and _describes(folder / FILE_NAME, own[0]):
        own.append(FILE_NAME)
        return [name for name in names if name not in own]
    return names


def _is_own(path: Path) -> bool:
    start = _start(path, _MAX_HEADER_BYTES)
    if not start.startswith(MCAP) or start[8:9] != bytes([_HEADER]):
        return False
    _, rest = _text(start[17:])  # profile and library, behind the length of the record
    library, _ = _text(rest)
    return library == LIBRARY.encode()


def _text(data: bytes) -> tuple[bytes, bytes]:
    """A text behind its length, and what follows it."""
    end = 4 + int.from_bytes(data[:4], "little")
    return data[4:end], data[end:]


def _describes(path: Path, name: str) -> bool:
    text = _start(path, _MAX_METADATA_BYTES)
    return text.startswith(_METADATA_START) and name.encode("utf-8", "surrogateescape") in text


def _start(path: Path, size: int) -> bytes:
    """The first bytes of a plain file; none of anything else."""
    try:
        if not stat.S_ISREG(os.lstat(path).st_mode):
            return b""
        number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return b""
    with os.fdopen(number, "rb") as file:
        return file.read(size)
