"""Bags whose parts are exchanged, doubled, cut or lie about each other; message definitions.

The edits know the structure of the file, so that they reach what a flipped bit does not. A bag
that is read without a word must hold what was recorded, message for message.
"""

import functools
import resource
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass

import lz4.frame
import numpy as np
import zstandard
from online import example
from target import done, in_file, scratch

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr import Decoder, RawBatch, typestore
from robot_energy.bag.cdr.schema import compile_schema, leaf_paths
from robot_energy.bag.cdr.types import extended
from robot_energy.bag.mcap_records import (
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    FRAME,
    MAGIC,
    MESSAGE_INDEX,
    STATISTICS,
    unpack_chunk,
)
from robot_energy.foundation.errors import MessageTypeError
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.inputs.meter.source import FLOAT64

MAX_SECONDS = 5  # of one input, in this process
MAX_MEBIBYTES = 512
TOPICS = {"/joints": JOINT_STATE, "/heat": FLOAT64}


def within_bounds(run: Callable[[bytes], bool]) -> Callable[[bytes], bool]:
    """Make a target fail on an input that takes too long or too much memory."""

    @functools.wraps(run)
    def bounded(data: bytes) -> bool:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        begin = time.process_time()
        taken = run(data)
        assert time.process_time() - begin < MAX_SECONDS, "too long"
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak
        assert grown < MAX_MEBIBYTES * 1024, f"{grown // 1024} MiB more"
        return taken

    return bounded


@dataclass
class Record:
    """A record: its opcode, content, the length it gives, and what it was written as."""

    opcode: int
    body: bytes
    length: int
    origin: int

    @property
    def data(self) -> bytes:
        return FRAME.pack(self.opcode, self.length) + self.body


def records(data: bytes, start: int, stop: int) -> list[Record]:
    """Records between two places; their origin is where they stood."""
    found: list[Record] = []
    while start < stop:
        opcode, length = FRAME.unpack_from(data, start)
        body = start + FRAME.size
        found.append(Record(opcode, data[body : body + length], length, start))
        start = body + length
    return found


@functools.cache
def clean() -> tuple[bytes, tuple[tuple[str, int, bytes], ...]]:
    """A bag of several chunks, some with one topic only, and its messages."""
    folder = scratch() / "clean"
    rows = {topic: example(kind) for topic, kind in TOPICS.items()}
    with BagWriter(folder, "zstd", overwrite=True) as bag:
        bag._writer._Writer__chunk_size = 2000  # so that there are many
        for topic, kind in TOPICS.items():
            bag.add_topic(topic, kind)
        for turn in range(20):
            for topic, row in rows.items():
                count = 12 if topic == "/joints" else 40 * (turn % 4 == 1)
                bag.write(topic, np.arange(count) + 1000 * turn, [row] * count)
    path = folder / "clean_0.mcap"
    messages, reader = messages_of(path)
    assert not reader.problems
    return path.read_bytes(), tuple(sorted(messages))


def messages_of(path, topics=tuple(TOPICS)) -> tuple[list[tuple[str, int, bytes]], BagReader]:
    """What a bag gives for the topics that it has."""
    reader = BagReader(path)
    reader.typestore  # noqa: B018
    found = [
        (topic, int(batch.log_time_ns[row]), batch.row(row))
        for part in reader.parts([topic for topic in topics if topic in reader.topics])
        for topic, batch in part.items()
        for row in range(len(batch))
    ]
    return found, reader


@functools.cache
def bomb() -> bytes:
    """A chunk of kilobytes that becomes 16 MiB, of which it declares less or all."""
    return zstandard.compress(bytes(16 * 2**20))


def chunk(content: bytes, packed: bytes, compression: bytes, declared: int) -> bytes:
    """A chunk without checksum."""
    head = struct.pack("<QQQI", 0, 0, declared, 0) + struct.pack("<I", len(compression))
    return head + compression + struct.pack("<Q", len(packed)) + packed


def repacked(body: bytes, value: int) -> bytes:
    """The same chunk in another packing."""
    content = bytes(unpack_chunk(memoryview(body))[0])
    packed, name = [
        (content, b""), (zstandard.compress(content), b"zstd"),
        (bytes(lz4.frame.compress(content)), b"lz4"),
    ][value % 3]  # fmt: skip
    head = body[:28] + struct.pack("<I", len(name)) + name
    return head + struct.pack("<Q", len(packed)) + packed


