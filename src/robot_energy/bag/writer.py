"""Write rosbag2 folders: one MCAP file and metadata.yaml, as Jazzy's ``ros2 bag`` does."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.bag.metadata import (
    DEFAULT_QOS,
    FILE_NAME,
    Qos,
    TopicEntry,
    metadata_yaml,
    qos_yaml,
)
from robot_energy.errors import BagError, MessageTypeError, MissingTopicError, ShapeError
from robot_energy.wire.types import typestore as default_typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_LIBRARY = "robot_energy"


class BagWriter:
    """Writes one bag; use as a context manager, or call ``close``.

    Equal calls give equal bytes (with equal versions of mcap and zstandard): no clock, no random
    number and no machine name goes in.

    Args:
        path: Folder of the bag, made here.
        compression: ``zstd`` or ``none``.
        overwrite: Replace a bag that is there.
        typestore: Definitions; default those of ROS 2 Jazzy and ros2_energy_msgs.
        origin: Where the recording comes from, in words, noted with the bag.

    Raises:
        BagError: If the folder exists (without ``overwrite``), holds other things than a bag, or
            cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        compression: Literal["zstd", "none"] = "zstd",
        overwrite: bool = False,
        typestore: Typestore | None = None,
        origin: str = "",
    ) -> None:
        from mcap.writer import CompressionType, Writer

        kinds = {"zstd": CompressionType.ZSTD, "none": CompressionType.NONE}
        if compression not in kinds:
            raise BagError(f"unknown compression {compression!r}", "zstd or none")
        self.path = Path(path)
        self._origin = origin
        self._store = default_typestore() if typestore is None else typestore
        self._topics: dict[str, TopicEntry] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._first: int | None = None
        self._last: int | None = None
        self._open = False
        file = self.path / f"{self.path.name}_0.mcap"
        self._make_folder(overwrite)
        try:
            self._file = file.open("xb", buffering=2**20)
            self._writer = Writer(self._file, compression=kinds[compression])
            self._writer.start(profile="ros2", library=_LIBRARY)
        except OSError as error:
            raise BagError(f"{file} cannot be written ({error.strerror})") from error
        self._name = file.name
        self._open = True

    def add_topic(self, topic: str, msgtype: str, qos: Qos = DEFAULT_QOS) -> None:
        """Announce a topic.

        Args:
            topic: Name of the topic.
            msgtype: Message type.
            qos: Quality of service noted with it.

        Raises:
            BagError: If the topic is already there, or the bag is closed.
            MessageTypeError: If the type is unknown.
        """
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
            topic: A topic that was added.
            log_time_ns: Log time of each message, shape (n,). [ns]
            rows: Complete serialized messages: uint8, shape (n, size), or n byte strings.

        Raises:
            MissingTopicError: If the topic was not added.
            ShapeError: If times and messages do not match, or a time is negative.
            BagError: If the bag is closed or the disk refuses; the bag is then closed, and what
                was written before can be read.
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
        if not len(times):
            return
        low, high = int(times.min()), int(times.max())
        channel, add = self._channels[topic], self._writer.add_message
        try:
            for time, row in zip(times.tolist(), _rows(rows), strict=True):
                add(channel, time, row, time)
        except OSError as error:
            raise self._failed(error) from error
        self._counts[topic] += len(times)
        self._first = low if self._first is None else min(self._first, low)
        self._last = high if self._last is None else max(self._last, high)

    def close(self) -> None:
        """Write index and metadata and close the file; a second call does nothing.

        Raises:
            BagError: If the disk refuses.
        """
        if not self._open:
            return
        try:
            self._writer.add_metadata("rosbag2", {"serialized_metadata": self._metadata(None)})
            self._writer.finish()
            self._file.close()
            (self.path / FILE_NAME).write_text(self._metadata(self._name), encoding="utf-8")
        except OSError as error:
            raise self._failed(error) from error
        self._open = False

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag, also after an error in the block: what was written can be read."""
        self.close()

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
        """Close the file after a refusal of the disk, keeping what reached it."""
        self._open = False
        with suppress(OSError):  # it is closed even when its last bytes are refused
            self._file.close()
        return BagError(
            f"{self.path / self._name} cannot be written any further ({error.strerror})",
            remedy="make room on the disk; the part before it can still be read",
        )

    def _check_open(self) -> None:
        if not self._open:
            raise BagError(f"{self.path} is closed", "an open bag")

    def _make_folder(self, overwrite: bool) -> None:
        try:
            if self.path.exists():
                inside = sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]
                foreign = [p.name for p in inside if p.name != FILE_NAME and p.suffix != ".mcap"]
                if not overwrite or foreign or not self.path.is_dir():
                    raise BagError(
                        f"{self.path} exists" + (f" and holds {foreign}" if foreign else ""),
                        "a new folder" if not overwrite else "a new folder or an MCAP bag",
                        "choose another name" + ("" if overwrite else ", or allow overwriting"),
                    )
                for file in inside:
                    file.unlink()
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BagError(f"{self.path} cannot be made ({error.strerror})") from error


def _rows(rows: NDArray[np.uint8] | Sequence[bytes]) -> Sequence[bytes]:
    if not isinstance(rows, np.ndarray):
        return rows
    if rows.ndim != 2 or rows.dtype != np.uint8:
        raise ShapeError(f"messages of shape {rows.shape}, {rows.dtype}", "(n, size), uint8")
    data, size = rows.tobytes(), rows.shape[1]
    return [data[i : i + size] for i in range(0, len(data), size)]
