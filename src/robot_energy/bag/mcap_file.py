"""One MCAP file, read block by block in constant memory, as far as it is whole."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from io import SEEK_END
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO

from robot_energy.bag import mcap_records as records
from robot_energy.bag.mcap_records import (
    FRAME,
    IN_SUMMARY,
    LogTimes,
    McapChunk,
    RecordError,
    read_closing,
    walked_block,
)
from robot_energy.foundation.errors import BagError
from robot_energy.foundation.files.first_bytes import MAX_MAGIC, named
from robot_energy.foundation.files.regular_file import open_regular

_MIN_LOOSE_BYTES, _LOOSE_BYTES = 2**12, 2**20
_LOOSE_MESSAGES = 8192
"""Messages outside chunks are read in blocks of at least and at most these. [bytes], [messages]"""
_OTHER_CHANNELS = "the chunk at byte {} holds other channels than the summary says"

_INDEX_HEAD = 6  # bytes of a message index before its entries of 16
_NO_INDEX = "a message index of {1} bytes at byte {0} holds none: what it may hold was left out"
_ENDS = {records.DATA_END: 4, records.FOOTER: 20}
"""Records that end the data or the file, and their length. [bytes]"""
_IN_DATA = {
    records.SCHEMA, records.CHANNEL, records.MESSAGE, records.CHUNK, records.ATTACHMENT,
    records.METADATA,
}  # fmt: skip
MAX_DEFINITIONS = 32 * 2**20
"""Definitions of messages and channels kept of one file, besides its summary. [bytes]"""

Report = Callable[[str], None]


class McapFile:
    """One MCAP file.

    Attributes:
        size: Its size. [bytes]
        summary: The summary at the end of the file; None if there is none or it is damaged.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self.path = path
        self._report_to = report
        self.schemas: dict[int, records.Schema] = {}
        self.channels: dict[int, records.McapChannel] = {}
        try:
            with open_regular(path) as file:
                self.size = file.seek(0, SEEK_END)
                file.seek(0)
                head = file.read(MAX_MAGIC)
                if head.startswith(records.MAGIC):
                    self._closing = read_closing(file, self.size, self._report)
        except OSError as error:
            raise BagError(f"{path} cannot be read ({error.strerror})", "an MCAP file") from error
        if not head.startswith(records.MAGIC):
            found, remedy = named(path, head)
            raise BagError(found, "an MCAP file or a rosbag2 folder", remedy)
        self.summary = self._closing.summary
        self._starts = sorted(self.summary.chunks) if self.summary else []
        self._room = MAX_DEFINITIONS
        self._loose_bytes = _MIN_LOOSE_BYTES
        if self.summary is not None:
            self.schemas.update(self.summary.schemas)
            self.channels.update(self.summary.channels)

    def blocks(
        self, topics: Collection[str] | None = None, spans: Mapping[str, LogTimes] | None = None
    ) -> Iterator[McapChunk]:
        """Yield the chunks, and runs of messages outside chunks, in file order.

        The records themselves are what counts. The summary at the end helps to pass over what
        does not matter and to go on behind what is damaged; where it contradicts the records,
        that is reported.

        Args:
            topics: Topics that matter; chunks known to hold none of them are left out. None for
                everything.
            spans: First and last log time that matter, by topic; chunks known to lie outside are
                left out as well. [ns]
        """
        pos, left_out = len(records.MAGIC), False
        ended: int | None = None  # where a record has ended the data
        counts = Counter[int]()  # messages met, by channel
        try:
            with open_regular(self.path, 2**18) as file:
                while pos < self.size:
                    try:
                        opcode, length = self._frame(file, pos)
                        if ended is not None and opcode == records.MAGIC[0]:
                            file.seek(pos)
                            if file.read(len(records.MAGIC)) == records.MAGIC:
                                pos += len(records.MAGIC)  # of files one behind the other
                                continue
                        indexed, wrong = self._indexed(pos, opcode, length)
                        if indexed is not None and topics is not None:
                            passed = self._passed(file, indexed, topics, spans or {})
                            if passed is not None:
                                counts.update(passed)
                                pos = indexed.end
                                continue
                        block, following = self._step(file, pos, opcode, length)
                        stranger = self._stranger(pos, opcode, length, ended is not None)
                    except RecordError as error:
                        index = bisect_right(self._starts, pos)
                        resume = self._starts[index] if index < len(self._starts) else None
                        footer = self._closing.footer
                        if resume is None and ended is not None and pos >= (footer or 0):
                            break
                        self._report(self._cut(error, pos, counts.total(), resume))
                        if resume is None:
                            return
                        pos, left_out = resume, True
                        continue
                    for sentence in filter(None, (wrong, stranger)):
                        self._report(sentence)
                    if block is not None and block.count:
                        if ended is not None:
                            self._report(
                                f"a record at byte {ended} ends the data, but messages follow; "
                                "they were read as well"
                            )
                            ended = None
                        met = {key: len(found.offset) for key, found in block.messages.items()}
                        counts.update(met)
                        if indexed and indexed.channels and not indexed.channels >= met.keys():
                            self._report(_OTHER_CHANNELS.format(pos))
                        yield block
                        block = None
                    if length == _ENDS.get(opcode):
                        closing = self._closing
                        footer = opcode == records.FOOTER
                        if pos == closing.footer if footer else following == closing.data_end:
                            self._compare(None if left_out else counts)
                            return
                        ended = pos if ended is None else ended
                    pos = following
        except OSError as error:
            self._report(f"reading stopped at byte {pos} of {self.size} ({error.strerror})")
            return
        if ended is not None:
            self._compare(None if left_out else counts)
            return
        self._report(
            f"the file ends at byte {self.size} without its closing records; {counts.total()} "
            "messages before it were read"
        )

    def _compare(self, counts: Mapping[int, int] | None) -> None:
        """Compare what was met up to the end of the data with what the file says of itself."""
        if self._closing.footer is None:
            self._report("the closing part of the file is damaged or missing")
        statistics = self.summary.statistics if self.summary else None
        if counts is None or statistics is None:
            return
        total = sum(counts.values())
        if total != statistics.message_count:
            self._report(f"{total} messages were read where the summary counts "
                         f"{statistics.message_count}")  # fmt: skip
            return
        for channel, said in sorted(statistics.channel_counts.items()):
            if counts.get(channel, 0) != said:
                self._report(
                    f"channel {channel} has {counts.get(channel, 0)} messages where the summary "
                    f"counts {said}"
                )
                return

    def _indexed(self, pos: int, opcode: int, length: int) -> tuple[records.ChunkIndex | None, str]:
        """Return what the summary says of the chunk at ``pos``, or why it is not believed."""
        indexed = self.summary.chunks.get(pos) if self.summary else None
        if indexed is None:
            return None, ""
        if opcode != records.CHUNK:
            return None, f"byte {pos} holds no chunk, though the summary lists one"
        if indexed.length != FRAME.size + length:
            return None, f"the chunk at byte {pos} has another length than the summary says"
        return indexed, ""

    def _passed(
        self,
        file: BinaryIO,
        indexed: records.ChunkIndex,
        topics: Collection[str],
        spans: Mapping[str, LogTimes],
    ) -> dict[int, int] | None:
        """Return the messages by channel of a chunk that does not matter; None if it may.

        The summary alone is not believed: the index behind the chunk must name the same channels.
        """
        if not indexed.channels or not (self.summary and self.summary.channels):
            return None
        times = None
        if spans:
            file.seek(indexed.start + FRAME.size)
            start, end = Struct("<QQ").unpack(file.read(16).ljust(16, b"\0"))
            if (start, end) == (indexed.start_ns, indexed.end_ns):  # else it is not believed
                times = start, end
        held = [self.channels.get(channel) for channel in indexed.channels]
        if any(
            channel is None or (channel.topic in topics and _meets(spans.get(channel.topic), times))
            for channel in held
        ):
            return None
        counts: dict[int, int] = {}
        pos = indexed.start + indexed.length
        while pos < indexed.end:
            opcode, length = self._frame(file, pos)
            head = file.read(6)
            if opcode != records.MESSAGE_INDEX or length < len(head) or len(head) < 6:
                return None
            channel, size = int.from_bytes(head[:2], "little"), int.from_bytes(head[2:], "little")
            counts[channel] = counts.get(channel, 0) + size // 16
            pos += FRAME.size + length
        if pos != indexed.end:
            return None
        if not indexed.channels >= {channel for channel, count in counts.items() if count}:
            self._report(_OTHER_CHANNELS.format(indexed.start))
            return None
        return counts

    def _step(
        self, file: BinaryIO, pos: int, opcode: int, length: int
    ) -> tuple[McapChunk | None, int]:
        """Read the record at ``pos``: a block if it holds messages, and where to go on."""
        body = pos + FRAME.size
        if opcode in (records.MESSAGE, records.SCHEMA, records.CHANNEL):
            self._whole(length, body, opcode)
            if opcode == records.MESSAGE and length < records.MESSAGE_FIXED:
                raise RecordError("a message record too short for its own fields")
            return self._loose(file, pos, FRAME.size + length)
        if opcode == records.CHUNK:
            self._whole(length, body, opcode)
            file.seek(body)
            data = memoryview(file.read(length))
            following = self._behind_indexes(file, body + length)
            return self._chunk(data, pos), following
        if not (records.HEADER <= opcode <= records.DATA_END or opcode >= records.FIRST_PRIVATE):
            raise RecordError(f"a record of unknown kind {opcode}")
        self._whole(length, body, opcode, limit=False)
        return None, body + length

    def _stranger(self, pos: int, opcode: int, length: int, ended: bool) -> str:
        """Return that a record does not belong where it stands: it may have held messages."""
        if opcode in _IN_DATA or length == _ENDS.get(opcode):
            return ""
        if opcode == records.HEADER and (ended or pos == len(records.MAGIC)):
            return ""
        if ended and opcode in IN_SUMMARY:
            return ""
        if opcode == records.MESSAGE_INDEX and not (length - _INDEX_HEAD) % 16:
            return ""  # behind a private record
        if opcode >= records.FIRST_PRIVATE and opcode ^ records.FIRST_PRIVATE not in _IN_DATA:
            return ""  # of an application; one flipped bit makes another one of a record
        return (
            f"a record of kind {opcode} with {length} bytes at byte {pos} does not belong in the "
            "data; what it may have held was left out"
        )

    def _frame(self, file: BinaryIO, pos: int) -> tuple[int, int]:
        file.seek(pos)
        head = file.read(FRAME.size)
        if len(head) < FRAME.size:
            raise EndOfFileError("a record")
        return FRAME.unpack(head)

    def _whole(self, length: int, body: int, opcode: int, limit: bool = True) -> None:
        if length > self.size - body:
            raise EndOfFileError("a chunk" if opcode == records.CHUNK else "a record")
        if limit and length > records.MAX_RECORD_BYTES:
            raise RecordError(f"a record of {length} bytes, more than {records.MAX_RECORD_BYTES}")

    def _loose(self, file: BinaryIO, pos: int, first: int) -> tuple[McapChunk | None, int]:
        """Read messages that lie outside chunks: about as much at once as was of use before."""
        file.seek(pos)
        data = file.read(max(self._loose_bytes, first))
        block = walked_block(data, self._on_record, _LOOSE_MESSAGES)
        if block.end == 0:
            raise EndOfFileError("a record")  # it has become shorter meanwhile
        useful = 2 * block.end >= len(data)
        size = 2 * self._loose_bytes if useful else self._loose_bytes // 2
        self._loose_bytes = min(max(size, _MIN_LOOSE_BYTES), _LOOSE_BYTES)
        return block, pos + block.end

    def _behind_indexes(self, file: BinaryIO, pos: int) -> int:
        """Where the MessageIndex records after a chunk end; they are not needed, but looked at."""
        while self.size - pos >= FRAME.size:
            opcode, length = self._frame(file, pos)
            if opcode != records.MESSAGE_INDEX or length > self.size - pos - FRAME.size:
                break
            head = file.read(min(length, _INDEX_HEAD))
            said = int.from_bytes(head[2:], "little")
            # More than a flipped bit: it may be another record that has become one.
            if (said ^ max(length - _INDEX_HEAD, 0)).bit_count() > 1:
                self._report(_NO_INDEX.format(pos, length))
            pos += FRAME.size + length
        return pos

    def _chunk(self, data: memoryview, pos: int) -> McapChunk | None:
        try:
            content, verified = records.unpack_chunk(data)
        except RecordError as error:
            self._report(f"the chunk at byte {pos} was left out: it holds {error}")
            return None
        block = walked_block(content, self._on_record)
        block.verified = verified
        if block.end < len(content):
            self._report(
                f"the chunk at byte {pos} holds an unreadable record after {block.count} messages; "
                "its rest was left out"
            )
        return block

    def _on_record(self, opcode: int, data: memoryview) -> None:
        known: dict[int, Any] = self.schemas if opcode == records.SCHEMA else self.channels
        what = "schema" if opcode == records.SCHEMA else "channel"
        try:
            parse = records.parse_schema if opcode == records.SCHEMA else records.parse_channel
            key, entry = parse(data)
            if key not in known:
                self._room -= len(data)
            if self._room < 0:
                raise RecordError(f"more than {MAX_DEFINITIONS} bytes of definitions")
        except RecordError as error:
            self._report(f"a schema or channel record was left out: it holds {error}")
            return
        if known is self.channels and key not in known and self.summary and self.summary.channels:
            self._report(f"channel {key} is missing in the summary")
        if known.setdefault(key, entry) != entry:
            self._report(f"{what} {key} is defined twice; the first one was used")

    def _cut(self, error: RecordError, pos: int, count: int, resume: int | None) -> str:
        if resume is not None:
            return f"bytes {pos} to {resume} were left out because of {error.args[0]}"
        at = f"at byte {pos} of {self.size}"
        ends = f"reading stopped {at} because of {error.args[0]}"
        if isinstance(error, EndOfFileError):
            ends = f"the file ends inside {error.args[0]} {at}"
        return f"{ends}; {count} messages before it were read"

    def _report(self, sentence: str) -> None:
        self._report_to(f"{self.path.name}: {sentence}")


class EndOfFileError(RecordError):
    """The file ends inside a record."""


def _meets(wanted: LogTimes | None, held: LogTimes | None) -> bool:
    """Whether two stretches share an instant; one that is unknown may."""
    if wanted is None or held is None:
        return True
    return wanted[0] <= held[1] and held[0] <= wanted[1]
