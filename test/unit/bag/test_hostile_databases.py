"""Sqlite bags and packed bags that lie: bounded, never run, never silent."""

import os
import resource
import sqlite3
import time

import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from refusals import refused
from robot_energy.bag import BagReader
from robot_energy.bag.cdr import typestore
from robot_energy.foundation.errors import BagError

TOPICS = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
INSERT INTO topics VALUES(1, '/heat', 'sensor_msgs/msg/Temperature', 'cdr');
"""
MESSAGES = "CREATE TABLE messages({}, topic_id INTEGER, timestamp INTEGER, data BLOB);"
PLAIN = TOPICS + MESSAGES.format("id INTEGER PRIMARY KEY")
COUNT = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c {}) SELECT {} FROM c;"


def database(path, script):
    with sqlite3.connect(path) as base:
        base.executescript(f"BEGIN; {script} COMMIT;")
    base.close()
    return path


def insert(*values):
    return "INSERT INTO messages(topic_id, timestamp, data) VALUES({});".format(",".join(values))


def read(path):
    reader = BagReader(path)
    rows = [
        (int(batch.log_time_ns[i]), batch.row(i))
        for part in reader.parts([name for name in reader.topics if name == "/heat"])
        for batch in part.values()
        for i in range(len(batch))
    ]
    return rows, reader


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (TOPICS, "no table of messages"),
        ("", "not a sqlite3 file"),
        (TOPICS + "CREATE TABLE messages(a);", "no data, timestamp, topic_id"),
        (
            TOPICS + "CREATE VIEW messages AS " + COUNT.format("", "x AS topic_id"),
            "messages is not a plain table",
        ),
        (
            TOPICS
            + "CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, "
            + "data BLOB AS (zeroblob(1000000000)) VIRTUAL);",
            "messages is not a plain table",
        ),
        (
            TOPICS + "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data);",
            "messages is not a plain table",
        ),
    ],
)
def test_a_database_that_is_no_bag_is_refused(tmp_path, script, words):
    with pytest.raises(BagError, match=words) as caught:
        BagReader(database(tmp_path / "bag.db3", script))
    assert str(caught.value).count("cannot be read") == 1


def test_rows_that_are_no_messages_are_left_out_and_counted(tmp_path):
    script = PLAIN + "".join(
        [
            insert("1", "5", "x'0001'"),
            insert("1", "'x'", "x'00'"),
            insert("1", "6", "NULL"),
            insert("1", "-5", "x'00'"),
            insert("1", "1.5", "x'00'"),
            insert("1", "7", "'text'"),
            insert("1", "8", "zeroblob(17000000)"),
            insert("2", "9", "x'00'"),
            insert("1", "9223372036854775807", "x'02'"),
        ]
    )
    found, reader = read(database(tmp_path / "bag.db3", script))
    assert found == [(5, b"\x00\x01"), (2**63 - 1, b"\x02")]
    assert reader.problems == [
        "bag.db3: 1 messages of unknown topics were left out",
        "bag.db3: 6 rows that hold no message, or a huge one, were left out",
    ]


def test_text_of_the_file_in_the_message_of_sqlite_does_no_harm(tmp_path):
    path = database(tmp_path / "bag.db3", PLAIN)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"CREATE TABLE messages", b"CREA\xb5E TABLE messages"))
    with pytest.raises(BagError, match="cannot be read"):
        BagReader(path)


def test_a_huge_blob_is_not_loaded(tmp_path):
    path = database(
        tmp_path / "bag.db3", PLAIN + insert("1", "5", "x'00'") + insert("1", "6", "zeroblob(3e8)")
    )
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found, reader = read(path)
    assert len(found) <= 1
    assert reader.problems
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 1024


def test_odd_names_and_many_topics_do_no_harm(tmp_path):
    many = "INSERT INTO topics(name, type, serialization_format) " + COUNT.format(
        "LIMIT 20000", "'/t' || x, 'a/msg/B', 'cdr'"
    )
    odd = "INSERT INTO topics VALUES(-1, NULL, 3, x'ff'), (-2, CAST(x'ff' AS TEXT), 't', 'cdr');"
    found, reader = read(database(tmp_path / "ba?g#%.db3", PLAIN + odd + many))
    assert found == []
    assert reader.problems == ["ba?g#%.db3: only the first 10000 topics were read"]


def test_a_recording_that_was_not_closed_says_so(tmp_path):
    path = database(tmp_path / "bag.db3", PLAIN + insert("1", "5", "x'00'"))
    path.with_name("bag.db3-wal").write_bytes(b"x")
    assert read(path)[1].problems == [
        "bag.db3: bag.db3-wal was not read: the recording was not closed"
    ]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag.db3", "bag.db3-wal"]


def test_a_corrupted_database_gives_whole_rows_or_says_what_is_wrong(tmp_path):
    """sqlite has no checksums: a flip inside a message cannot be seen, one outside must be."""
    rows = [bytes([i % 251]) * 60 for i in range(1500)]
    script = PLAIN + "".join(insert("1", str(i), f"x'{row.hex()}'") for i, row in enumerate(rows))
    data = database(tmp_path / "whole.db3", script).read_bytes()
    whole = read(tmp_path / "whole.db3")[0]
    assert len(whole) == 1500
    path = tmp_path / "bag.db3"
    random = np.random.default_rng(3)
    said = 0
    for trial in range(150):
        damaged = bytearray(data)
        if trial % 3 == 0:
            del damaged[int(random.integers(len(data))) :]
        for place in random.integers(0, max(len(damaged), 1), 1 + trial % 5):
            if damaged:
                damaged[place] ^= 1 << int(random.integers(8))
        path.write_bytes(damaged)
        try:
            found, reader = read(path)
        except BagError:
            said += 1
            continue
        said += bool(reader.problems)
        assert reader.problems or len(found) == 1500
        assert reader.unverified_count == len(found)
    assert said > 75


def packed_bag(path, mode, plugin, rows, kind):
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/heat", kind, typestore=typestore())
        for i, row in enumerate(rows):
            writer.write(connection, i, row)
    return path


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_message_that_unpacks_to_too_much_is_left_out(tmp_path, bags, plugin):
    good = bags.temperature_rows(np.array([1]))[0].tobytes()
    rows = [good, bytes(200 * 2**20), good]
    path = packed_bag(tmp_path / "bag", CompressionMode.MESSAGE, plugin, rows, bags.TEMPERATURE)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    found, reader = read(path)
    assert time.process_time() - begin < 20
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 130 * 1024
    assert [row for _, row in found] == [good, good]
    assert reader.problems == ["messages of /heat that cannot be unpacked were left out"]


def test_a_file_that_unpacks_to_too_much_is_refused(tmp_path, bags):
    good = [bags.temperature_rows(np.array([1]))[0].tobytes()]
    args = (CompressionMode.FILE, StoragePlugin.SQLITE3, good, bags.TEMPERATURE)
    path = packed_bag(tmp_path / "bag", *args)
    (file,) = path.glob("*.zstd")
    with file.open("wb") as out, zstandard.ZstdCompressor().stream_writer(out) as packer:
        packer.write(b"SQLite format 3\0")
        for _ in range(200):
            packer.write(bytes(2**20))
    with refused(BagError, found="67108864", expected="1000"):
        BagReader(path)
    file.write_bytes(b"no zstd at all")
    with refused(BagError, found=file.name, expected="zstd"):
        BagReader(path)


def test_a_bag_that_is_a_pipe_is_not_waited_for(tmp_path):
    for name in ("bag.mcap", "bag.db3"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(BagError, match="cannot be read"):
            BagReader(tmp_path / name)


def test_log_times_that_jump_back_and_forth_do_not_sort_the_messages(tmp_path):
    second = 10**9
    times = [row * second // 10 + (row % 2) * 60 * second for row in range(10)]
    rows = [insert("1", str(time), f"x'{row:02x}'") for row, time in enumerate(times)]
    found, reader = read(database(tmp_path / "bag.db3", PLAIN + "".join(rows)))
    assert [data for _, data in found] == [bytes([row]) for row in range(10)]
    assert any("log times" in problem for problem in reader.problems)


def test_one_late_log_time_still_sorts_the_messages(tmp_path):
    rows = insert("1", "20", "x'02'") + insert("1", "10", "x'01'") + insert("1", "30", "x'03'")
    found, reader = read(database(tmp_path / "bag.db3", PLAIN + rows))
    assert [data for _, data in found] == [b"\x01", b"\x02", b"\x03"]
    assert reader.problems == []
