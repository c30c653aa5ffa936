"""MCAP records and summary as far as a reader of ROS 2 bags needs them (https://mcap.dev/spec)."""

from __future__ import annotations

import zlib
from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from struct import Struct, unpack_from
from typing import Annotated, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from robot_energy.physics import kernels

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA = range(0x09, 0x0D)
METADATA_INDEX, SUMMARY_OFFSET = 0x0D, 0x0E
DATA_END = 0x0F
FIRST_PRIVATE = 0x80

FRAME = Struct("<BQ")  # start of every record: opcode, length of the rest
FOOTER_SIZE = FRAME.size + 20
MESSAGE_FIXED = 22  # bytes of a Message record before its message, without the frame
MAX_RECORD_BYTES = 64 * 2**20  # largest record, and largest unpacked chunk, that is read [bytes]


class RecordError(Exception):
    """A record does not hold what its opcode says; never leaves this package."""


@dataclass(frozen=True, slots=True)
class Schema:
    """A message definition: its name, its encoding (``ros2msg``) and its text."""

    name: str
    encoding: str
    text: str


@dataclass(frozen=True, slots=True)
class McapChannel:
    """One publisher's stream on a topic."""

    schema_id: int
    topic: str
    encoding: str


LogTimes = tuple[int, int]  # first and last log time of a stretch, both included [ns]


@dataclass(frozen=True, slots=True)
class ChunkIndex:
    """Where a chunk lies in the file, its length and end with what follows it, what it holds."""

    start: int
    length: int
    end: int
    channels: frozenset[int]
    start_ns: int
    end_ns: int


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts of the whole file. Times in [ns]."""

    message_count: int
    start_ns: int
    end_ns: int
    channel_counts: dict[int, int]


class _Cursor:
    """Reads little-endian values one after another."""

    def __init__(self, data: memoryview) -> None:
        self.data = data
        self.pos = 0

    def take(self, count: int) -> memoryview:
        part = self.data[self.pos : self.pos + count]
        if len(part) != count:
            raise RecordError("a length beyond the end of the record")
        self.pos += count
        return part

    def number(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")

    def sized(self, size: int = 4) -> memoryview:
        return self.take(self.number(size))

    def text(self) -> str:
        try:
            return str(self.sized(), "utf-8")
        except UnicodeDecodeError:
            raise RecordError("a text that is not UTF-8") from None


def parse_schema(data: memoryview) -> tuple[int, Schema]:
    cursor = _Cursor(data)
    schema_id = cursor.number(2)
    name, encoding = cursor.text(), cursor.text()
    return schema_id, Schema(ros_type(name), encoding, str(cursor.sized(), "utf-8", "replace"))


def parse_channel(data: memoryview) -> tuple[int, McapChannel]:
    cursor = _Cursor(data)
    channel_id = cursor.number(2)
    return channel_id, McapChannel(cursor.number(2), cursor.text(), cursor.text())


def parse_chunk_index(data: memoryview) -> ChunkIndex:
    cursor = _Cursor(data)
    start_ns, end_ns = cursor.number(8), cursor.number(8)
    start, length = cursor.number(8), cursor.number(8)
    offsets = cursor.sized()
    channels = frozenset(
        unpack_from("<H", offsets, i)[0] for i in range(0, len(offsets) // 10 * 10, 10)
    )
    end = start + length + cursor.number(8)
    return ChunkIndex(start, length, end, channels, start_ns, end_ns)


def parse_statistics(data: memoryview) -> Statistics:
    cursor = _Cursor(data)
    count, _, _, _, _, _, start, end = unpack_from("<QHIIIIQQ", cursor.take(42))
    pairs = cursor.sized()
    counts = dict(unpack_from("<HQ", pairs, i) for i in range(0, len(pairs) // 10 * 10, 10))
    return Statistics(count, start, end, counts)


def ros_type(name: str) -> str:
    """Return a message type with its ``msg`` part, which some writers leave out."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def unpack_chunk(record: memoryview) -> tuple[bytes | memoryview, bool]:
    """Return the records of a Chunk record, of the size that it declares, and if it has a CRC."""
    cursor = _Cursor(record)
    cursor.take(16)
    size, crc, compression = cursor.number(8), cursor.number(4), cursor.text()
    data: bytes | memoryview = cursor.sized(8)
    if size > MAX_RECORD_BYTES:
        raise RecordError(f"{size} bytes unpacked, more than the limit of {MAX_RECORD_BYTES}")
    if compression not in ("", "zstd", "lz4"):
        raise RecordError(f"the unknown compression {compression!r}")
    if compression:
        data = _unpack_zstd(data, size) if compression == "zstd" else _unpack_lz4(data, size)
    if len(data) != size:
        raise RecordError(f"other than the {size} bytes it declares")
    if crc and zlib.crc32(data) != crc:
        raise RecordError("bytes that do not match its checksum")
    return data, crc != 0


