"""What rosbag2 packed itself, message by message or file by file, unpacked within bounds."""

from __future__ import annotations

import os
import weakref
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.sources import McapSource, Report
from robot_energy.bag.sqlite_source import MAX_MESSAGE_BYTES, MAX_VALUE_BYTES, SqliteSource
from robot_energy.foundation.errors import BagError
from robot_energy.foundation.files.first_bytes import MAX_MAGIC, MCAP, SQLITE, named
from robot_energy.foundation.files.regular_file import open_regular
from robot_energy.foundation.files.temporary_folder import TemporaryFolder

MAX_RATIO = 1000  # how many times larger a file may become; 40 joints at rest shrink to a 130th
MAX_UNPACKED_BYTES = 16 * 2**30
"""Of one file: 30 hours of six joints at 500 Hz; recorders begin a new file long before."""
MIN_FREE_BYTES = 2**30  # what is left free on the disk, or a tenth of a small one
_PIECE = 2**20

Source = McapSource | SqliteSource


def open_file(path: Path, report: Report) -> Source:
    """Return the source that reads a file: ``.db3`` is SQLite, everything else MCAP."""
    return SqliteSource(path, report) if path.suffix == ".db3" else McapSource(path, report)


def unpacked_parts(
    parts: Iterable[dict[str, RawBatch]], report: Report
) -> Iterator[dict[str, RawBatch]]:
    """Yield parts of a bag whose messages are each packed with zstd, unpacked."""
    for part in parts:
        unpacked = {topic: _unpacked(packed, report) for topic, packed in part.items()}
        yield {topic: batch for topic, batch in unpacked.items() if len(batch)}


def _unpacked(batch: RawBatch, report: Report) -> RawBatch:
    import zstandard

    unpacker = zstandard.ZstdDecompressor()
    times: list[int] = []
    rows: list[bytes] = []
    room = 4 * MAX_MESSAGE_BYTES  # for all messages of a part
    for i, time in enumerate(batch.log_time_ns.tolist()):
        try:
            row = unpacker.stream_reader(batch.row(i)).read(room + 1)
        except zstandard.ZstdError:
            row = b""
        if not row or len(row) > room:
            report(f"messages of {batch.topic} that cannot be unpacked were left out")
            continue
        room -= len(row)
        times.append(time)
        rows.append(row)
    return RawBatch.from_messages(batch.topic, batch.msgtype, times, rows)


def unpacked_file(path: Path, report: Report) -> Source:
    """Return the source of a file packed as a whole with zstd, unpacked into a temporary folder.

    The folder goes when the source does, or the process.
    """
    try:
        folder = TemporaryFolder()
    except OSError as error:
        raise BagError(f"{path} cannot be unpacked ({error})", "a temporary folder") from error
    target = folder.path / path.stem
    try:
        _unpack_file(path, target)
        source = open_file(target, report)
    except BaseException:
        folder.remove()
        raise
    weakref.finalize(source, folder.__exit__)  # which holds the folder until then
    return source


def _unpack_file(path: Path, target: Path) -> None:
    """Unpack it twice: the first time only to count, so that nothing is written in vain."""
    import zstandard

    try:
        with open_regular(path) as packed:
            left = _unpacked_bytes(path, packed)
            _check_room(path, target.parent, left)
            packed.seek(0)
            with target.open("xb") as file:
                for piece in _pieces(packed):
                    left -= len(piece)
                    if left < 0:
                        raise BagError(f"{path} changed while it was read", "a finished recording")
                    _check_room(path, target.parent, len(piece))
                    file.write(piece)
    except (OSError, zstandard.ZstdError) as error:
        raise BagError(f"{path} cannot be unpacked ({error})", "a file packed with zstd") from error


def _unpacked_bytes(path: Path, packed: BinaryIO) -> int:
    size = os.fstat(packed.fileno()).st_size
    most = min(max(size * MAX_RATIO, MAX_VALUE_BYTES), MAX_UNPACKED_BYTES)
    count = 0
    for piece in _pieces(packed):
        if not count and not piece.startswith((MCAP, SQLITE)):
            found, remedy = named(path, piece[:MAX_MAGIC])
            raise BagError(f"unpacked, {found}", "an MCAP or SQLite file of rosbag2", remedy)
        count += len(piece)
        if count > most:
            raise BagError(
                f"{path} unpacks to over {most} bytes; nothing was written",
                f"at most {MAX_RATIO} times its size, or {MAX_VALUE_BYTES} bytes if that is more, "
                f"and {MAX_UNPACKED_BYTES} bytes in any case",
                "unpack it with zstd -d if it is really a recording",
            )
    return count


def _pieces(packed: BinaryIO) -> Iterator[bytes]:
    import zstandard

    unpacker = zstandard.ZstdDecompressor()
    reader = unpacker.stream_reader(packed, read_across_frames=True, closefd=False)
    while piece := reader.read(_PIECE):
        yield piece


def _check_room(path: Path, folder: Path, size: int) -> None:
    disk = os.statvfs(folder)
    reserve = min(MIN_FREE_BYTES, disk.f_blocks * disk.f_frsize // 10)
    free = disk.f_bavail * disk.f_frsize
    if free - size < reserve:
        raise BagError(
            f"{path} cannot be unpacked: {folder.parent} has {free} bytes free",
            f"what it unpacks to and {reserve} bytes that are left free",
            "free space there, or set TMPDIR to a folder on another disk",
        )
