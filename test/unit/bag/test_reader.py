"""BagReader: what whole bags hold, whoever wrote them."""

import tracemalloc

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from refusals import refused
from robot_energy.bag import BagReader
from robot_energy.bag.cdr import Decoder, typestore
from robot_energy.foundation.errors import BagError, MissingTopicError


def test_a_bag_says_what_it_holds(tmp_path, bags):
    bags.write_bag(tmp_path / "bag", n=1000)
    reader = BagReader(tmp_path / "bag")
    assert list(reader.topics) == ["/heat", "/joints"]
    assert reader.topics["/joints"].msgtype == bags.JOINT_STATE
    assert reader.topics["/joints"].message_count == 1000
    assert reader.message_count == 1010
    assert reader.start_ns == 10**15
    assert reader.end_ns == 10**15 + 999 * 10**6
    assert reader.problems == []


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_all_messages_come_back(tmp_path, bags, compression):
    file = bags.write_bag(tmp_path / "bag", n=9000, compression=compression)
    stamps = np.arange(9000) * 10**6 + 10**15
    for path in (tmp_path / "bag", file):
        found, reader = bags.read_all(path)
        joints = [item for item in found if item[0] == "/joints"]
        assert [item[1] for item in joints] == stamps.tolist()
        rows = np.concatenate(
            [bags.joint_rows(stamps[i : i + 100], i) for i in range(0, 9000, 100)]
        )
        assert [item[2] for item in joints] == [row.tobytes() for row in rows]
        assert len(found) == 9090
        assert reader.problems == []
        assert reader.unverified_count == 0


def foreign(bags, path, options, n=900):
    """Write n joint states and a temperature after each tenth; return what was written."""
    stamps = np.arange(n) * 10**6
    rows = [row.tobytes() for row in bags.joint_rows(stamps)]
    heat = [row.tobytes() for row in bags.temperature_rows(stamps)]
    expected = []
    with bags.foreign_mcap(path, **options) as writer:
        for i, stamp in enumerate(stamps.tolist()):
            writer.add_message(writer.joints, stamp, rows[i], stamp)
            expected.append(("/joints", stamp, rows[i]))
            if i % 10 == 0:
                writer.add_message(writer.heat, stamp, heat[i], stamp)
                expected.append(("/heat", stamp, heat[i]))
    return expected


@pytest.mark.parametrize(
    ("compression", "options"),
    [
        ("NONE", {}),
        ("LZ4", {}),
        ("ZSTD", {}),
        ("NONE", {"use_chunking": False}),
        ("NONE", {"use_chunking": False, "no_summary": True}),
        ("ZSTD", {"no_index": True}),
        ("ZSTD", {"no_summary": True}),
        ("ZSTD", {"no_summary": True, "no_index": True, "enable_crcs": False}),
        ("ZSTD", {"repeat_channels": False, "repeat_schemas": False}),
        ("LZ4", {"use_statistics": False}),
    ],
)
def test_files_of_other_writers_are_read(tmp_path, bags, compression, options):
    path = tmp_path / "other.mcap"
    options = dict(options)
    kinds = {"compression": bags.CompressionType[compression]}
    if options.pop("no_summary", False):
        kinds |= dict.fromkeys(
            ["repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets"], False
        )
        kinds["index_types"] = bags.IndexType.MESSAGE
    if options.pop("no_index", False):
        kinds["index_types"] = bags.IndexType.NONE
    expected = foreign(bags, path, kinds | options)
    found, reader = bags.read_all(path)
    assert sorted(found) == sorted(expected)
    assert reader.problems == []
    known = "use_statistics" not in options
    assert reader.topics["/joints"].message_count == (900 if known else None)
    assert reader.message_count == (990 if known else None)
    assert reader.start_ns == (0 if known else None)
    unverified = options.get("enable_crcs", True) is False or "use_chunking" in options
    assert reader.unverified_count == (990 if unverified else 0)


