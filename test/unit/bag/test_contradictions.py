"""Bags that contradict themselves: read as far as possible, and what is wrong is said."""

import shutil
import struct
import time

import numpy as np
import pytest
from mcap.writer import Writer

from robot_energy.bag import BagReader
from robot_energy.bag.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    FOOTER_SIZE,
    FRAME,
    MAGIC,
    MESSAGE,
    SCHEMA,
    STATISTICS,
)

END = FRAME.pack(DATA_END, 4) + bytes(4)


def records(data, start=8):
    """Yield opcode, first byte of the content and its length of every record of a file."""
    pos = start
    while pos < len(data) - len(MAGIC):
        opcode, length = FRAME.unpack_from(data, pos)
        yield opcode, pos + FRAME.size, length
        pos += FRAME.size + length


def summary_start(data):
    return int.from_bytes(data[-28:-20], "little")


def without_checksum(data):
    """Zero the checksum of the summary, as a writer may."""
    data[-len(MAGIC) - 4 : -len(MAGIC)] = bytes(4)
    return data


def inserted(data, place, extra):
    """Put bytes into the data; what the end of the file says of the place moves along."""
    start = summary_start(data) + len(extra)
    moved = bytearray(data[:place] + extra + data[place:])
    for opcode, body, _ in records(moved, start):
        if opcode == CHUNK_INDEX:
            at = int.from_bytes(moved[body + 16 : body + 24], "little")
            if at >= place:
                moved[body + 16 : body + 24] = (at + len(extra)).to_bytes(8, "little")
    moved[-28:-20] = start.to_bytes(8, "little")
    return without_checksum(moved)


@pytest.fixture(scope="module")
def made(tmp_path_factory, bags):
    """An MCAP file of several chunks: its content and its messages."""
    file = bags.write_bag(tmp_path_factory.mktemp("made") / "bag", n=20_000)
    return file.read_bytes(), bags.read_all(file)[0]


@pytest.fixture
def whole(tmp_path, made):
    """The same, and a copy of the file."""
    target = tmp_path / "one.mcap"
    target.write_bytes(made[0])
    return target, *made


@pytest.mark.parametrize("footer", [False, True])
def test_the_end_of_the_data_in_the_middle_ends_nothing(whole, bags, footer):
    path, data, messages = whole
    second = [body - FRAME.size for opcode, body, _ in records(data) if opcode == CHUNK][1]
    extra = END + (FRAME.pack(FOOTER, 20) + bytes(20) if footer else b"")
    path.write_bytes(inserted(data, second, extra))
    found, reader = bags.read_all(path)
    assert found == messages
    assert len(reader.problems) == 1
    assert f"a record at byte {second} ends the data" in reader.problems[0]


def test_an_end_that_calls_the_data_its_summary_ends_nothing(whole, bags):
    path, data, messages = whole
    second = [body - FRAME.size for opcode, body, _ in records(data) if opcode == CHUNK][1]
    lying = inserted(data, second, END)
    lying[-28:-20] = (second + len(END)).to_bytes(8, "little")
    path.write_bytes(lying)
    found, reader = bags.read_all(path)
    assert found == messages
    assert any("belongs to the data" in problem for problem in reader.problems)
    assert any("ends the data" in problem for problem in reader.problems)


def test_files_one_behind_the_other_are_read_on(tmp_path, bags):
    whole = []
    for number in (0, 1):
        path = tmp_path / f"{number}.mcap"
        with bags.foreign_mcap(path) as writer:
            for i, row in enumerate(bags.temperature_rows(np.arange(50) + 100 * number)):
                writer.add_message(writer.heat, i + 100 * number, row.tobytes(), i)
        whole += bags.read_all(path)[0]
    (tmp_path / "both.mcap").write_bytes(
        b"".join((tmp_path / f"{number}.mcap").read_bytes() for number in (0, 1))
    )
    found, reader = bags.read_all(tmp_path / "both.mcap")
    assert found == whole
    assert any("ends the data" in problem for problem in reader.problems)