def _unpack_zstd(data: memoryview, size: int) -> bytes:
    import zstandard

    try:
        if zstandard.frame_content_size(data) == size:
            return zstandard.ZstdDecompressor().decompress(data)
        reader = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
        return reader.read(size + 1)
    except zstandard.ZstdError as error:
        raise RecordError(f"damaged zstd data ({error})") from None


def _unpack_lz4(data: memoryview, size: int) -> bytes:
    import lz4.frame

    try:
        unpacker = cast("Any", lz4.frame.LZ4FrameDecompressor())
        return bytes(unpacker.decompress(data, max_length=size + 1))
    except (RuntimeError, EOFError, ValueError) as error:
        raise RecordError(f"damaged lz4 data ({error})") from None


MAX_CHUNKS = 500_000  # chunks that a summary may list: some 400 GB as rosbag2 writes them
IN_SUMMARY = {
    SCHEMA, CHANNEL, CHUNK_INDEX, STATISTICS,
    ATTACHMENT_INDEX, METADATA_INDEX, SUMMARY_OFFSET,
}  # fmt: skip


class _DataError(RecordError):
    """What should be the summary holds records of the data."""


@dataclass(slots=True)
class Summary:
    """Definitions, chunks by their first byte, and counts."""

    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    channels: dict[int, McapChannel] = field(default_factory=dict[int, McapChannel])
    chunks: dict[int, ChunkIndex] = field(default_factory=dict[int, ChunkIndex])
    statistics: Statistics | None = None

    @property
    def defines_all(self) -> bool:
        """Whether it defines every channel that its counts and chunks name, and their types."""
        known = self.channels.keys()
        if any(channel.schema_id not in self.schemas for channel in self.channels.values()):
            return False
        counted = self.statistics.channel_counts.keys() if self.statistics else ()
        return all(channel in known for channel in counted) and all(
            channel in known for chunk in self.chunks.values() for channel in chunk.channels
        )


@dataclass(slots=True)
class Closing:
    """The end of a file."""

    footer: Annotated[int | None, "First byte of the closing record; None if there is none."] = None
    data_end: Annotated[int | None, "First byte after the data; None if the file does not say."] = (
        None
    )
    summary: Annotated[
        Summary | None, "The summary; None if there is none or it cannot be used."
    ] = None


def read_closing(file: BinaryIO, size: int, report: Callable[[str], None]) -> Closing:
    """Return what can be used of the end of a file."""
    closing = Closing()
    footer = size - FOOTER_SIZE - len(MAGIC)
    if footer < len(MAGIC):
        return closing
    file.seek(footer)
    tail = file.read(FOOTER_SIZE + len(MAGIC)).ljust(FOOTER_SIZE)  # it may be shorter now
    opcode, length = FRAME.unpack_from(tail)
    if tail[-8:] != MAGIC or opcode != FOOTER or length != 20:
        return closing
    closing.footer = footer
    start = int.from_bytes(tail[9:17], "little")
    if not start:
        closing.data_end = footer
        return closing
    if not len(MAGIC) <= start < footer or footer - start > MAX_RECORD_BYTES:
        report("the summary is not where the end of the file says; it was not used")
        return closing
    closing.data_end = start
    file.seek(start)
    data = file.read(footer - start)
    if MAGIC in data:  # of a file behind this one
        closing.data_end = None
    crc = int.from_bytes(tail[25:29], "little")
    if crc and zlib.crc32(tail[:25], zlib.crc32(data)) != crc:
        report("the summary does not match its checksum; it was not used")
        return closing
    try:
        closing.summary = _parse(memoryview(data), start, report)
    except _DataError as error:
        closing.data_end = None
        report(f"the summary was not used: it holds {error}")
    except RecordError as error:
        report(f"the summary was not used: it holds {error}")
    return closing


def _parse(data: memoryview, start: int, report: Callable[[str], None]) -> Summary:
    summary = Summary()
    chunks: list[ChunkIndex] = []
    pos = 0
    while pos < len(data):
        if len(data) - pos < FRAME.size:
            raise RecordError("a cut record")
        opcode, length = FRAME.unpack_from(data, pos)
        body = data[pos + FRAME.size : pos + FRAME.size + length]
        if len(body) != length:
            raise RecordError("a cut record")
        if opcode == SCHEMA:
            summary.schemas.update([parse_schema(body)])
        elif opcode == CHANNEL:
            summary.channels.update([parse_channel(body)])
        elif opcode == CHUNK_INDEX:
            chunks.append(parse_chunk_index(body))
            if len(chunks) > MAX_CHUNKS:
                raise RecordError(f"over {MAX_CHUNKS} chunks")
        elif opcode == STATISTICS:
            summary.statistics = parse_statistics(body)
        elif opcode not in IN_SUMMARY and opcode < FIRST_PRIVATE:
            raise _DataError(f"a record of kind {opcode}, which belongs to the data")
        pos += FRAME.size + length
    summary.chunks = _apart(chunks, start, report)
    return summary