def test_loose_messages_come_in_bounded_parts(tmp_path, bags):
    path = tmp_path / "loose.mcap"
    stamps = np.arange(20_000)
    rows = [row.tobytes() for row in bags.temperature_rows(stamps)]
    with bags.foreign_mcap(path, use_chunking=False) as writer:
        for stamp, row in zip(stamps.tolist(), rows, strict=True):
            writer.add_message(writer.heat, stamp, row, stamp)
    sizes = [len(part["/heat"]) for part in BagReader(path).parts(["/heat"])]
    assert sum(sizes) == 20_000
    assert max(sizes) <= 8192


def test_equal_and_backward_times_are_sorted_inside_a_chunk_only(tmp_path, bags):
    path = tmp_path / "order.mcap"
    times = [5, 3, 3, 9, 3, 1]
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(6))]
    with bags.foreign_mcap(path, chunk_size=10**6) as writer:
        for time, row in zip(times, rows, strict=True):
            writer.add_message(writer.heat, time, row, time)
    found, _ = bags.read_all(path)
    assert [(time, rows.index(row)) for _, time, row in found] == [
        (1, 5),
        (3, 1),
        (3, 2),
        (3, 4),
        (5, 0),
        (9, 3),
    ]


def test_times_may_step_back_between_chunks(tmp_path, bags):
    path = tmp_path / "back.mcap"
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(4))]
    with bags.foreign_mcap(path, chunk_size=1) as writer:
        for time, row in zip([7, 2, 8, 1], rows, strict=True):
            writer.add_message(writer.heat, time, row, time)
    assert [time for _, time, _ in bags.read_all(path)[0]] == [7, 2, 8, 1]


def test_two_publishers_of_a_topic_are_one_stream(tmp_path, bags):
    path = tmp_path / "two.mcap"
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(6))]
    with bags.foreign_mcap(path, chunk_size=10**6) as writer:
        second = writer.register_channel("/heat", "cdr", 2)
        for i, row in enumerate(rows):
            writer.add_message(second if i % 2 else writer.heat, i // 4, row, i)
    found, reader = bags.read_all(path)
    assert [row for _, _, row in found] == rows
    assert reader.topics["/heat"].message_count == 6


def test_a_topic_with_two_types_gives_the_first_and_says_so(tmp_path, bags):
    path = tmp_path / "types.mcap"
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(2))]
    with bags.foreign_mcap(path) as writer:
        other = writer.register_channel("/heat", "cdr", 1)
        for i, row in enumerate(rows):
            writer.add_message(writer.heat, i, row, i)
            writer.add_message(other, i, b"other", i)
    found, reader = bags.read_all(path)
    assert [row for _, _, row in found] == rows
    assert len(reader.problems) == 1
    assert "/heat carries sensor_msgs/msg/Temperature" in reader.problems[0]


def test_topics_not_serialized_as_cdr_are_refused(tmp_path, bags):
    path = tmp_path / "json.mcap"
    with bags.foreign_mcap(path) as writer:
        channel = writer.register_channel("/text", "json", 2)
        writer.add_message(channel, 0, b"{}", 0)
    with refused(MissingTopicError, found=("/text", "json"), remedy="/heat"):
        BagReader(path).parts(["/text"])


@pytest.mark.parametrize(
    ("encoding", "remedy"), [("ros1", "rosbags-convert"), ("json", "`mcap`"), ("cbor", "as CSV")]
)
def test_each_foreign_encoding_has_its_remedy(tmp_path, bags, encoding, remedy):
    path = tmp_path / "foreign.mcap"
    with bags.foreign_mcap(path) as writer:
        schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        writer.add_message(writer.register_channel("/text", encoding, schema), 0, b"{}", 0)
    found = f"/text as sensor_msgs/msg/Imu ({encoding})"
    with refused(MissingTopicError, found=found, remedy=remedy):
        BagReader(path).require("/text", "sensor_msgs/msg/Imu")


