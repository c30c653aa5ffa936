"""BagReader on damaged and hostile files: the whole part is delivered, the rest is named."""

import os
import re
import struct
import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest
import zstandard

from robot_energy.bag import BagReader
from robot_energy.bag.mcap_records import (
    CHUNK,
    DATA_END,
    FOOTER,
    FRAME,
    HEADER,
    MAGIC,
    MESSAGE_INDEX,
    STATISTICS,
)
from robot_energy.bag.metadata import read_folder_info
from robot_energy.foundation.errors import BagError


def records(data):
    """Yield opcode, first byte of the content and its length of every record of a file."""
    pos = len(MAGIC)
    while pos < len(data) - len(MAGIC):
        opcode, length = FRAME.unpack_from(data, pos)
        yield opcode, pos + FRAME.size, length
        pos += FRAME.size + length


def test_a_bag_cut_anywhere_gives_what_is_whole_before(tmp_path, bags):
    file = bags.write_bag(tmp_path / "bag", n=2000, compression="zstd", block=50)
    data = file.read_bytes()
    whole, _ = bags.read_all(file)
    ends = [body + length for _, body, length in records(data)]
    near = [cut + i for cut in ends for i in (-1, 0, 1) if cut + i < len(data)]
    path = tmp_path / "cut.mcap"
    counts = []
    for cut in sorted({*range(8, len(data), 5000), *near, *range(len(data) - 60, len(data))}):
        path.write_bytes(data[:cut])
        found, reader = bags.read_all(path)
        assert found == whole[: len(found)]
        assert len(reader.problems) == 1, (cut, reader.problems)
        text = reader.problems[0]
        counts.append(len(found))
        if number := re.search(r"(\d+) messages before it were read", text):
            assert int(number[1]) == len(found)
            assert reader.message_count == len(found)
        else:
            assert "closing part" in text
            assert found == whole
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == len(whole)


def test_a_cut_says_where(tmp_path, bags):
    file = bags.write_bag(tmp_path / "bag", n=20_000)
    data = file.read_bytes()
    chunks = [body - FRAME.size for opcode, body, _ in records(data) if opcode == CHUNK]
    assert len(chunks) >= 3
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: chunks[2] + 1000])
    found, reader = bags.read_all(path)
    assert reader.problems == [
        f"cut.mcap: the file ends inside a chunk at byte {chunks[2]} of {chunks[2] + 1000}; "
        f"{len(found)} messages before it were read"
    ]
    assert len(found) > 5000


def test_a_cut_file_of_loose_messages_gives_the_whole_ones(tmp_path, bags):
    path = tmp_path / "loose.mcap"
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(100))]
    with bags.foreign_mcap(path, use_chunking=False) as writer:
        for i, row in enumerate(rows):
            writer.add_message(writer.heat, i, row, i)
    data = path.read_bytes()
    path.write_bytes(data[: data.index(rows[60]) + 5])
    found, reader = bags.read_all(path)
    assert [row for _, _, row in found] == rows[:60]
    assert "ends inside a record" in reader.problems[0]


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_a_flipped_bit_is_never_silent(tmp_path, bags, compression):
    """Either all messages are as written, or a sentence says what is not."""
    file = bags.write_bag(tmp_path / "bag", n=400, compression=compression, block=20)
    data = file.read_bytes()
    whole, _ = bags.read_all(file)
    path = tmp_path / "flip.mcap"
    random = np.random.default_rng(1)
    frames = [8 * (body - FRAME.size) + i for _, body, _ in records(data) for i in range(0, 72, 5)]
    bits = [*frames, *random.integers(0, 8 * len(data), 400).tolist()]
    for bit in bits:
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            found, reader = bags.read_all(path)
        except BagError:
            continue
        assert reader.problems or sorted(found) == sorted(whole), bit
        assert set(found) <= set(whole), bit


def without_summary(data):
    """The same file as a writer without a summary leaves it."""
    end = next(body + length for kind, body, length in records(data) if kind == DATA_END)
    return data[:end] + FRAME.pack(FOOTER, 20) + bytes(20) + MAGIC


