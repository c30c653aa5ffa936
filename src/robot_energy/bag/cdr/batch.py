"""Serialized messages of one topic, on their way from a bag or subscription to the decoder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.foundation.errors import ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class RawBatch:
    """Serialized messages of one topic inside one shared buffer, in log order.

    Attributes:
        msgtype: Message type, such as ``sensor_msgs/msg/JointState``.
        log_time_ns: When each message was recorded or received, int64, shape (n,). [ns]
        buffer: Bytes that hold every message, uint8, one-dimensional and contiguous.
        offset: First byte of each message (of its CDR encapsulation header), int64, shape (n,).
        length: Bytes of each message, int64, shape (n,).
    Validity: offsets and lengths come from the data and may be wrong; the decoder checks them.
    """

    topic: str
    msgtype: str
    log_time_ns: NDArray[np.int64]
    buffer: NDArray[np.uint8]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]

    @classmethod
    def from_messages(
        cls,
        topic: str,
        msgtype: str,
        log_time_ns: ArrayLike,
        messages: Sequence[bytes | memoryview],
    ) -> RawBatch:
        """Return messages received at times of shape (n,) [ns], in a buffer of their own."""
        times = np.atleast_1d(np.asarray(log_time_ns, dtype=np.int64))
        if times.shape != (len(messages),):
            raise ShapeError(
                f"{len(messages)} messages of {topic} came with times of shape {times.shape}",
                f"shape ({len(messages)},)",
            )
        length = np.fromiter(map(len, messages), np.int64, len(messages))
        buffer = np.frombuffer(b"".join(messages), dtype=np.uint8)
        return cls(topic, msgtype, times, buffer, np.cumsum(length) - length, length)

    @classmethod
    def joined(cls, parts: Sequence[dict[str, RawBatch]]) -> dict[str, RawBatch]:
        """Return batches that came one after the other joined, one a topic."""
        if len(parts) == 1:
            return parts[0]
        buffers: dict[int, tuple[int, NDArray[np.uint8]]] = {}
        size = 0
        found: dict[str, list[RawBatch]] = {}
        for part in parts:
            for topic, batch in part.items():
                found.setdefault(topic, []).append(batch)
                if id(batch.buffer) not in buffers:
                    buffers[id(batch.buffer)] = size, batch.buffer
                    size += len(batch.buffer)
        buffer = np.concatenate([each for _, each in buffers.values()])
        return {
            topic: replace(
                batches[0],
                log_time_ns=np.concatenate([b.log_time_ns for b in batches]),
                buffer=buffer,
                offset=np.concatenate([b.offset + buffers[id(b.buffer)][0] for b in batches]),
                length=np.concatenate([b.length for b in batches]),
            )
            for topic, batches in found.items()
        }

    def __len__(self) -> int:
        return len(self.offset)

    def __getitem__(self, rows: slice | NDArray[np.int64]) -> RawBatch:
        """Return some of the messages, in the order given, in the same buffer."""
        return replace(
            self,
            log_time_ns=self.log_time_ns[rows],
            offset=self.offset[rows],
            length=self.length[rows],
        )

    def copy(self) -> RawBatch:
        """Return the messages in a buffer of their own, without what lies between them."""
        messages = [self.row(number) for number in range(len(self))]
        return self.from_messages(self.topic, self.msgtype, self.log_time_ns, messages)

    def pieces(self, max_bytes: int) -> Iterator[tuple[int, RawBatch]]:
        """Yield pieces of at most so many bytes, or of one message, behind their first row."""
        if int(self.length.sum()) <= max_bytes:
            yield 0, self
            return
        end = np.cumsum(self.length)
        start = 0
        while start < len(self):
            before = int(end[start - 1]) if start else 0
            stop = max(int(np.searchsorted(end, before + max_bytes, side="right")), start + 1)
            yield start, self[slice(start, stop)]
            start = stop

    def row(self, i: int) -> bytes:
        start, length = int(self.offset[i]), int(self.length[i])
        if not 0 <= start <= start + length <= len(self.buffer):
            raise ShapeError(
                f"message {i} of {self.topic} spans bytes {start} to {start + length}",
                f"a span inside the {len(self.buffer)} bytes of the buffer",
            )
        return self.buffer[start : start + length].tobytes()
