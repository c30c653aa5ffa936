"""Find the messages in a block of MCAP records, by walking: an index may be wrong."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from struct import Struct
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.mcap_records import CHANNEL, FRAME, MESSAGE, MESSAGE_FIXED, SCHEMA
from robot_energy.physics import kernels

_HEAD = FRAME.size + MESSAGE_FIXED
_MESSAGE_HEAD = Struct("<HIQ")
MAX_DEFINITIONS = 1000  # schemas and channels in a block that the kernel takes

OnRecord = Callable[[int, memoryview], None]
"""Called with opcode and content of each Schema and Channel record on the way."""


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages of one channel in file order: log time [ns], first byte and length, each (n,)."""

    log_time_ns: NDArray[np.int64]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]


@dataclass(slots=True)
class McapChunk:
    """A block of records that was looked through."""

    buffer: NDArray[np.uint8]
    messages: dict[int, Messages] = field(default_factory=dict[int, Messages])
    end: Annotated[int, "First byte after the last whole record that belongs here."] = 0
    count: int = 0
    verified: bool = False


def walked_block(
    data: bytes | memoryview, on_record: OnRecord, limit: int | None = None
) -> McapChunk:
    """Find the messages of a block of records one after another.

    Args:
        data: Unpacked chunk, or a part of the file that begins with a record.
        limit: Most messages to take; None for all.

    Returns:
        The block; its ``end`` is where a record begins that is cut off, is no Schema, Channel or
        Message, or is beyond the limit.
    """
    view = memoryview(data)
    if kernels.compiled is not None:
        block = _compiled_walk(view, on_record, len(view) if limit is None else limit)
        if block is not None:
            return block
    found: dict[int, array[int]] = {}  # time, place and length of each message, flat
    pos, count = 0, 0
    while len(view) - pos >= FRAME.size and (limit is None or count < limit):
        opcode, length = FRAME.unpack_from(view, pos)
        body = pos + FRAME.size
        if opcode not in (MESSAGE, SCHEMA, CHANNEL) or length > len(view) - body:
            break
        if opcode == MESSAGE:
            if length < MESSAGE_FIXED:
                break
            channel, _, log = _MESSAGE_HEAD.unpack_from(view, body)
            flat = found.get(channel)
            if flat is None:
                flat = found[channel] = array("Q")
            flat.extend((log, body + MESSAGE_FIXED, length - MESSAGE_FIXED))
            count += 1
        else:
            on_record(opcode, view[body : body + length])
        pos = body + length
    block = McapChunk(np.frombuffer(data, dtype=np.uint8), end=pos, count=count)
    for channel, flat in found.items():
        columns = np.frombuffer(flat, dtype=np.uint64).reshape(-1, 3).T.astype(np.int64)
        block.messages[channel] = Messages(*columns)
    return block


def _compiled_walk(view: memoryview, on_record: OnRecord, limit: int) -> McapChunk | None:
    """Do the same with the kernel; None where the block has more definitions than it takes."""
    assert kernels.compiled is not None
    table = np.empty((4, min(limit, len(view) // _HEAD)), dtype=np.int64)
    others = np.empty(MAX_DEFINITIONS, dtype=np.int64)
    count, met, end = kernels.compiled.messages(view, table, others, limit)
    if met == MAX_DEFINITIONS:
        return None
    for pos in others[:met].tolist():
        opcode, length = FRAME.unpack_from(view, pos)
        on_record(opcode, view[pos + FRAME.size : pos + FRAME.size + length])
    block = McapChunk(np.frombuffer(view, dtype=np.uint8), end=end, count=count)
    owner, places = table[0, :count], table[1:, :count]
    for channel in np.flatnonzero(np.bincount(owner)).tolist():
        mine = owner == channel
        block.messages[channel] = Messages(*(places if mine.all() else places[:, mine]))
    return block