def test_records_that_vanish_without_a_summary_are_said(tmp_path, bags):
    """Each bit of each opcode and length; an invented end or index that swallows chunks."""
    file = bags.write_bag(tmp_path / "bag", n=9_000, compression="zstd", block=100)
    data = without_summary(file.read_bytes())
    path = tmp_path / "bare.mcap"
    path.write_bytes(data)
    whole, reader = bags.read_all(path)
    assert len(whole) == 9_090
    assert not reader.problems
    starts = [body - FRAME.size for _, body, _ in records(data)][1:]
    assert len([kind for kind, _, _ in records(data) if kind == CHUNK]) >= 2
    made = [
        data[:pos] + bytes([data[pos] ^ 1 << bit % 8]) + data[pos + 1 :]
        for start in starts
        for pos in (start, start + 1, start + 4)
        for bit in ((*range(8),) if pos == start else (0, 5))
    ]
    kinds = (HEADER, FOOTER, MESSAGE_INDEX, STATISTICS, DATA_END, CHUNK | 0x80)
    for start, end in ((starts[1], starts[-2]), (starts[2], starts[2])):
        for kind in kinds:
            for size in (0, 4, 20):
                made.append(data[:start] + FRAME.pack(kind, size) + bytes(size) + data[start:])
            made.append(data[:start] + FRAME.pack(kind, end - start) + data[start:])
    for number, damaged in enumerate(made):
        path.write_bytes(damaged)
        found, reader = bags.read_all(path)
        assert reader.problems or set(found) >= set(whole), number


def test_random_bytes_after_the_magic_never_raise_anything_else(tmp_path, bags):
    path = tmp_path / "noise.mcap"
    random = np.random.default_rng(2)
    for size in range(0, 400, 4):
        body = random.integers(0, 256, size, dtype=np.uint8)
        body[::9] = random.integers(0, 16, len(body[::9]))
        path.write_bytes(MAGIC + body.tobytes())
        _, reader = bags.read_all(path)
        assert reader.problems


def test_a_damaged_chunk_is_left_out_and_the_rest_read(tmp_path, bags):
    file = bags.write_bag(tmp_path / "bag", n=20_000)
    whole, _ = bags.read_all(file)
    data = bytearray(file.read_bytes())
    chunk = [(body, length) for op, body, length in records(data) if op == CHUNK][1]
    data[chunk[0] + 5000] ^= 1
    file.write_bytes(data)
    found, reader = bags.read_all(file)
    assert 0 < len(whole) - len(found) < 8000
    kept = set(found)
    assert found == [item for item in whole if item in kept]
    sentence = f"the chunk at byte {chunk[0] - 9} was left out: it holds bytes that do not match"
    assert sentence in reader.problems[0]


def test_a_lost_chunk_is_found_through_the_summary(tmp_path, bags):
    """A chunk whose length is damaged is passed over; the next ones are read."""
    file = bags.write_bag(tmp_path / "bag", n=20_000)
    whole, _ = bags.read_all(file)
    data = bytearray(file.read_bytes())
    bodies = [body for opcode, body, _ in records(data) if opcode == CHUNK]
    data[bodies[1] - 1] ^= 0x40
    file.write_bytes(data)
    found, reader = bags.read_all(file)
    assert 0 < len(whole) - len(found) < 8000
    assert f"bytes {bodies[1] - 9} to {bodies[2] - 9} were left out" in reader.problems[0]


def test_a_lost_chunk_is_found_though_others_are_passed_over(tmp_path, bags):
    path = tmp_path / "mixed.mcap"
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(3))]
    with bags.foreign_mcap(path, chunk_size=1000) as writer:
        for i, row in enumerate(rows):
            writer.add_message(writer.joints, i, bytes(2000), i)
            writer.add_message(writer.heat, i, row * 30, i)
    assert len(bags.read_all(path, ["/heat"])[0]) == 3
    data = bytearray(path.read_bytes())
    chunks = [body - FRAME.size for opcode, body, _ in records(data) if opcode == CHUNK]
    assert len(chunks) == 6
    data[chunks[3]] = 0x0C  # now it calls itself metadata
    path.write_bytes(data)
    found, reader = bags.read_all(path, ["/heat"])
    assert len(found) == 2
    assert "no chunk, though the summary lists one" in reader.problems[0]


