"""The two ways a bag's messages are read: MCAP files by this package, the rest through rosbags."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.bag.mcap_block import Block, Messages
from robot_energy.bag.mcap_file import McapFile
from robot_energy.errors import BagError
from robot_energy.wire.batch import RawBatch

BATCH_MESSAGES = 8192
BATCH_BYTES = 16 * 2**20
"""Most that is gathered before a part is handed out, where there are no chunks."""

Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag.

    Attributes:
        msgtype: Message type, such as ``sensor_msgs/msg/JointState``.
        message_count: Number of messages; None if the bag does not say.
        encoding: How messages are serialized; only ``cdr`` can be read.
    """

    msgtype: str
    message_count: int | None
    encoding: str = "cdr"


@dataclass(slots=True)
class Contents:
    """What a file or folder holds: times in [ns]; None where it does not say."""

    topics: dict[str, TopicInfo] = field(default_factory=dict[str, TopicInfo])
    definitions: dict[str, tuple[str, str]] = field(default_factory=dict[str, tuple[str, str]])
    start_ns: int | None = None
    end_ns: int | None = None
    message_count: int | None = 0

    def add(self, other: Contents, report: Report) -> None:
        """Add what another file of the same bag holds."""
        for name, info in other.topics.items():
            self.add_topic(name, info, report)
        self.definitions = {**other.definitions, **self.definitions}
        starts = [t for t in (self.start_ns, other.start_ns) if t is not None]
        ends = [t for t in (self.end_ns, other.end_ns) if t is not None]
        self.start_ns, self.end_ns = min(starts, default=None), max(ends, default=None)
        self.message_count = _sum(self.message_count, other.message_count)

    def add_topic(self, name: str, info: TopicInfo, report: Report) -> None:
        """Add a stream on a topic; of two types on one topic the first counts."""
        have = self.topics.get(name)
        if have is None:
            self.topics[name] = info
        elif (have.msgtype, have.encoding) != (info.msgtype, info.encoding):
            report(
                f"{name} carries {have.msgtype} ({have.encoding}) and also {info.msgtype} "
                f"({info.encoding}); the latter was left out"
            )
        else:
            count = _sum(have.message_count, info.message_count)
            self.topics[name] = TopicInfo(have.msgtype, count, have.encoding)


def _sum(a: int | None, b: int | None) -> int | None:
    return None if a is None or b is None else a + b