def test_chunks_without_the_asked_topic_are_not_even_unpacked(tmp_path, bags):
    """Camera images next to the joint states must not cost their unpacking."""
    path = tmp_path / "mixed.mcap"
    rows = [row.tobytes() for row in bags.temperature_rows(np.arange(2))]
    with bags.foreign_mcap(path, chunk_size=1000) as writer:
        writer.add_message(writer.joints, 0, b"\x55" * 2000, 0)
        for i, row in enumerate(rows):
            writer.add_message(writer.heat, i, row, i)
    data = path.read_bytes()
    damaged = data.replace(b"\x55" * 2000, b"\x54" * 2000)
    assert damaged != data
    path.write_bytes(damaged)
    found, reader = bags.read_all(path, ["/heat"])
    assert len(found) == 2
    assert reader.problems == []
    found, reader = bags.read_all(path)
    assert len(found) == 2
    assert "checksum" in reader.problems[0]


def test_memory_does_not_grow_with_the_bag(tmp_path, bags):
    bags.write_bag(tmp_path / "bag", n=60_000, block=5000)
    assert (tmp_path / "bag" / "bag_0.mcap").stat().st_size > 10 * 2**20
    reader = BagReader(tmp_path / "bag")
    decoder = Decoder(bags.JOINT_STATE, ["position", "velocity"])
    tracemalloc.start()
    rows = 0
    for part in reader.parts(["/joints", "/heat"]):
        if "/joints" in part:
            rows += sum(len(run.rows) for run in decoder.decode(part["/joints"]).runs)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert rows == 60_000
    assert peak < 8 * 2**20


def test_an_empty_bag_is_a_bag(tmp_path, bags):
    file = bags.write_bag(tmp_path / "bag", n=0)
    for path in (tmp_path / "bag", file):
        found, reader = bags.read_all(path)
        assert found == []
        assert reader.message_count == 0
        assert reader.start_ns is None
        assert list(reader.topics) == ["/heat", "/joints"]
        assert reader.problems == []


def test_several_files_of_a_folder_are_one_bag(tmp_path, bags):
    """Without metadata.yaml, in the order of their numbers: 2 before 10."""
    folder = tmp_path / "split"
    folder.mkdir()
    for number, times in [(2, [1, 2]), (10, [3, 4])]:
        rows = [row.tobytes() for row in bags.temperature_rows(np.array(times))]
        with bags.foreign_mcap(folder / f"split_{number}.mcap") as writer:
            for time, row in zip(times, rows, strict=True):
                writer.add_message(writer.heat, time, row, time)
    found, reader = bags.read_all(folder)
    assert [time for _, time, _ in found] == [1, 2, 3, 4]
    assert (reader.start_ns, reader.end_ns, reader.message_count) == (1, 4, 4)
    assert reader.topics["/heat"].message_count == 4


def test_a_file_that_the_metadata_lists_may_be_missing(tmp_path, bags):
    file = bags.write_bag(tmp_path / "bag", n=100)
    metadata = tmp_path / "bag" / "metadata.yaml"
    text = metadata.read_text()
    listed = f"    - {file.name}\n"
    assert listed in text
    metadata.write_text(text.replace(listed, listed + "    - bag_1.mcap\n"))
    found, reader = bags.read_all(tmp_path / "bag")
    assert len(found) == 101
    assert reader.problems == ["bag_1.mcap is in metadata.yaml but not in the folder"]


@pytest.mark.parametrize("text", ["", "a: [", "rosbag2_bagfile_information: {version: 9}", "\x00"])
def test_damaged_metadata_does_not_hide_the_files(tmp_path, bags, text):
    bags.write_bag(tmp_path / "bag", n=100)
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    found, reader = bags.read_all(tmp_path / "bag")
    assert len(found) == 101
    assert len(reader.problems) == 1
    assert "metadata.yaml" in reader.problems[0]