def test_a_chunk_is_not_passed_over_because_the_summary_names_other_channels(whole, bags):
    path, data, messages = whole
    lying = bytearray(data)
    for opcode, body, _ in records(data, summary_start(data)):
        if opcode == CHUNK_INDEX:
            size = int.from_bytes(data[body + 32 : body + 36], "little")
            for entry in range(body + 36, body + 36 + size, 10):
                lying[entry : entry + 2] = b"\x02\x00"  # of the temperatures
            break
    path.write_bytes(without_checksum(lying))
    found, reader = bags.read_all(path, ["/joints"])
    assert found == [message for message in messages if message[0] == "/joints"]
    assert len(reader.problems) == 1
    assert "other channels than the summary says" in reader.problems[0]
    assert sorted(bags.read_all(path)[0]) == sorted(messages)


@pytest.mark.parametrize("what", ["total", "channel"])
def test_counts_of_the_summary_that_are_wrong_are_said(whole, bags, what):
    path, data, messages = whole
    lying = bytearray(data)
    body = next(b for op, b, _ in records(data, summary_start(data)) if op == STATISTICS)
    if what == "total":
        lying[body : body + 8] = (7).to_bytes(8, "little")
    else:
        lying[body + 48 : body + 56] = (7).to_bytes(8, "little")
    path.write_bytes(without_checksum(lying))
    found, reader = bags.read_all(path)
    assert found == messages
    assert len(reader.problems) == 1
    assert "counts" in reader.problems[0]


def test_a_channel_that_the_summary_lacks_is_found(whole, bags):
    """Otherwise a bag loses a topic without a word."""
    path, data, messages = whole
    lying = bytearray(data)
    channels = [b for op, b, _ in records(data, summary_start(data)) if op == 4]
    lying[channels[0] - FRAME.size] = 0x80  # now a private record
    path.write_bytes(without_checksum(lying))
    found, reader = bags.read_all(path)
    assert sorted(found) == sorted(messages)
    assert reader.problems


def test_a_type_that_the_summary_lacks_is_found(whole, bags):
    """Otherwise a topic is there that gives no message, without a word."""
    path, data, messages = whole
    lying = bytearray(data)
    schemas = [b for op, b, _ in records(data, summary_start(data)) if op == SCHEMA]
    lying[schemas[0]] ^= 0x80  # now of an id that no channel names
    path.write_bytes(without_checksum(lying))
    found, reader = bags.read_all(path)
    assert sorted(found) == sorted(messages)
    assert reader.problems


def test_a_summary_without_definitions_is_no_contradiction(whole, bags):
    """A writer may leave them out."""
    path, data, messages = whole
    lean = bytearray(data)
    for opcode, body, _ in list(records(lean, summary_start(data))):
        if opcode in (SCHEMA, CHANNEL):
            lean[body - FRAME.size] = 0x80  # now a private record
    path.write_bytes(without_checksum(lean))
    found, reader = bags.read_all(path)
    assert (sorted(found), reader.problems) == (sorted(messages), [])


def test_messages_of_a_type_that_nothing_defines_are_said(tmp_path):
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        channel = writer.register_channel("/joints", "cdr", schema_id=0)
        writer.add_message(channel, 10**15, bytes(40), 10**15)
        writer.finish()
    reader = BagReader(path)
    assert list(reader.parts(["/joints"])) == []
    assert len(reader.problems) == 1
    assert "/joints" in reader.problems[0]


