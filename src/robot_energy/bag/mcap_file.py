"""One MCAP file, read block by block in constant memory, as far as it is whole."""

from __future__ import annotations

import zlib
from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag import mcap_records as records
from robot_energy.bag.mcap_block import Block, indexed_block, walked_block
from robot_energy.bag.mcap_records import FRAME, RecordError
from robot_energy.errors import BagError

_LOOSE_BYTES = 2**20
_LOOSE_MESSAGES = 8192
"""Messages outside chunks are read in blocks of at most these. [bytes], [messages]"""

MAX_DEFINITIONS = 32 * 2**20
"""Definitions of messages and channels kept of one file, beside its summary. [bytes]"""

Report = Callable[[str], None]


@dataclass(slots=True)
class Summary:
    """What the end of the file says about the whole."""

    schemas: dict[int, records.Schema] = field(default_factory=dict[int, records.Schema])
    channels: dict[int, records.Channel] = field(default_factory=dict[int, records.Channel])
    chunks: dict[int, records.ChunkIndex] = field(default_factory=dict[int, records.ChunkIndex])
    statistics: records.Statistics | None = None


class McapFile:
    """One MCAP file.

    Attributes:
        path: The file.
        size: Its size. [bytes]
        schemas: Message definitions met so far, by id.
        channels: Channels met so far, by id.
        summary: The summary at the end of the file; None if there is none or it is damaged.

    Args:
        path: The file.
        report: Takes one sentence for each thing found wrong while reading.

    Raises:
        BagError: If the file cannot be opened or is no MCAP file.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self.path = path
        self._report_to = report
        self.schemas: dict[int, records.Schema] = {}
        self.channels: dict[int, records.Channel] = {}
        self.summary: Summary | None = None
        self._closed = False
        if not path.is_file():  # a pipe would be waited for
            raise BagError(f"{path} cannot be read", "a file")
        try:
            self.size = path.stat().st_size
            with path.open("rb") as file:
                magic = file.read(len(records.MAGIC))
                if magic == records.MAGIC:
                    self.summary = self._read_summary(file)
        except OSError as error:
            raise BagError(f"{path} cannot be read ({error.strerror})") from error
        if magic != records.MAGIC:
            found = "is empty" if not magic else f"begins with {magic!r}"
            raise BagError(f"{path} {found}", f"an MCAP file, which begins with {records.MAGIC!r}")
        self._starts = sorted(self.summary.chunks) if self.summary else []
        self._room = MAX_DEFINITIONS
        if self.summary is not None:
            self.schemas.update(self.summary.schemas)
            self.channels.update(self.summary.channels)

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[Block]:
        """Yield the chunks, and runs of messages outside chunks, in file order.

        Args:
            topics: Topics that matter; chunks known to hold none of them are left out. None for
                everything.

        Yields:
            Blocks with at least one message.
        """
        pos, count, left_out = len(records.MAGIC), 0, False
        known_channels = self.summary is not None and bool(self.summary.channels)
        known, wanted = 0, set[int]()
        try:
            with self.path.open("rb", buffering=2**18) as file:
                while pos < self.size:
                    indexed = self.summary.chunks.get(pos) if self.summary else None
                    if indexed and topics is not None and known_channels:
                        if len(self.channels) != known:
                            known = len(self.channels)
                            wanted = {c.id for c in self.channels.values() if c.topic in topics}
                        if indexed.channels and indexed.channels.isdisjoint(wanted):
                            pos, left_out = max(indexed.end, pos + 1), True
                            continue
                    try:
                        opcode, block, following = self._step(file, pos)
                        if indexed and opcode != records.CHUNK:
                            raise RecordError("no chunk, though the summary lists one,")
                    except RecordError as error:
                        resume = self._next_chunk(pos)
                        self._report(self._cut(error, pos, count, resume))
                        if resume is None:
                            return
                        pos, left_out = resume, True
                        continue
                    if block is not None and block.count:
                        count += block.count
                        yield block
                        block = None
                    if opcode in (records.DATA_END, records.FOOTER):
                        self._compare(None if left_out else count)
                        return
                    pos = following
        except OSError as error:
            self._report(f"reading stopped at byte {pos} of {self.size} ({error.strerror})")
            return
        self._report(
            f"the file ends at byte {self.size} without its closing records; {count} messages "
            "before it were read"
        )

    def _compare(self, count: int | None) -> None:
        """Compare what was read up to the end of the data with what the file says of itself."""
        if not self._closed:
            self._report("the closing part of the file is damaged or missing")
        statistics = self.summary.statistics if self.summary else None
        if count is not None and statistics and count != statistics.message_count:
            self._report(
                f"{count} messages were read where the summary counts {statistics.message_count}"
            )

    def _step(self, file: BinaryIO, pos: int) -> tuple[int, Block | None, int]:
        """Read the record at ``pos``: opcode, block if it holds messages, where to go on."""
        opcode, length = self._frame(file, pos)
        body = pos + FRAME.size
        if opcode in (records.MESSAGE, records.SCHEMA, records.CHANNEL):
            self._whole(length, body, opcode)
            return self._loose(file, pos, FRAME.size + length)
        if opcode == records.CHUNK:
            self._whole(length, body, opcode)
            data = memoryview(file.read(length))
            index, following = self._indexes(file, body + length)
            return opcode, self._chunk(data, index, pos), following
        if opcode not in (records.DATA_END, records.FOOTER):
            if not (
                records.HEADER <= opcode <= records.DATA_END or opcode >= records.FIRST_PRIVATE
            ):
                raise RecordError(f"a record of unknown kind {opcode}")
            self._whole(length, body, opcode, limit=False)
        return opcode, None, body + length

    def _frame(self, file: BinaryIO, pos: int) -> tuple[int, int]:
        file.seek(pos)
        head = file.read(FRAME.size)
        if len(head) < FRAME.size:
            raise EndOfFileError("a record")
        return FRAME.unpack(head)

    def _whole(self, length: int, body: int, opcode: int, limit: bool = True) -> None:
        if length > self.size - body:
            raise EndOfFileError("a chunk" if opcode == records.CHUNK else "a record")
        if limit and length > records.SIZE_LIMIT:
            raise RecordError(f"a record of {length} bytes, more than {records.SIZE_LIMIT}")

    def _loose(self, file: BinaryIO, pos: int, first: int) -> tuple[int, Block | None, int]:
        """Read messages that lie outside chunks."""
        file.seek(pos)
        data = file.read(max(_LOOSE_BYTES, first))
        block = walked_block(data, self._on_record, _LOOSE_MESSAGES)
        if block.end == 0:
            raise RecordError("a message record too short for its own fields")
        return records.MESSAGE, block, pos + block.end

    def _indexes(self, file: BinaryIO, pos: int) -> tuple[dict[int, NDArray[np.uint64]], int]:
        """Read the MessageIndex records after a chunk; damaged ones are left to the walk."""
        index: dict[int, NDArray[np.uint64]] = {}
        total = 0
        while self.size - pos >= FRAME.size:
            opcode, length = self._frame(file, pos)
            if opcode != records.MESSAGE_INDEX or length > self.size - pos - FRAME.size:
                break
            pos += FRAME.size + length
            total += length
            if total > records.SIZE_LIMIT:
                continue
            try:
                channel, pairs = records.parse_message_index(memoryview(file.read(length)))
            except RecordError:
                continue
            if len(pairs):
                index[channel] = np.frombuffer(pairs, dtype="<u8").reshape(-1, 2)
        return index, pos

    def _chunk(
        self, data: memoryview, index: dict[int, NDArray[np.uint64]], pos: int
    ) -> Block | None:
        try:
            chunk = records.parse_chunk(data)
            content = records.unpack_chunk(chunk)
        except RecordError as error:
            self._report(f"the chunk at byte {pos} was left out: it holds {error}")
            return None
        block = indexed_block(content, index, self._on_record)
        if block is None:
            block = self._walk_chunk(memoryview(content), pos)
        block.verified = chunk.crc != 0
        return block

    def _walk_chunk(self, content: memoryview, pos: int) -> Block:
        block = walked_block(content, self._on_record)
        if block.end < len(content):
            self._report(
                f"the chunk at byte {pos} holds an unreadable record after {block.count} messages; "
                "its rest was left out"
            )
        return block

    def _on_record(self, opcode: int, data: memoryview) -> None:
        try:
            if opcode == records.SCHEMA:
                key, schema = records.parse_schema(data)
                self._make_room(data, key in self.schemas)
                if self.schemas.setdefault(key, schema) != schema:
                    self._report(f"schema {key} is defined twice; the first one was used")
            else:
                channel = records.parse_channel(data)
                self._make_room(data, channel.id in self.channels)
                if self.channels.setdefault(channel.id, channel) != channel:
                    self._report(f"channel {channel.id} is defined twice; the first one was used")
        except RecordError as error:
            self._report(f"a schema or channel record was left out: it holds {error}")

    def _make_room(self, data: memoryview, known: bool) -> None:
        """Refuse definitions that would fill the memory."""
        if not known:
            self._room -= len(data)
        if self._room < 0:
            raise RecordError(f"more than {MAX_DEFINITIONS} bytes of definitions")

    def _next_chunk(self, pos: int) -> int | None:
        """Return where the summary says a chunk starts after ``pos``."""
        index = bisect_right(self._starts, pos)
        return self._starts[index] if index < len(self._starts) else None

    def _cut(self, error: RecordError, pos: int, count: int, resume: int | None) -> str:
        if resume is not None:
            return f"bytes {pos} to {resume} were left out: {error.args[0]} lies there"
        if isinstance(error, EndOfFileError):
            return (
                f"the file ends inside {error.args[0]} at byte {pos} of {self.size}; {count} "
                "messages before it were read"
            )
        return (
            f"reading stopped at byte {pos} of {self.size}, where {error.args[0]} lies; {count} "
            "messages before it were read"
        )

    def _read_summary(self, file: BinaryIO) -> Summary | None:
        """Read and check the summary section."""
        tail_start = self.size - records.FOOTER_SIZE - len(records.MAGIC)
        if tail_start < len(records.MAGIC):
            return None
        file.seek(tail_start)
        tail = file.read()
        opcode, length = FRAME.unpack_from(tail)
        if tail[-8:] != records.MAGIC or opcode != records.FOOTER or length != 20:
            return None
        self._closed = True
        start = int.from_bytes(tail[9:17], "little")
        if not len(records.MAGIC) <= start < tail_start or tail_start - start > records.SIZE_LIMIT:
            if start:
                self._report("the summary is not where the end of the file says; it was not used")
            return None
        file.seek(start)
        data = file.read(tail_start - start)
        crc = int.from_bytes(tail[25:29], "little")
        if crc and zlib.crc32(tail[:25], zlib.crc32(data)) != crc:
            self._report("the summary does not match its checksum; it was not used")
            return None
        try:
            return _parse_summary(memoryview(data))
        except RecordError as error:
            self._report(f"the summary was not used: it holds {error}")
            return None

    def _report(self, sentence: str) -> None:
        self._report_to(f"{self.path.name}: {sentence}")


class EndOfFileError(RecordError):
    """The file ends inside a record."""


def _parse_summary(data: memoryview) -> Summary:
    summary = Summary()
    pos = 0
    while pos < len(data):
        if len(data) - pos < FRAME.size:
            raise RecordError("a cut record")
        opcode, length = FRAME.unpack_from(data, pos)
        body = data[pos + FRAME.size : pos + FRAME.size + length]
        if len(body) != length:
            raise RecordError("a cut record")
        if opcode == records.SCHEMA:
            key, schema = records.parse_schema(body)
            summary.schemas[key] = schema
        elif opcode == records.CHANNEL:
            channel = records.parse_channel(body)
            summary.channels[channel.id] = channel
        elif opcode == records.CHUNK_INDEX:
            chunk = records.parse_chunk_index(body)
            summary.chunks[chunk.start] = chunk
        elif opcode == records.STATISTICS:
            summary.statistics = records.parse_statistics(body)
        pos += FRAME.size + length
    return summary
