"""Write rosbag2 folders: one MCAP file and metadata.yaml, as Jazzy's ``ros2 bag`` does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from itertools import islice, repeat
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.bag.cdr.types import typestore as default_typestore
from robot_energy.bag.mcap_writer import McapWriter, framed, head
from robot_energy.bag.metadata import (
    DEFAULT_QOS,
    FILE_NAME,
    LIBRARY,
    Qos,
    TopicEntry,
    foreign_entries,
    metadata_yaml,
    qos_yaml,
)
from robot_energy.foundation.errors import BagError, MessageTypeError, MissingTopicError, ShapeError
from robot_energy.foundation.files.output_folder import OutputFolder
from robot_energy.timeline.blocks import Int

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

TOGETHER = 4096  # messages that are put together at once


class BagWriter(AbstractContextManager["BagWriter"]):
    """Writes one bag; use as a context manager, or call ``close``.

    Equal calls give equal bytes (with equal versions of mcap and zstandard): no clock, no random
    number and no machine name goes in. The folder appears whole when the bag is closed; after
    an error, or without ``close``, it does not appear.

    Args:
        compression: ``zstd`` or ``none``.
        typestore: Definitions; default those of ROS 2 Jazzy and ros2_energy_msgs.
        origin: Where the recording comes from, in words, noted with the bag.
        inputs: Files and folders that it is made of, which it must not replace.
    """

    def __init__(
        self,
        path: str | Path,
        compression: Literal["zstd", "none"] = "zstd",
        overwrite: bool = False,
        typestore: Typestore | None = None,
        origin: str = "",
        inputs: Iterable[str | PathLike[str]] = (),
    ) -> None:
        if compression not in ("zstd", "none"):
            raise BagError(f"unknown compression {compression!r}", "zstd or none")
        self._folder = OutputFolder(path, foreign_entries, overwrite, inputs, BagError)
        self.path = self._folder.path
        self._origin = origin
        self._store = default_typestore() if typestore is None else typestore
        self._topics: dict[str, TopicEntry] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._first: int | None = None
        self._last: int | None = None
        self._open = False
        self._name = f"{self.path.name}_0.mcap"
        try:
            self._file = self._folder.open(self._name)
            self._writer = McapWriter(self._file, compression == "zstd", LIBRARY)
        except OSError as error:
            raise self._failed(error) from error
        except BaseException:
            self._folder.discard()
            raise
        self._open = True

    def add_topic(self, topic: str, msgtype: str, qos: Qos = DEFAULT_QOS) -> None:
        self._check_open()
        if topic in self._topics:
            raise BagError(f"{topic} is added to {self.path} a second time", "each topic once")
        if msgtype not in self._store.fielddefs:
            raise MessageTypeError(f"the message type {msgtype} is unknown", "a known type")
        type_hash = self._store.hash_rihs01(msgtype)
        if msgtype not in self._schemas:
            definition, _ = self._store.generate_msgdef(msgtype, ros_version=2)
            self._schemas[msgtype] = self._writer.schema(msgtype, definition)
        notes = {"offered_qos_profiles": qos_yaml(qos), "topic_type_hash": type_hash}
        self._channels[topic] = self._writer.channel(topic, self._schemas[msgtype], notes)
        self._topics[topic] = TopicEntry(topic, msgtype, qos, type_hash, 0)
        self._counts[topic] = 0

    def write(
        self, topic: str, log_time_ns: ArrayLike, rows: NDArray[np.uint8] | Sequence[bytes]
    ) -> None:
        """Append messages of one topic.

        Args:
            log_time_ns: Log time of each message, shape (n,). [ns]
            rows: Complete serialized messages: uint8, shape (n, size), or n byte strings.
        """
        times = np.atleast_1d(np.asarray(log_time_ns, dtype=np.int64))
        if times.shape != (len(rows),) or (len(times) and int(times.min()) < 0):
            raise ShapeError(
                f"{len(rows)} messages of {topic} came with times of shape {times.shape}",
                "one time per message, none negative",
            )
        if isinstance(rows, np.ndarray):
            self.write_sorted([(topic, times, rows)], [times * 0])
        else:
            self.write_in_order(zip(times.tolist(), repeat(topic), rows, strict=False))

    def write_sorted(
        self, parts: Sequence[tuple[str, Int, NDArray[np.uint8]]], keys: Sequence[Int]
    ) -> None:
        """Append messages of several topics in the order of a key; equal ones stay as given.

        Args:
            parts: Topic, log times of shape (n,), not negative [ns], and complete serialized
                messages, shape (n, size).
            keys: Of the messages of each part, shape (n,).
        """
        frames = [framed(self._channel(topic), times, _whole(rows)) for topic, times, rows in parts]
        counts = [len(part) for part in frames]
        order = np.argsort(np.concatenate(keys), kind="stable")
        source = np.repeat(np.arange(len(frames)), counts)[order]
        place = np.concatenate([np.arange(count) for count in counts])[order]
        cuts = np.flatnonzero((np.diff(source) != 0) | (np.diff(place) != 1)) + 1
        runs = zip([0, *cuts.tolist()], [*cuts.tolist(), len(order)], strict=True)
        pieces: list[NDArray[np.uint8]] = [
            frames[int(source[begin])][place[begin] : place[end - 1] + 1]
            for begin, end in runs
            if end
        ]
        self._append(
            [topic for topic, _, _ in parts],
            source,
            np.concatenate([times for _, times, _ in parts])[order],
            np.array([part.shape[1] for part in frames])[source],
            pieces[0].data.cast("B") if len(pieces) == 1 else b"".join(p.data for p in pieces),
        )

    def write_in_order(self, messages: Iterable[tuple[int, str, bytes]]) -> None:
        """Append messages in this order: log time, not negative [ns]; topic; serialized message."""
        rest = iter(messages)
        while some := list(islice(rest, TOGETHER)):
            topics = list(dict.fromkeys(topic for _, topic, _ in some))
            numbers = {topic: number for number, topic in enumerate(topics)}
            records = [head(self._channel(topic), time, row) + row for time, topic, row in some]
            self._append(
                topics,
                np.array([numbers[topic] for _, topic, _ in some]),
                np.array([time for time, _, _ in some]),
                np.array([len(record) for record in records]),
                b"".join(records),
            )

    def _append(
        self,
        topics: Sequence[str],
        source: Int,
        time_ns: Int,
        size: Int,
        records: bytes | memoryview,
    ) -> None:
        """Append Message records of topics, each with the number of its topic."""
        self._check_open()
        if not len(source):
            return
        channels = np.array([self._channels[topic] for topic in topics])
        try:
            self._writer.messages(channels[source], time_ns, size, memoryview(records))
        except OSError as error:
            raise self._failed(error) from error
        for topic, count in zip(topics, np.bincount(source).tolist(), strict=False):
            self._counts[topic] += count
        first, last = int(time_ns.min()), int(time_ns.max())
        self._first = first if self._first is None else min(self._first, first)
        self._last = last if self._last is None else max(self._last, last)

    def _channel(self, topic: str) -> int:
        self._check_open()
        if topic not in self._channels:
            raise MissingTopicError(f"{topic} was not added to {self.path}", "add_topic first")
        return self._channels[topic]

    def close(self) -> None:
        """Write index and metadata and put the bag in place; a second call does nothing."""
        if not self._open:
            return
        try:
            self._writer.metadata("rosbag2", {"serialized_metadata": self._metadata(None)})
            self._writer.finish()
            self._file.close()
            with self._folder.open(FILE_NAME) as file:
                file.write(self._metadata(self._name).encode())
            self._folder.place()
        except OSError as error:
            raise self._failed(error) from error
        except BaseException:
            self.discard()
            raise
        self._open = False

    def discard(self) -> None:
        """Leave nothing of the bag, and what it should have replaced as it was."""
        self._open = False
        with suppress(OSError):  # it is closed even when its last bytes are refused
            self._file.close()
        self._folder.discard()

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def _metadata(self, file: str | None) -> str:
        topics = [
            TopicEntry(t.name, t.msgtype, t.qos, t.type_hash, self._counts[t.name])
            for t in self._topics.values()
        ]
        start = self._first or 0
        span = (self._last or 0) - start
        count = sum(self._counts.values())
        return metadata_yaml(topics, file, start, span, count, self._origin)

    def _failed(self, error: OSError) -> BagError:
        self.discard()
        return BagError(
            f"{self.path / self._name} cannot be written ({error.strerror or error})",
            remedy="free space on the disk and write the bag again; the incomplete one was removed",
        )

    def _check_open(self) -> None:
        if not self._open:
            raise BagError(f"{self.path} is closed", "an open bag")


def _whole(rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if rows.ndim != 2 or rows.dtype != np.uint8:
        raise ShapeError(f"messages of shape {rows.shape}, {rows.dtype}", "(n, size), uint8")
    return rows
