"""What the end of an MCAP file says about the whole, as far as it can be true."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import BinaryIO

from robot_energy.bag import mcap_records as records
from robot_energy.bag.mcap_records import FRAME, RecordError

MAX_CHUNKS = 500_000
"""Chunks that a summary may list: some 400 GB as rosbag2 writes them."""
IN_SUMMARY = {
    records.SCHEMA, records.CHANNEL, records.CHUNK_INDEX, records.STATISTICS,
    records.ATTACHMENT_INDEX, records.METADATA_INDEX, records.SUMMARY_OFFSET,
}  # fmt: skip


class _DataError(RecordError):
    """What should be the summary holds records of the data."""


@dataclass(slots=True)
class Summary:
    """Definitions, chunks by their first byte, and counts."""

    schemas: dict[int, records.Schema] = field(default_factory=dict[int, records.Schema])
    channels: dict[int, records.McapChannel] = field(default_factory=dict[int, records.McapChannel])
    chunks: dict[int, records.ChunkIndex] = field(default_factory=dict[int, records.ChunkIndex])
    statistics: records.Statistics | None = None

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
    """The end of a file.

    Attributes:
        footer: First byte of the closing record; None if there is none.
        data_end: First byte after the data; None if the file does not say.
        summary: The summary; None if there is none or it cannot be used.
    """

    footer: int | None = None
    data_end: int | None = None
    summary: Summary | None = None


def read_closing(file: BinaryIO, size: int, report: Callable[[str], None]) -> Closing:
    """Return what can be used of the end of a file."""
    closing = Closing()
    footer = size - records.FOOTER_SIZE - len(records.MAGIC)
    if footer < len(records.MAGIC):
        return closing
    file.seek(footer)
    tail = file.read(records.FOOTER_SIZE + len(records.MAGIC))
    if len(tail) < records.FOOTER_SIZE + len(records.MAGIC):
        return closing
    opcode, length = FRAME.unpack_from(tail)
    if tail[-8:] != records.MAGIC or opcode != records.FOOTER or length != 20:
        return closing
    closing.footer = footer
    start = int.from_bytes(tail[9:17], "little")
    if not start:
        closing.data_end = footer
        return closing
    if not len(records.MAGIC) <= start < footer or footer - start > records.MAX_RECORD_BYTES:
        report("the summary is not where the end of the file says; it was not used")
        return closing
    closing.data_end = start
    file.seek(start)
    data = file.read(footer - start)
    if records.MAGIC in data:  # of a file behind this one
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
    chunks: list[records.ChunkIndex] = []
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
            chunks.append(records.parse_chunk_index(body))
            if len(chunks) > MAX_CHUNKS:
                raise RecordError(f"over {MAX_CHUNKS} chunks")
        elif opcode == records.STATISTICS:
            summary.statistics = records.parse_statistics(body)
        elif opcode not in IN_SUMMARY and opcode < records.FIRST_PRIVATE:
            raise _DataError(f"a record of kind {opcode}, which belongs to the data")
        pos += FRAME.size + length
    summary.chunks = _apart(chunks, start, report)
    return summary


def _apart(
    chunks: Iterable[records.ChunkIndex], data_end: int, report: Callable[[str], None]
) -> dict[int, records.ChunkIndex]:
    """Return the chunks that lie in the data, each behind the one before it."""
    kept: dict[int, records.ChunkIndex] = {}
    wrong, end = 0, len(records.MAGIC)
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