def _apart(
    chunks: Iterable[ChunkIndex], data_end: int, report: Callable[[str], None]
) -> dict[int, ChunkIndex]:
    """Return the chunks that lie in the data, each behind the one before it."""
    kept: dict[int, ChunkIndex] = {}
    wrong, end = 0, len(MAGIC)
    for chunk in sorted(chunks, key=lambda chunk: chunk.start):
        if chunk.start < end or chunk.end > data_end or chunk.length < FRAME.size:
            wrong += 1
            continue
        kept[chunk.start] = chunk
        end = chunk.end
    if wrong:
        report(
            f"{wrong} chunks that the summary lists overlap others or lie outside of the data; "
            "these entries were not used"
        )
    return kept


_HEAD = FRAME.size + MESSAGE_FIXED
_MESSAGE_HEAD = Struct("<HIQ")
MAX_DEFINITIONS = 1000  # schemas and channels in a block that the kernel takes

OnRecord = Callable[[int, memoryview], None]
"""Called with opcode and content of each Schema and Channel record on the way."""


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages of one channel in file order: log time [ns], first byte and length, each (n,)."""

    log_time_ns: NDArray[np.int64]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]


@dataclass(slots=True)
class McapChunk:
    """A block of records that was looked through."""

    buffer: NDArray[np.uint8]
    messages: dict[int, Messages] = field(default_factory=dict[int, Messages])
    end: Annotated[int, "First byte after the last whole record that belongs here."] = 0
    count: int = 0
    verified: bool = False


def walked_block(
    data: bytes | memoryview, on_record: OnRecord, limit: int | None = None
) -> McapChunk:
    """Find the messages of a block of records one after another.

    Returns:
        The block; its ``end`` is where a record begins that is cut off, is no Schema, Channel or
        Message, or is beyond the limit.
    """
    view = memoryview(data)
    if kernels.compiled is not None:
        block = _compiled_walk(view, on_record, len(view) if limit is None else limit)
        if block is not None:
            return block
    found: dict[int, array[int]] = {}  # time, place and length of each message, flat
    pos, count = 0, 0
    while len(view) - pos >= FRAME.size and (limit is None or count < limit):
        opcode, length = FRAME.unpack_from(view, pos)
        body = pos + FRAME.size
        if opcode not in (MESSAGE, SCHEMA, CHANNEL) or length > len(view) - body:
            break
        if opcode == MESSAGE:
            if length < MESSAGE_FIXED:
                break
            channel, _, log = _MESSAGE_HEAD.unpack_from(view, body)
            flat = found.get(channel)
            if flat is None:
                flat = found[channel] = array("Q")
            flat.extend((log, body + MESSAGE_FIXED, length - MESSAGE_FIXED))
            count += 1
        else:
            on_record(opcode, view[body : body + length])
        pos = body + length
    block = McapChunk(np.frombuffer(data, dtype=np.uint8), end=pos, count=count)
    for channel, flat in found.items():
        columns = np.frombuffer(flat, dtype=np.uint64).reshape(-1, 3).T.astype(np.int64)
        block.messages[channel] = Messages(*columns)
    return block


def _compiled_walk(view: memoryview, on_record: OnRecord, limit: int) -> McapChunk | None:
    """Do the same with the kernel; None where the block has more definitions than it takes."""
    assert kernels.compiled is not None
    table = np.empty((4, min(limit, len(view) // _HEAD)), dtype=np.int64)
    others = np.empty(MAX_DEFINITIONS, dtype=np.int64)
    count, met, end = kernels.compiled.messages(view, table, others, limit)
    if met == MAX_DEFINITIONS:
        return None
    for pos in others[:met].tolist():
        opcode, length = FRAME.unpack_from(view, pos)
        on_record(opcode, view[pos + FRAME.size : pos + FRAME.size + length])
    block = McapChunk(np.frombuffer(view, dtype=np.uint8), end=end, count=count)
    owner, places = table[0, :count], table[1:, :count]
    for channel in np.flatnonzero(np.bincount(owner)).tolist():
        mine = owner == channel
        block.messages[channel] = Messages(*(places if mine.all() else places[:, mine]))
    return block