class McapSource:
    """Messages of one MCAP file.

    Args:
        path: The file.
        report: Takes one sentence per thing found wrong.

    Raises:
        BagError: If it is no MCAP file.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self._file = McapFile(path, report)
        self._report = report
        self.unverified_count = 0

    def contents(self) -> Contents:
        """Return what the file holds: from its summary, else by reading it once."""
        file = self._file
        statistics = file.summary.statistics if file.summary else None
        counts: dict[int, int] = {}
        result = Contents(message_count=None)
        if file.summary and (file.channels or (statistics and not statistics.message_count)):
            if statistics:
                counts = statistics.channel_counts
                result.message_count = statistics.message_count
                if statistics.message_count:
                    result.start_ns, result.end_ns = statistics.start_ns, statistics.end_ns
        else:
            statistics = None
            result.message_count = 0
            for block in file.blocks():
                result.message_count += block.count
                for channel, messages in block.messages.items():
                    counts[channel] = counts.get(channel, 0) + len(messages.offset)
                    low = int(messages.log_time_ns.min())
                    high = int(messages.log_time_ns.max())
                    first, last = result.start_ns, result.end_ns
                    result.start_ns = low if first is None else min(first, low)
                    result.end_ns = high if last is None else max(last, high)
        counted = statistics is not None or result.message_count is not None
        for channel in file.channels.values():
            count = counts.get(channel.id, 0) if counted else None
            schema = file.schemas.get(channel.schema_id)
            info = TopicInfo(schema.name if schema else "", count, channel.encoding)
            result.add_topic(channel.topic, info, self._report)
            if schema and schema.text and channel.encoding == "cdr":
                result.definitions.setdefault(schema.name, (schema.encoding, schema.text))
        return result

    def parts(self, topics: dict[str, str]) -> Iterator[dict[str, RawBatch]]:
        """Yield the messages of some topics, a chunk at a time.

        Args:
            topics: Message type by topic.

        Yields:
            One batch per topic that has messages in the chunk.
        """
        for block in self._file.blocks(topics):
            part = self._part(block, topics)
            if part:
                if not block.verified:
                    self.unverified_count += sum(len(batch) for batch in part.values())
                yield part

    def _part(self, block: Block, topics: dict[str, str]) -> dict[str, RawBatch]:
        streams: dict[str, list[Messages]] = {}
        for key, messages in block.messages.items():
            channel = self._file.channels.get(key)
            if channel is None:
                self._report(
                    f"{self._file.path.name}: messages of channel {key}, which the file does not "
                    "define, were left out"
                )
                continue
            schema = self._file.schemas.get(channel.schema_id)
            if schema and channel.encoding == "cdr" and topics.get(channel.topic) == schema.name:
                streams.setdefault(channel.topic, []).append(messages)
        return {
            topic: _batch(topic, topics[topic], block, parts) for topic, parts in streams.items()
        }


def _batch(topic: str, msgtype: str, block: Block, streams: list[Messages]) -> RawBatch:
    times, offset, length = streams[0].log_time_ns, streams[0].offset, streams[0].length
    if len(streams) > 1:
        times = np.concatenate([stream.log_time_ns for stream in streams])
        offset = np.concatenate([stream.offset for stream in streams])
        length = np.concatenate([stream.length for stream in streams])
        order = np.argsort(offset)
        times, offset, length = times[order], offset[order], length[order]
    if (times[1:] < times[:-1]).any():
        order = np.argsort(times, kind="stable")
        times, offset, length = times[order], offset[order], length[order]
    return RawBatch(topic, msgtype, times, block.buffer, offset, length)


class RosbagsSource:
    """Messages of a folder or file that rosbags reads: sqlite3, or packed by rosbag2 itself.

    Args:
        path: Folder with metadata.yaml, or a .db3 file.
        report: Takes one sentence per thing found wrong.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self._path = path
        self._report = report
        self.unverified_count = 0

    def contents(self) -> Contents:
        """Return what the bag holds.

        Raises:
            BagError: If rosbags cannot read it.
        """
        from rosbags.interfaces import MessageDefinitionFormat

        result = Contents()
        with self._open() as reader:
            for connection in reader.connections:
                encoding = str(getattr(connection.ext, "serialization_format", "cdr"))
                info = TopicInfo(connection.msgtype, connection.msgcount, encoding)
                result.add_topic(connection.topic, info, self._report)
                if connection.msgdef.format != MessageDefinitionFormat.NONE:
                    idl = connection.msgdef.format == MessageDefinitionFormat.IDL
                    definition = ("ros2idl" if idl else "ros2msg", connection.msgdef.data)
                    result.definitions.setdefault(connection.msgtype, definition)
            result.message_count = reader.message_count
            if reader.message_count:
                result.start_ns, result.end_ns = reader.start_time, reader.end_time - 1
        return result

    def parts(self, topics: dict[str, str]) -> Iterator[dict[str, RawBatch]]:
        """Yield the messages of some topics, some thousands at a time.

        Args:
            topics: Message type by topic.

        Yields:
            One batch per topic that has messages among them.
        """
        count = 0
        held: dict[str, tuple[list[int], list[bytes]]] = {}
        size, number = 0, 0
        try:
            with self._open() as reader:
                wanted = [c for c in reader.connections if topics.get(c.topic) == c.msgtype]
                messages = reader.messages(wanted) if wanted else iter(())
                for connection, log_time, data in messages:
                    times, rows = held.setdefault(connection.topic, ([], []))
                    times.append(log_time)
                    rows.append(bytes(data))
                    size, number = size + len(data), number + 1
                    if number == BATCH_MESSAGES or size >= BATCH_BYTES:
                        count += number
                        yield self._flush(held, topics)
                        held, size, number = {}, 0, 0
        except Exception as error:  # rosbags and sqlite raise many kinds on damaged files
            if isinstance(error, BagError):
                raise
            self._report(
                f"{self._path.name}: reading stopped ({error}); {count + number} messages before "
                "it were read"
            )
        if number:
            yield self._flush(held, topics)

    def _flush(
        self, held: dict[str, tuple[list[int], list[bytes]]], topics: dict[str, str]
    ) -> dict[str, RawBatch]:
        part = {
            topic: RawBatch.from_messages(topic, topics[topic], times, rows)
            for topic, (times, rows) in held.items()
        }
        self.unverified_count += sum(len(batch) for batch in part.values())
        return part

    def _open(self) -> Any:
        from rosbags.rosbag2 import Reader

        reader = Reader(self._path)
        try:
            reader.open()
        except Exception as error:  # rosbags and sqlite raise many kinds on damaged files
            raise BagError(
                f"{self._path} cannot be read ({error})",
                "a whole rosbag2 bag",
                "rebuild its metadata with `ros2 bag reindex`, or record again",
            ) from error
        return _Opened(reader)


class _Opened:
    """Closes a reader that is already open."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def __enter__(self) -> Any:
        return self._reader

    def __exit__(self, *_: object) -> None:
        self._reader.close()
