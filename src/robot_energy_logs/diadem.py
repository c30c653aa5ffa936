"""Recordings of DIAdem: a header (.dat) that names channels, and a file of binary values.

KUKA's controllers write their traces in this form: for each axis a header
``NAME_NextGenDrive#1.dat`` with its values in ``NAME_NextGenDrive#1.r64``. It was made from public
descriptions and has not been tried on a file of a controller.

Sources: NI DIAdem help, "DIAdem header file format"; the readers for KUKA traces of
github.com/xikuibin/KukaTraceHelper and github.com/antcsny/Data-collection-app-V2, which agree that
values stand row by row, as 64-bit numbers with the low byte first.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np

from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.files.regular_file import open_regular
from robot_energy.timeline.blocks import Float

MAGIC = b"DIAEXTENDED"
BEGIN, END = "#BEGINCHANNELHEADER", "#ENDCHANNELHEADER"
NAME, UNIT, KIND, FILE, STORED, TYPE = "200", "202", "210", "211", "213", "214"
COUNT, FIRST, SKIPPED, OFFSET, FACTOR, NO_VALUE = "220", "221", "222", "240", "241", "254"
EXPLICIT, IMPLICIT = ("EXPLIZIT", "EXPLICIT"), ("IMPLIZIT", "IMPLICIT")
TYPES = {
    **{"REAL64": "<f8", "REAL32": "<f4", "INT16": "<i2", "INT32": "<i4"},
    **{"WORD8": "u1", "WORD16": "<u2", "WORD32": "<u4"},
}
MAX_HEADER = 4 * 2**20  # bytes
MAX_VALUES = 24_000_000  # of all channels of one header


@dataclass(frozen=True)
class DiademChannel:
    """One channel.

    Attributes:
        unit: As the header says it, in the recorder's own words; may be empty.
        values: Shape (N,).
    """

    name: str
    unit: str
    values: Float


def read_diadem(path: Path) -> list[DiademChannel]:
    """Read all channels that a header names.

    Returns:
        Its channels, of one length: ``values = factor * stored + offset``, or
        ``start + step * row`` for a channel that is not stored, such as the time.

    Raises:
        LogFormatError: If a file cannot be read, or the header and its values do not agree.
    """
    entries = list(_channels(path))
    if not entries:
        raise LogFormatError(f"{path} names no channels", f"parts that begin with {BEGIN}")
    counts = [_whole(path, entry, COUNT) for entry in entries]
    if len(set(counts)) > 1 or sum(counts) > MAX_VALUES:
        raise LogFormatError(
            f"{path} has channels of {min(counts)} to {max(counts)} values",
            f"channels of one length, at most {MAX_VALUES} values together",
        )
    files: dict[str, bytes] = {}
    return [
        DiademChannel(entry[NAME], entry.get(UNIT, "").strip("[] "), _values(path, entry, files))
        for entry in entries
    ]


def _channels(path: Path) -> Iterator[dict[str, str]]:
    """Entries of each channel by their numbers."""
    with open_regular(path) as file:
        raw = file.read(MAX_HEADER + 1)
    if len(raw) > MAX_HEADER:
        raise LogFormatError(f"{path} has over {MAX_HEADER} bytes", "a header of DIAdem")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # as Windows writes it
    entries: dict[str, str] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        key, comma, value = line.strip().partition(",")
        if key == BEGIN:
            entries = {}
        elif key == END and entries is not None:
            if not entries.get(NAME):
                raise LogFormatError(
                    f"the channel that ends in line {number} of {path} has no name",
                    f"a line {NAME},",
                )
            yield entries
            entries = None
        elif entries is not None and comma:
            entries[key] = value.strip()
    if entries is not None:
        raise LogFormatError(f"{path} ends within a channel", f"a line {END}")


def _values(path: Path, entry: dict[str, str], files: dict[str, bytes]) -> Float:
    count = _whole(path, entry, COUNT)
    offset, factor = _number(path, entry, OFFSET, 0.0), _number(path, entry, FACTOR, 1.0)
    kind = entry.get(KIND, "")
    if kind in IMPLICIT:
        return offset + factor * np.arange(count)
    stored, name = entry.get(STORED, ""), entry.get(TYPE, "")
    known = kind in EXPLICIT and stored in ("BLOCK", "CHANNEL") and name in TYPES
    if not known or _number(path, entry, SKIPPED, 0.0) != 0.0:
        raise LogFormatError(
            f"{_of(path, entry)} is {kind or 'of no kind'}, {stored or 'not stored'}, {name}",
            f"a channel that is stored as BLOCK or CHANNEL, of {', '.join(TYPES)}",
            "save the recording again with DIAdem, or export it as CSV",
        )
    place = entry.get(FILE, "")
    if place not in files:
        files[place] = _content(path, PureWindowsPath(place).name)
    size = np.dtype(TYPES[name]).itemsize
    values = np.frombuffer(files[place], TYPES[name], len(files[place]) // size)
    first = _whole(path, entry, FIRST) - 1
    if stored == "BLOCK":
        width, rest = divmod(len(files[place]), max(count, 1) * size)
        good = not rest and 0 <= first < width
        found = values.reshape(count, width)[:, first] if good and count else values[:0]
    else:
        good = 0 <= first <= len(values) - count
        found = values[first : first + count]
    if not good and count:
        raise LogFormatError(
            f"{PureWindowsPath(place).name} has {len(files[place])} bytes, which {count} rows of "
            f"the channel '{entry[NAME]}' do not fit",
            f"the values that belong to {path}",
            "copy header and values again, both whole",
        )
    given = np.asarray(found, dtype=np.float64)
    if no_value := _number(path, entry, NO_VALUE, 0.0):
        given = np.where(given == no_value, np.nan, given)
    return given * factor + offset


def _content(path: Path, name: str) -> bytes:
    """Bytes of a file in the folder of the header; Windows does not distinguish cases."""
    siblings = {each.name.lower(): each for each in path.parent.iterdir()}
    found = siblings.get(name.lower())
    if not name or found is None:
        raise LogFormatError(
            f"{path} has its values in '{name}', which is not in {path.parent}",
            "both files in one folder",
            "copy the file of values too (.r64)",
        )
    with open_regular(found) as file:
        if file.seek(0, io.SEEK_END) > 8 * MAX_VALUES:
            raise LogFormatError(f"{found} has over {8 * MAX_VALUES} bytes", "a shorter recording")
        file.seek(0)
        return file.read()


def _number(path: Path, entry: dict[str, str], key: str, default: float) -> float:
    text = entry.get(key, "")
    try:
        value = float(text) if text else default
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise LogFormatError(f"entry {key} of {_of(path, entry)} is '{text}'", "a number")
    return value


def _whole(path: Path, entry: dict[str, str], key: str) -> int:
    value = _number(path, entry, key, -1.0)
    if value < 0 or value != int(value):
        raise LogFormatError(
            f"entry {key} of {_of(path, entry)} is '{entry.get(key, '')}'",
            "a whole number of 0 or more",
        )
    return int(value)


def _of(path: Path, entry: dict[str, str]) -> str:
    return f"the channel '{entry[NAME]}' of {path}"