def test_chunk_indexes_inside_one_another_are_not_followed(tmp_path, bags):
    """20,000 entries that point into one large message: it is read once."""
    count, large = 20_000, 4 * 2**20
    head = MAGIC + FRAME.pack(1, 8) + bytes(8)
    inner = b"".join(
        FRAME.pack(MESSAGE, large - 9 * (index + 2) - 30) for index in range(count)
    ).ljust(large - 22, b"\x00")
    message = FRAME.pack(MESSAGE, large) + bytes(22) + inner
    start = len(head)
    data_end = start + len(message) + len(END)
    places = [start, *(start + FRAME.size + 22 + 9 * index for index in range(count))]
    summary = b"".join(
        FRAME.pack(CHUNK_INDEX, 64) + struct.pack("<QQQQ", 0, 0, place, length) + bytes(32)
        for length in (9, 200)
        for place in places
    )
    footer = FRAME.pack(FOOTER, 20) + struct.pack("<QQI", data_end, 0, 0) + MAGIC
    assert len(footer) == FOOTER_SIZE + len(MAGIC)
    path = tmp_path / "nested.mcap"
    path.write_bytes(head + message + END + summary + footer)
    begin = time.process_time()
    reader = BagReader(path)
    assert time.process_time() - begin < 20
    assert 1 <= len(reader.problems) <= 5
    assert any("overlap" in problem for problem in reader.problems)


def test_records_between_loose_messages_do_not_cost_a_megabyte_each(tmp_path, bags):
    row = bags.temperature_rows(np.arange(1))[0].tobytes()
    path = tmp_path / "mixed.mcap"
    with bags.foreign_mcap(path, use_chunking=False) as writer:
        writer.add_message(writer.heat, 0, row, 0)
    data = path.read_bytes()
    body, length = next((b, n) for op, b, n in records(data) if op == MESSAGE)
    message = data[body - FRAME.size : body + length]
    path.write_bytes(inserted(data, body - FRAME.size, (message + FRAME.pack(0x80, 0)) * 5000))
    begin = time.process_time()
    found, reader = bags.read_all(path)
    assert time.process_time() - begin < 20
    assert len(found) == 5001
    assert len(reader.problems) == 1


def listed_twice(folder):
    metadata = folder / "metadata.yaml"
    name = next(folder.glob("*.mcap")).name
    metadata.write_text(metadata.read_text().replace(f"    - {name}\n", f"    - {name}\n" * 2, 1))


def copied(folder):
    shutil.copy(next(folder.glob("*.mcap")), folder / "bag_1.mcap")
    (folder / "metadata.yaml").unlink()


def linked(folder):
    (folder / "bag_1.mcap").symlink_to(next(folder.glob("*.mcap")).name)
    (folder / "metadata.yaml").unlink()


@pytest.mark.parametrize("doubled", [listed_twice, copied, linked])
def test_a_file_that_comes_twice_is_read_once(tmp_path, bags, doubled):
    bags.write_bag(tmp_path / "bag", n=300)
    whole, _ = bags.read_all(tmp_path / "bag")
    doubled(tmp_path / "bag")
    found, reader = bags.read_all(tmp_path / "bag")
    assert found == whole
    assert reader.message_count == 303
    assert len(reader.problems) == 1
    assert "once" in reader.problems[0] or "the same as" in reader.problems[0]


def test_files_of_one_time_are_said(tmp_path, bags):
    folder = tmp_path / "split"
    folder.mkdir()
    for number, first in ((0, 0), (1, 30)):
        stamps = np.arange(first, first + 50) * 10**8
        with bags.foreign_mcap(folder / f"split_{number}.mcap") as writer:
            rows = bags.temperature_rows(stamps)
            for stamp, row in zip(stamps.tolist(), rows, strict=True):
                writer.add_message(writer.heat, stamp, row.tobytes(), stamp)
    found, reader = bags.read_all(folder)
    assert len(found) == 100
    assert reader.problems == ["files of the bag overlap by 1.900 s; what is in both counts twice"]


def test_metadata_that_counts_other_messages_is_said(tmp_path, bags):
    bags.write_bag(tmp_path / "bag", n=300)
    metadata = tmp_path / "bag" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 303", "message_count: 30"))
    found, reader = bags.read_all(tmp_path / "bag")
    assert len(found) == 303
    assert reader.problems == ["metadata.yaml counts 30 messages where the files hold 303"]
