"""Serialized messages of one topic, on their way from a bag or subscription to the decoder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.errors import ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class RawBatch:
    """Serialized messages of one topic inside one shared buffer, in log order.

    Attributes:
        topic: Name of the topic.
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
        """Gather messages that were received one by one.

        Args:
            topic: Name of the topic.
            msgtype: Message type.
            log_time_ns: Time of receipt of each message, shape (n,). [ns]
            messages: The n serialized messages, in the order of their times.

        Returns:
            The batch; its buffer is a copy.

        Raises:
            ShapeError: If there are not as many times as messages.
        """
        times = np.atleast_1d(np.asarray(log_time_ns, dtype=np.int64))
        if times.shape != (len(messages),):
            raise ShapeError(
                f"{len(messages)} messages of {topic} came with times of shape {times.shape}",
                f"shape ({len(messages)},)",
            )
        length = np.array([len(message) for message in messages], dtype=np.int64)
        buffer = np.frombuffer(b"".join(messages), dtype=np.uint8)
        return cls(topic, msgtype, times, buffer, np.cumsum(length) - length, length)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.offset)

    def row(self, i: int) -> bytes:
        """Return message ``i`` as bytes.

        Args:
            i: Index of the message; negative counts from the end.

        Returns:
            The serialized message.

        Raises:
            ShapeError: If the message is not wholly inside the buffer.
        """
        start, length = int(self.offset[i]), int(self.length[i])
        if not 0 <= start <= start + length <= len(self.buffer):
            raise ShapeError(
                f"message {i} of {self.topic} spans bytes {start} to {start + length}",
                f"a span inside the {len(self.buffer)} bytes of the buffer",
            )
        return self.buffer[start : start + length].tobytes()
