"""Write rosbag2 folders: one MCAP file and metadata.yaml, as Jazzy's ``ros2 bag`` does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from itertools import repeat
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.bag.cdr.types import typestore as default_typestore
from robot_energy.bag.metadata import (
    DEFAULT_QOS,
    FILE_NAME,
    Qos,
    TopicEntry,
    metadata_yaml,
    qos_yaml,
)
from robot_energy.bag.ownership import LIBRARY, foreign_entries
from robot_energy.foundation.errors import BagError, MessageTypeError, MissingTopicError, ShapeError
from robot_energy.foundation.files.output_folder import OutputFolder

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


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
        from mcap.writer import CompressionType, Writer

        kinds = {"zstd": CompressionType.ZSTD, "none": CompressionType.NONE}
        if compression not in kinds:
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
            self._writer = Writer(self._file, compression=kinds[compression])
            self._writer.start(profile="ros2", library=LIBRARY)
        except OSError as error:
            raise self._failed(error) from error
        except BaseException:
            self._folder.discard()
            raise
        self._open = True

    def add_topic(self, topic: str, msgtype: str, qos: Qos = DEFAULT_QOS) -> None:
        """Announce a topic."""
        self._check_open()
        if topic in self._topics:
            raise BagError(f"{topic} is added to {self.path} a second time", "each topic once")
        if msgtype not in self._store.fielddefs:
            raise MessageTypeError(f"the message type {msgtype} is unknown", "a known type")
        type_hash = self._store.hash_rihs01(msgtype)
        if msgtype not in self._schemas:
            definition, _ = self._store.generate_msgdef(msgtype, ros_version=2)
            self._schemas[msgtype] = self._writer.register_schema(
                msgtype, "ros2msg", definition.encode()
            )
        notes = {"offered_qos_profiles": qos_yaml(qos), "topic_type_hash": type_hash}
        self._channels[topic] = self._writer.register_channel(
            topic, "cdr", self._schemas[msgtype], notes
        )
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
        self._check_open()
        if topic not in self._channels:
            raise MissingTopicError(f"{topic} was not added to {self.path}", "add_topic first")
        times = np.atleast_1d(np.asarray(log_time_ns, dtype=np.int64))
        if times.shape != (len(rows),) or (len(times) and int(times.min()) < 0):
            raise ShapeError(
                f"{len(rows)} messages of {topic} came with times of shape {times.shape}",
                "one time per message, none negative",
            )
        self.write_in_order(zip(times.tolist(), repeat(topic), _rows(rows), strict=False))

    def write_in_order(self, messages: Iterable[tuple[int, str, bytes]]) -> None:
        """Append messages of several topics, one after the other.

        Args:
            messages: Log time, not negative [ns]; topic that was added; complete serialized
                message.
        """
        self._check_open()
        channels, counts, add = self._channels, self._counts, self._writer.add_message
        first, last = self._first, self._last
        try:
            for time, topic, row in messages:
                add(channels[topic], time, row, time)
                counts[topic] += 1
                first = time if first is None or time < first else first
                last = time if last is None or time > last else last
        except OSError as error:
            raise self._failed(error) from error
        self._first, self._last = first, last

    def close(self) -> None:
        """Write index and metadata and put the bag in place; a second call does nothing."""
        if not self._open:
            return
        try:
            self._writer.add_metadata("rosbag2", {"serialized_metadata": self._metadata(None)})
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
        """Close the bag; after an error in the block leave nothing of it."""
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
        """Give the bag up after a refusal of the disk."""
        self.discard()
        return BagError(
            f"{self.path / self._name} cannot be written ({error.strerror or error})",
            remedy="free space on the disk and write the bag again; the incomplete one was removed",
        )

    def _check_open(self) -> None:
        if not self._open:
            raise BagError(f"{self.path} is closed", "an open bag")


def _rows(rows: NDArray[np.uint8] | Sequence[bytes]) -> Sequence[bytes]:
    if not isinstance(rows, np.ndarray):
        return rows
    if rows.ndim != 2 or rows.dtype != np.uint8:
        raise ShapeError(f"messages of shape {rows.shape}, {rows.dtype}", "(n, size), uint8")
    data, size = rows.tobytes(), rows.shape[1]
    return [data[i : i + size] for i in range(0, len(data), size)]