@pytest.mark.parametrize(
    "lie", ["time", "offset", "channel", "swap", "twice", "drop", "far", "length"]
)
def test_a_wrong_message_index_is_not_believed(tmp_path, bags, lie):
    """The index carries no checksum: the records of the chunk decide."""
    file = bags.write_bag(tmp_path / "bag", n=200)
    whole, _ = bags.read_all(file)
    data = bytearray(file.read_bytes())
    body, length = next((b, n) for op, b, n in records(data) if op == MESSAGE_INDEX)
    entry = body + 6 + 16 * 3
    if lie == "time":
        data[entry] ^= 1
    elif lie == "offset":
        data[entry + 8] ^= 1
    elif lie == "swap":
        for op, place, _ in list(records(data)):
            if op == MESSAGE_INDEX:
                data[place] ^= 3
    elif lie == "channel":
        data[body] ^= 3
    elif lie == "twice":
        data[entry : entry + 16] = data[entry + 16 : entry + 32]
    elif lie == "far":
        data[entry + 15] = 0x7F
    elif lie == "length":
        data[body + 2] ^= 16
    else:  # drop the last entry: a private record takes its place
        pair = FRAME.pack(MESSAGE_INDEX, length - 32)
        data[body - 9 : body] = pair
        data[body + 2 : body + 6] = struct.pack("<I", length - 38)
        data[body + length - 32 : body + length] = FRAME.pack(0x80, 23) + bytes(23)
    file.write_bytes(data)
    found, reader = bags.read_all(file)
    assert sorted(found) == sorted(whole)
    assert reader.problems == []


def chunk_file(path, declared, packed, compression=b"zstd", crc=0):
    """Write an MCAP file of one chunk with these sizes."""
    head = struct.pack("<QQQI", 0, 0, declared, crc)
    name = struct.pack("<I", len(compression)) + compression
    body = head + name + struct.pack("<Q", len(packed)) + packed
    header = FRAME.pack(1, 8) + bytes(8)
    end = FRAME.pack(15, 4) + bytes(4) + FRAME.pack(2, 20) + bytes(20) + MAGIC
    path.write_bytes(MAGIC + header + FRAME.pack(CHUNK, len(body)) + body + end)


@pytest.mark.parametrize("known_size", [True, False])
@pytest.mark.parametrize("declared", [1000, 2**20])
def test_a_chunk_that_unpacks_to_more_than_it_declares_is_left_out(tmp_path, known_size, declared):
    """8 kB of zstd that unpack to 256 MiB: refused at once, without the memory."""
    path = tmp_path / "bomb.mcap"
    packer = zstandard.ZstdCompressor(write_content_size=known_size)
    chunk_file(path, declared, packer.compress(bytes(256 * 2**20)))
    refused(path, declared)


def refused(path, declared):
    tracemalloc.start()
    start = time.process_time()
    reader = BagReader(path)
    duration, peak = time.process_time() - start, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert reader.topics == {}
    assert len(reader.problems) == 1
    assert f"other than the {declared} bytes it declares" in reader.problems[0]
    assert duration < 20
    assert peak < 8 * 2**20


def test_a_packed_lz4_bomb_is_left_out(tmp_path):
    import lz4.frame

    path = tmp_path / "bomb.mcap"
    chunk_file(path, 1000, lz4.frame.compress(bytes(64 * 2**20)), b"lz4")
    refused(path, 1000)


@pytest.mark.parametrize(
    ("declared", "packed", "compression", "text"),
    [
        (2**40, b"", b"zstd", "more than the limit"),
        (2**63, b"", b"", "more than the limit"),
        (10, b"abc", b"", "other than the 10 bytes"),
        (10, b"abc", b"zstd", "damaged zstd data"),
        (10, b"abc" * 10, b"lz4", "damaged lz4 data"),
        (3, b"abc", b"bz2", "unknown compression 'bz2'"),
        (3, b"abc", b"\xff\xfe", "not UTF-8"),
    ],
)
def test_a_chunk_that_cannot_be_unpacked_is_named(tmp_path, declared, packed, compression, text):
    path = tmp_path / "odd.mcap"
    chunk_file(path, declared, packed, compression)
    reader = BagReader(path)
    assert len(reader.problems) == 1
    assert text in reader.problems[0]


