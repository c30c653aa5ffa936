"""What rosbag2 packed itself, message by message or file by file, unpacked within bounds."""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Iterator
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from robot_energy.bag.sources import Contents, McapSource, Report
from robot_energy.bag.sqlite_source import LARGEST_MESSAGE, LARGEST_VALUE, SqliteSource
from robot_energy.errors import BagError
from robot_energy.wire.batch import RawBatch

if TYPE_CHECKING:
    import zstandard

MAX_RATIO = 1000
"""How many times larger a file may become; recordings shrink to a tenth, rarely a hundredth."""
_PIECE = 2**20

Source = McapSource | SqliteSource


def open_file(path: Path, report: Report) -> Source:
    """Return the source that reads a file.

    Raises:
        BagError: If it is no bag file.
    """
    return SqliteSource(path, report) if path.suffix == ".db3" else McapSource(path, report)


class PackedMessages:
    """Messages each packed with zstd.

    Args:
        source: What delivers them packed.
        report: Takes one sentence per thing found wrong.
    """

    def __init__(self, source: Source, report: Report) -> None:
        self._source = source
        self._report = report

    @property
    def unverified_count(self) -> int:
        """Messages delivered so far that no checksum in the bag covers."""
        return self._source.unverified_count

    def contents(self) -> Contents:
        """Return what the file holds.

        Raises:
            BagError: If it cannot be read.
        """
        return self._source.contents()

    def parts(self, topics: dict[str, str]) -> Iterator[dict[str, RawBatch]]:
        """Yield the messages of some topics, unpacked.

        Args:
            topics: Message type by topic.

        Yields:
            One batch per topic that has messages in the part.
        """
        import zstandard

        unpacker = zstandard.ZstdDecompressor()
        for part in self._source.parts(topics):
            unpacked = {
                topic: batch
                for topic, packed in part.items()
                if len(batch := self._unpacked(packed, unpacker))
            }
            if unpacked:
                yield unpacked

    def _unpacked(self, batch: RawBatch, unpacker: zstandard.ZstdDecompressor) -> RawBatch:
        import zstandard

        times: list[int] = []
        rows: list[bytes] = []
        room = 4 * LARGEST_MESSAGE  # for all messages of a part
        for i, time in enumerate(batch.log_time_ns.tolist()):
            try:
                row = unpacker.stream_reader(batch.row(i)).read(room + 1)
            except zstandard.ZstdError:
                row = b""
            if not row or len(row) > room:
                self._report(f"messages of {batch.topic} that cannot be unpacked were left out")
                continue
            room -= len(row)
            times.append(time)
            rows.append(row)
        return RawBatch.from_messages(batch.topic, batch.msgtype, times, rows)


class PackedFile:
    """A bag file packed as a whole with zstd, unpacked into a temporary folder.

    The folder goes when this object does, or the process.

    Args:
        path: The packed file.
        report: Takes one sentence per thing found wrong.

    Raises:
        BagError: If it cannot be unpacked, or what comes out is no bag file.
    """

    def __init__(self, path: Path, report: Report) -> None:
        folder = mkdtemp(prefix="robot_energy_")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        target = Path(folder) / path.stem
        _unpack_file(path, target)
        self._source = open_file(target, report)

    @property
    def unverified_count(self) -> int:
        """Messages delivered so far that no checksum in the bag covers."""
        return self._source.unverified_count

    def contents(self) -> Contents:
        """Return what the file holds.

        Raises:
            BagError: If it cannot be read.
        """
        return self._source.contents()

    def parts(self, topics: dict[str, str]) -> Iterator[dict[str, RawBatch]]:
        """Yield the messages of some topics.

        Args:
            topics: Message type by topic.

        Yields:
            One batch per topic that has messages in the part.
        """
        yield from self._source.parts(topics)


def _unpack_file(path: Path, target: Path) -> None:
    import zstandard

    try:
        most = max(path.stat().st_size * MAX_RATIO, LARGEST_VALUE)
        with path.open("rb") as packed, target.open("wb") as file:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            while piece := reader.read(_PIECE):
                if file.tell() + len(piece) > most:
                    raise BagError(
                        f"{path} unpacks to over {most} bytes",
                        f"at most {MAX_RATIO} times its size",
                    )
                file.write(piece)
    except (OSError, zstandard.ZstdError) as error:
        raise BagError(f"{path} cannot be unpacked ({error})", "a file packed with zstd") from error
