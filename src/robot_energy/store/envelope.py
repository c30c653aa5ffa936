"""One state file: a line of text that guards what follows, and the JSON it guards.

The line names format, sequence number, length and CRC-32; the CRC covers the line itself
as well. ``head -1`` shows it, ``tail -n +2`` gives plain JSON.
"""

from __future__ import annotations

import re
import zlib

from robot_energy.foundation.errors import StateFileError

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

    Args:
        content: All bytes of the file; what stands behind the payload is ignored, since a
            shorter state may have been written over a longer one.
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