def test_a_damaged_database_is_an_error_or_a_problem(tmp_path, bags):
    from rosbags.rosbag2 import Writer

    from robot_energy.bag.cdr import typestore

    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/heat", bags.TEMPERATURE, typestore=typestore())
        for i in range(2000):
            writer.write(connection, i, bags.temperature_rows(np.array([i]))[0].tobytes())
    (file,) = (tmp_path / "bag").glob("*.db3")
    data = file.read_bytes()
    whole, _ = bags.read_all(tmp_path / "bag")
    for cut in range(0, len(data), len(data) // 15):
        file.write_bytes(data[:cut])
        try:
            found, reader = bags.read_all(tmp_path / "bag")
        except BagError:
            continue
        assert reader.problems or found == whole


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x]\nb: [*a, *a]",
        "[" * 100_000,
        "- 1\n" * 300_000,
        "a: !!python/object/apply:os.system ['true']",
        "a: \ud800",
        "x" * (2**23 + 1),
        "rosbag2_bagfile_information: [1, 2]",
        "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: 3}",
    ],
)
def test_the_metadata_of_a_bag_is_no_way_in(tmp_path, bags, text):
    """The bag is read without it, and says so."""
    file = bags.write_bag(tmp_path / "bag", n=100)
    (file.parent / "metadata.yaml").write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(BagError):
        read_folder_info(file.parent)
    reader = BagReader(file.parent)
    assert reader.message_count == 101
    assert len(reader.problems) == 1


BOUNDED = """
import re, sys, time
from robot_energy.bag import BagReader
def peak():
    return int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
start, begin = peak(), time.process_time()
reader = BagReader(sys.argv[1])
count = sum(len(b) for part in reader.parts(list(reader.topics)) for b in part.values())
print(count, len(reader.problems), (peak() - start) // 1024, time.process_time() - begin)
"""


def read_apart(path):
    """Read in a process of its own: messages, problems, memory it took [MiB], time [s]."""
    done = subprocess.run(
        [sys.executable, "-c", BOUNDED, str(path)], capture_output=True, text=True, timeout=120,
        check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    count, problems, memory, duration = done.stdout.split()
    return int(count), int(problems), int(memory), float(duration)


def test_a_chunk_of_very_many_messages_keeps_within_bounds(tmp_path, bags):
    """20 kB that hold 700,000 empty messages, without an index."""
    schema = b"\x01\x00" + sized(b"sensor_msgs/msg/Temperature") + sized(b"ros2msg") + sized(b"")
    channel = b"\x01\x00\x01\x00" + sized(b"/heat") + sized(b"cdr") + sized(b"")
    message = FRAME.pack(5, 22) + b"\x01\x00" + bytes(20)
    content = FRAME.pack(3, len(schema)) + schema + FRAME.pack(4, len(channel)) + channel
    content += message * 700_000
    path = tmp_path / "bomb.mcap"
    chunk_file(path, len(content), zstandard.compress(content))
    assert path.stat().st_size < 100_000
    count, problems, memory, duration = read_apart(path)
    assert (count, problems) == (700_000, 0)
    assert memory < 100
    assert duration < 30


def sized(text):
    return struct.pack("<I", len(text)) + text


def test_ten_thousand_damaged_chunks_are_said_in_a_hundred_sentences(tmp_path):
    path = tmp_path / "rubble.mcap"
    chunk_file(path, 10, b"abc")
    data = path.read_bytes()
    start, stop = data.index(FRAME.pack(CHUNK, 4)[:1], 8 + 17), data.index(b"\x0f" + b"\x04")
    path.write_bytes(data[:start] + data[start:stop] * 10_000 + data[stop:])
    count, problems, _, duration = read_apart(path)
    assert (count, problems) == (0, 101)
    assert duration < 30


def test_definitions_that_would_fill_the_memory_are_left_out(tmp_path):
    """Twelve chunks of a few kB, each with a definition of 10 MiB."""
    path = tmp_path / "definitions.mcap"
    chunks = b""
    for key in range(12):
        text = struct.pack("<H", key + 1) + sized(b"a/msg/B") + sized(b"ros2msg")
        text += sized(bytes([65 + key]) * 10 * 2**20)
        content = FRAME.pack(3, len(text)) + text
        chunk_file(path, len(content), zstandard.compress(content))
        data = path.read_bytes()
        chunks += data[8 + 17 : data.index(b"\x0f\x04" + bytes(7))]
    path.write_bytes(data[: 8 + 17] + chunks + data[data.index(b"\x0f\x04" + bytes(7)) :])
    _, problems, memory, duration = read_apart(path)
    assert problems == 1
    assert memory < 400
    assert duration < 30


def test_metadata_need_not_name_the_storage(tmp_path):
    content = "rosbag2_bagfile_information: {relative_file_paths: [a.mcap]}"
    (tmp_path / "metadata.yaml").write_text(content)
    assert read_folder_info(tmp_path).files == ("a.mcap",)