@pytest.mark.parametrize("mode", [None, CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_folders_written_by_rosbags_are_read(tmp_path, bags, plugin, mode):
    path = tmp_path / "bag"
    writer = Writer(path, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    stamps = np.arange(300) * 10**6
    rows = [row.tobytes() for row in bags.joint_rows(stamps)]
    with writer:
        connection = writer.add_connection("/joints", bags.JOINT_STATE, typestore=typestore())
        for stamp, row in zip(stamps.tolist(), rows, strict=True):
            writer.write(connection, stamp, row)
    found, reader = bags.read_all(path)
    assert [(time, row) for _, time, row in found] == list(zip(stamps.tolist(), rows, strict=True))
    assert (reader.start_ns, reader.end_ns, reader.message_count) == (0, 299 * 10**6, 300)
    assert reader.unverified_count == 300
    assert reader.problems == []
    if mode is None:
        (path / "metadata.yaml").unlink()
        assert bags.read_all(path)[0] == found


def test_a_large_database_comes_in_parts(tmp_path, bags):
    path = tmp_path / "bag"
    row = bags.temperature_rows(np.arange(1))[0].tobytes()
    with Writer(path, version=9) as writer:
        connection = writer.add_connection("/heat", bags.TEMPERATURE, typestore=typestore())
        for i in range(10_000):
            writer.write(connection, i, row)
    sizes = [len(part["/heat"]) for part in BagReader(path).parts(["/heat"])]
    assert sizes == [8192, 10_000 - 8192]


def test_what_is_no_bag_is_refused(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.mcap").write_text("Hello, world")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "bad.db3").write_bytes(b"SQLite format 3\x00" + bytes(100))
    for name, text in [
        ("none.mcap", "does not exist"),
        ("folder", "holds no bag"),
        ("text.mcap", "is a text that begins with 'Hello, w"),
        ("empty.mcap", "is empty"),
        ("bad.db3", "cannot be read"),
    ]:
        with pytest.raises(BagError, match=text):
            BagReader(tmp_path / name)


def test_a_required_topic_is_found_or_named_in_the_error(tmp_path, bags):
    bags.write_bag(tmp_path / "bag", n=10)
    reader = BagReader(tmp_path / "bag")
    assert reader.require("/heat", bags.TEMPERATURE).message_count == 1
    assert reader.require("/heat", [bags.JOINT_STATE, bags.TEMPERATURE]).message_count == 1
    with refused(MissingTopicError, found="/joint_states", remedy="/joints"):
        reader.require("/joint_states", bags.JOINT_STATE)
    with refused(MissingTopicError, found=("/heat", bags.TEMPERATURE)):
        reader.require("/heat", bags.JOINT_STATE)
    with refused(MissingTopicError, expected="std_msgs/msg/String"):
        reader.require("/heat", "std_msgs/msg/String")
    with refused(MissingTopicError, found="/power", expected="/heat, /joints"):
        reader.parts(["/joints", "/power"])


def test_types_that_only_the_bag_defines_can_be_decoded(tmp_path, bags):
    path = tmp_path / "own.mcap"
    data = b"\x00\x01\x00\x00" + np.array([2.5, -1]).tobytes()
    with bags.foreign_mcap(path) as writer:
        schema = writer.register_schema("my_msgs/Pair", "ros2msg", b"float64 a\nfloat64 b\n")
        channel = writer.register_channel("/pair", "cdr", schema)
        writer.add_message(channel, 0, data, 0)
    reader = BagReader(path)
    assert reader.topics["/pair"].msgtype == "my_msgs/msg/Pair"
    decoder = Decoder("my_msgs/msg/Pair", ["a", "b"], reader.typestore)
    (part,) = reader.parts(["/pair"])
    (run,) = decoder.decode(part["/pair"]).runs
    assert (run.array("a")[0], run.array("b")[0]) == (2.5, -1)