def edited(data: bytes, edits: bytes) -> bytes:
    """A bag after some edits of five bytes each: kind, two places, a value."""
    start = int.from_bytes(data[-28:-20], "little")
    body = records(data, len(MAGIC), start)
    summary = records(data, start, len(data) - len(MAGIC) - 29)
    keep_places = bool(edits and edits[0] & 1)
    cut: int | None = None
    tail = b""
    for place in range(1, len(edits) - 4, 5):
        kind, first, second, low, high = edits[place : place + 5]
        value = low + 256 * high
        here = first % max(len(body), 1)
        there = second % max(len(body), 1)
        kind %= 16
        if kind == 0 and body:
            body.insert(there, body[here])
        elif kind == 1 and body:
            del body[here]
        elif kind == 2 and body:
            body[here], body[there] = body[there], body[here]
        elif kind in (3, 4):
            length = 4 if kind == 3 else 20
            extra = Record(DATA_END if kind == 3 else FOOTER, bytes(length), length, -1)
            body.insert(here, extra)
        elif kind in (5, 6, 7, 8, 11):
            wanted = STATISTICS if kind in (7, 8) else CHUNK_INDEX
            fitting = [index for index, one in enumerate(summary) if one.opcode == wanted]
            if not fitting:
                continue
            index = fitting[first % len(fitting)]
            one = summary[index]
            content = bytearray(one.body)
            if kind == 5 and len(content) >= 38:
                content[36:38] = struct.pack("<H", value % 4)
            elif kind == 6:
                content[24:32] = struct.pack("<Q", value)
            elif kind == 7:
                content[:8] = struct.pack("<Q", value)
            elif kind == 8 and len(content) >= 56:
                content[48:56] = struct.pack("<Q", value)
            else:
                summary[index:index] = [one] * (value % 200)
            summary[index] = Record(one.opcode, bytes(content), one.length, one.origin)
        elif kind in (9, 13, 15):
            pool = summary if second % 4 == 0 and kind == 9 else body
            if kind == 15:
                pool = [one for one in body if one.opcode == MESSAGE_INDEX]
            if not pool:
                continue
            one = pool[first % len(pool)]
            content = bytearray(one.body)
            length = one.length
            if kind == 13:
                length = max(0, length + value - 2**15)
            elif content:
                spot = value % len(content) if kind == 9 else value % min(2, len(content))
                content[spot] ^= 1 << second % 8
            changed = Record(one.opcode, bytes(content), length, one.origin)
            owner = summary if pool is summary else body
            owner[next(i for i, other in enumerate(owner) if other is one)] = changed
        elif kind == 10:
            packed = bomb()
            content = chunk(b"", packed, b"zstd", [1000, 16 * 2**20, 2**40][value % 3])
            body.insert(here, Record(CHUNK, content, len(content), -1))
        elif kind == 12:
            cut = value
        elif kind == 14:
            chunks = [i for i, one in enumerate(body) if one.opcode == CHUNK and one.origin >= 0]
            if chunks:
                one = body[chunks[first % len(chunks)]]
                try:
                    content = repacked(one.body, value)
                except Exception:
                    continue
                index = next(i for i, other in enumerate(body) if other is one)
                body[index] = Record(CHUNK, content, len(content), one.origin)
        if len(body) > 400 or len(summary) > 3000:
            break
    places: dict[int, int] = {}
    pos = len(MAGIC)
    for one in body:
        places.setdefault(one.origin, pos)
        pos += len(one.data)
    if not keep_places:
        for index, one in enumerate(summary):
            if one.opcode == CHUNK_INDEX and len(one.body) >= 32:
                was = int.from_bytes(one.body[16:24], "little")
                moved = one.body[:16] + struct.pack("<Q", places.get(was, was)) + one.body[24:]
                summary[index] = Record(one.opcode, moved, one.length, one.origin)
    footer = struct.pack("<QQI", start if keep_places else pos, 0, 0)
    out = MAGIC + b"".join(one.data for one in body) + b"".join(one.data for one in summary)
    out += FRAME.pack(FOOTER, 20) + footer + MAGIC + tail
    return out if cut is None else out[: cut * len(out) // 2**16]


@within_bounds
def containers(edits: bytes) -> bool:
    """A bag whose parts were edited gives what was recorded, or says what is wrong."""
    data, expected = clean()
    path = in_file("edited.mcap", edited(data, edits))

    def read() -> None:
        for topics in (tuple(TOPICS), ("/joints",)):
            found, reader = messages_of(path, topics)
            if reader.problems or not set(topics) <= reader.topics.keys():
                continue
            wanted = [message for message in expected if message[0] in topics]
            assert sorted(found) == wanted, (len(found), len(wanted))
            assert all(reader.topics[topic].msgtype == TOPICS[topic] for topic in topics)

    return done(read)


def container_seeds() -> list[bytes]:
    """The bag as it is, one edit of each kind, a message type that the summary lacks."""
    return [b"", *(bytes([0, kind, 5, 9, 33, 7]) for kind in range(16)), bytes([0, 9, 0, 0, 0, 0])]


@functools.cache
def joint_state_definition() -> str:
    """The definition that a bag stores with joint states."""
    text, _ = typestore().generate_msgdef(JOINT_STATE, ros_version=2)
    return text


@within_bounds
def message_definition(data: bytes) -> bool:
    """Definitions in a bag are used or left out; joint states keep the meaning of their own."""
    text = data.decode("utf-8", "replace")
    said: list[str] = []
    definitions = {
        "a/msg/T0": ("ros2idl" if text.lstrip().startswith("module") else "ros2msg", text),
        JOINT_STATE: ("ros2msg", joint_state_definition()),
    }
    store = extended(typestore(), definitions, said.append)
    message = example(JOINT_STATE)
    batch = RawBatch.from_messages("/j", JOINT_STATE, [1], [message])
    (run,) = Decoder(JOINT_STATE, ("name", "position"), store).decode(batch).runs
    assert run.array("position").tolist() == [[1.0, 1.0]]
    try:
        paths = leaf_paths(compile_schema("a/msg/T0", store))
    except MessageTypeError:
        return False
    for content in (message, b"\x00\x01\x00\x00" + bytes(200), b"\x00\x00\x00\x00\xff\xff"):
        other = RawBatch.from_messages("/t", "a/msg/T0", [1], [content])
        Decoder("a/msg/T0", paths[:50], store).decode(other)
    return not said


def definition_seeds() -> list[bytes]:
    """Definitions of messages, one made of others."""
    rule = "=" * 80
    nested = "a/T1 a\na/T1[3] b\na/T1[] c\n" + f"{rule}\nMSG: a/T1\nfloat64[<=3] x\nstring s\n"
    idl = b"module a { module msg { struct T0 { double x; sequence<string> names; }; }; };"
    return [b"float64 x\nstring[] names\n", nested.encode(), joint_state_definition().encode(), idl]
