"""What a bag file holds, and the messages of MCAP files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.mcap_file import McapFile
from robot_energy.bag.mcap_records import LogTimes, McapChunk, Messages
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.stamps import valid_stamps

MANY_STEPS_BACK = 3  # of over a second in one chunk: no clock was set, the times are broken
BATCH_MESSAGES = 8192
BATCH_BYTES = 16 * 2**20
"""Most that is gathered before a part is handed out, where there are no chunks."""

Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag."""

    msgtype: Annotated[str, "Message type, such as ``sensor_msgs/msg/JointState``."]
    message_count: Annotated[int | None, "Number of messages; None if the bag does not say."]
    encoding: Annotated[str, "How messages are serialized; only ``cdr`` can be read."] = "cdr"


@dataclass(slots=True)
class BagContents:
    """What a file or folder holds: times in [ns]; None where it does not say.

    ``overlap_ns`` is by how much at most one chunk begins before the end of another ahead of it.
    """

    topics: dict[str, TopicInfo] = field(default_factory=dict[str, TopicInfo])
    definitions: dict[str, tuple[str, str]] = field(default_factory=dict[str, tuple[str, str]])
    span: LogTimes | None = None
    message_count: int | None = 0
    overlap_ns: int = 0

    def add(self, other: BagContents, report: Report) -> None:
        for name, info in other.topics.items():
            self.add_topic(name, info, report)
        self.definitions = {**other.definitions, **self.definitions}
        for span in filter(None, (self.span, other.span)):
            first, last = self.span or span
            self.span = min(first, span[0]), max(last, span[1])
        self.message_count = _sum(self.message_count, other.message_count)
        self.overlap_ns = max(self.overlap_ns, other.overlap_ns)

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


def _overlap(spans: Iterable[LogTimes]) -> int:
    """By how much at most a span begins before the latest end so far."""
    overlap, latest = 0, 0
    for start, end in spans:
        overlap, latest = max(overlap, latest - start), max(latest, end)
    return overlap


def _sum(a: int | None, b: int | None) -> int | None:
    return None if a is None or b is None else a + b


class McapSource:
    """Messages of one MCAP file."""

    def __init__(self, path: Path, report: Report) -> None:
        self._file = McapFile(path, report)
        self._report = report
        self.unverified_count = 0

    def contents(self) -> BagContents:
        """Return what the file holds: from its summary, else by reading it once."""
        file = self._file
        statistics = file.summary.statistics if file.summary else None
        counts: dict[int, int] = {}
        result = BagContents(message_count=None)
        defined = file.summary is not None and file.summary.defines_all
        if not defined and file.schemas:  # a summary may do without definitions
            self._report(
                f"{file.path.name}: the summary lacks channels or message types; the file was "
                "read instead"
            )
        if defined and file.channels:
            chunks = file.summary.chunks if file.summary else {}
            ordered = (chunks[start] for start in sorted(chunks))
            result.overlap_ns = _overlap((chunk.start_ns, chunk.end_ns) for chunk in ordered)
            if statistics:
                counts = statistics.channel_counts
                result.message_count = statistics.message_count
                if statistics.message_count:
                    result.span = statistics.start_ns, statistics.end_ns
        else:
            result.message_count = 0
            spans: list[LogTimes] = []
            for block in file.blocks():
                result.message_count += block.count
                for channel, messages in block.messages.items():
                    counts[channel] = counts.get(channel, 0) + len(messages.offset)
                times = np.concatenate([each.log_time_ns for each in block.messages.values()])
                spans.append((int(times.min()), int(times.max())))
            if spans:
                result.span = min(spans)[0], max(last for _, last in spans)
            result.overlap_ns = _overlap(spans)
        for key, channel in file.channels.items():
            count = None if result.message_count is None else counts.get(key, 0)
            schema = file.schemas.get(channel.schema_id)
            info = TopicInfo(schema.name if schema else "", count, channel.encoding)
            result.add_topic(channel.topic, info, self._report)
            if schema and schema.text and channel.encoding == "cdr":
                result.definitions.setdefault(schema.name, (schema.encoding, schema.text))
        return result

    def parts(
        self, topics: dict[str, str], spans: Mapping[str, LogTimes] | None = None
    ) -> Iterator[dict[str, RawBatch]]:
        """Yield the messages of some topics, a chunk at a time, within log times [ns] by topic."""
        for block in self._file.blocks(topics, spans):
            part = self._part(block, topics)
            if part:
                if not block.verified:
                    self.unverified_count += sum(len(batch) for batch in part.values())
                yield part

    def _part(self, block: McapChunk, topics: dict[str, str]) -> dict[str, RawBatch]:
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
            if schema is None and channel.topic in topics:
                self._report(
                    f"{self._file.path.name}: messages of {channel.topic}, whose type the file "
                    "does not define, were left out"
                )
            if schema and channel.encoding == "cdr" and topics.get(channel.topic) == schema.name:
                streams.setdefault(channel.topic, []).append(messages)
        return {
            topic: self._batch(topic, topics[topic], block, parts)
            for topic, parts in streams.items()
        }

    def _batch(
        self, topic: str, msgtype: str, block: McapChunk, streams: list[Messages]
    ) -> RawBatch:
        """Return the messages of one topic by log time; in file order where that is broken."""
        times, offset, length = (
            np.concatenate([getattr(stream, name) for stream in streams])
            for name in ("log_time_ns", "offset", "length")
        )
        batch = RawBatch(topic, msgtype, times, block.buffer, offset, length)
        if len(streams) > 1:
            batch = batch[np.argsort(offset)]
        times = batch.log_time_ns
        ends = times[:: max(len(times) - 1, 1)]
        if bool((times[1:] >= times[:-1]).all()) and bool(valid_stamps(ends).all()):
            return batch
        valid = valid_stamps(times)  # else by that of the message before it in the file
        row = np.maximum.accumulate(np.where(valid, np.arange(len(times)), -1))
        logged = np.where(row < 0, 0, times[row])
        steps = np.diff(logged)
        if not (steps < 0).any():
            return batch
        if int((steps < -SECOND_NS).sum()) >= MANY_STEPS_BACK:
            self._report(f"{self._file.path.name}: {broken_times(topic)}")
            return batch
        return batch[np.argsort(logged, kind="stable")]


def broken_times(topic: str) -> str:
    """Return the notice on a topic whose log times do not order its messages."""
    return (
        f"the log times of {topic} jump back and forth, so they were not used to sort its "
        "messages; do not date anything by them"
    )
