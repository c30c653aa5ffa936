"""Write MCAP records (https://mcap.dev/spec): messages as whole arrays, the rest by ``mcap``."""

from __future__ import annotations

import zlib
from collections import Counter
from struct import Struct
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.mcap_records import (
    FOOTER,
    FRAME,
    MAGIC,
    MESSAGE,
    MESSAGE_FIXED,
    MESSAGE_INDEX,
)
from robot_energy.timeline.blocks import Int

if TYPE_CHECKING:
    from mcap.records import Channel, ChunkIndex, McapRecord, MetadataIndex, Schema

CHUNK_SIZE = 2**20  # bytes of records, beyond which a chunk ends
LEVEL = -1  # of zstandard: 2 to 3 % larger than by 1, in two thirds of the time
HEAD = FRAME.size + MESSAGE_FIXED  # bytes before a message
_HEAD = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
     ("log", "<u8"), ("publish", "<u8")]
)  # fmt: skip
_INDEX = Struct("<BQHI")  # a Message Index before its entries
_MESSAGE = Struct("<BQHIQQ")
_FOOTER = Struct("<BQQQ")


def head(channel: int, time_ns: int, row: bytes) -> bytes:
    """Return what stands before a message in its record; time [ns]."""
    size = MESSAGE_FIXED + len(row)
    return _MESSAGE.pack(MESSAGE, size, channel, 0, time_ns, time_ns)


def framed(channel: int, time_ns: Int, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return Message records of one channel, shape (n, HEAD + size).

    Args:
        time_ns: Log time of each, not negative, shape (n,). [ns]
        rows: Complete serialized messages, shape (n, size).
    """
    head = np.zeros(len(rows), _HEAD)
    head["opcode"], head["length"] = MESSAGE, MESSAGE_FIXED + rows.shape[1]
    head["channel"], head["log"], head["publish"] = channel, time_ns, time_ns
    frames = np.empty((len(rows), HEAD + rows.shape[1]), np.uint8)
    frames[:, :HEAD] = head.view(np.uint8).reshape(-1, HEAD)
    frames[:, HEAD:] = rows
    return frames


class McapWriter:
    """Writes one empty file in chunks of about `CHUNK_SIZE`, each with its index."""

    def __init__(self, file: BinaryIO, compressed: bool, library: str) -> None:
        from mcap.data_stream import RecordBuilder
        from mcap.records import Header

        self._file, self._compressed = file, compressed
        self._builder = RecordBuilder
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._waiting: list[bytes | memoryview] = []  # records of the chunk that is not full
        self._size = 0  # of them
        self._index: list[NDArray[np.int64]] = []  # channel, time and offset of their messages
        file.write(MAGIC)
        self._write(Header("ros2", library))

    def schema(self, name: str, definition: str) -> int:
        """Return the number of a message definition, which is announced."""
        from mcap.records import Schema

        entry = Schema(
            data=definition.encode(), encoding="ros2msg", id=len(self._schemas) + 1, name=name
        )
        self._schemas.append(entry)
        self._add(self._record(entry))
        return entry.id

    def channel(self, topic: str, schema: int, metadata: dict[str, str]) -> int:
        """Return the number of a channel, which is announced."""
        from mcap.records import Channel

        number = len(self._channels) + 1
        entry = Channel(
            id=number, topic=topic, message_encoding="cdr", metadata=metadata, schema_id=schema
        )
        self._channels.append(entry)
        self._add(self._record(entry))
        return number

    def messages(self, channel: Int, time_ns: Int, size: Int, records: memoryview) -> None:
        """Append Message records.

        Args:
            channel: Number of the channel of each, shape (n,).
            time_ns: Log time of each, shape (n,). [ns]
            size: Of each record, shape (n,). [bytes]
            records: All of them, one behind the other.
        """
        ends = np.cumsum(size)
        first, done = 0, 0
        while first < len(ends):
            room = CHUNK_SIZE - self._size
            last = int(np.searchsorted(ends, done + room, side="right")) + 1
            part = slice(first, last)
            offset = self._size - done + ends[part] - size[part]
            self._index.append(np.stack([channel[part], time_ns[part], offset]))
            first, begin, done = last, done, int(ends[part][-1])
            self._add(records[begin:done])
            if self._size > CHUNK_SIZE:
                self._end_chunk()

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        from mcap.records import Metadata, MetadataIndex

        place = self._file.tell()
        length = self._write(Metadata(metadata=entries, name=name))
        self._metadata.append(MetadataIndex(length=length, name=name, offset=place))

    def finish(self) -> None:
        """Write the last chunk and the summary; the file stays open."""
        from mcap.opcode import Opcode
        from mcap.records import DataEnd, Footer, Statistics, SummaryOffset

        self._end_chunk()
        self._write(DataEnd(0))
        start = self._file.tell()
        times = [(one.message_start_time, one.message_end_time) for one in self._chunks]
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_end_time=max((end for _, end in times), default=0),
            message_start_time=min((begin for begin, _ in times), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: self._metadata,
        }
        summary, offsets = b"", b""
        for opcode, entries in groups.items():
            part = b"".join(map(self._record, entries))
            place = start + len(summary)
            offsets += self._record(
                SummaryOffset(group_opcode=opcode, group_start=place, group_length=len(part))
            )
            summary += part
        place = start + len(summary)
        summary += offsets
        checked = summary + _FOOTER.pack(FOOTER, 20, start, place)
        self._file.write(summary)
        self._write(
            Footer(summary_crc=zlib.crc32(checked), summary_offset_start=place, summary_start=start)
        )
        self._file.write(MAGIC)

    def _record(self, entry: McapRecord) -> bytes:
        builder = self._builder()
        entry.write(builder)
        return builder.end()

    def _write(self, entry: McapRecord) -> int:
        return self._file.write(self._record(entry))

    def _add(self, records: bytes | memoryview) -> None:
        self._waiting.append(records)
        self._size += len(records)

    def _end_chunk(self) -> None:
        """Write the records that wait, if a message is among them."""
        if not self._index:
            return
        import zstandard
        from mcap.records import Chunk, ChunkIndex

        records, (channel, time, offset) = b"".join(self._waiting), np.hstack(self._index)
        self._waiting, self._size, self._index = [], 0, []
        data = zstandard.compress(records, LEVEL) if self._compressed else records
        chunk = Chunk(
            compression="zstd" if self._compressed else "",
            data=data,
            message_end_time=int(time.max()),
            message_start_time=int(time.min()),
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        )
        place = self._file.tell()
        length = self._write(chunk)
        entries = np.stack([time, offset], axis=1).astype("<u8")
        offsets: dict[int, int] = {}
        numbers, first = np.unique(channel, return_index=True)
        for number in numbers[np.argsort(first)].tolist():
            own = entries[channel == number].tobytes()
            offsets[number] = self._file.tell()
            self._file.write(_INDEX.pack(MESSAGE_INDEX, len(own) + 6, number, len(own)) + own)
            self._counts[number] += len(own) // 16
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=place,
                compression=chunk.compression,
                compressed_size=len(data),
                message_end_time=chunk.message_end_time,
                message_index_length=self._file.tell() - place - length,
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=len(records),
            )
        )
