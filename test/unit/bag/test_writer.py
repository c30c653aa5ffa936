"""BagWriter: bags that other readers find whole."""

import io
import resource

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML

from refusals import refused
from robot_energy.bag import LATCHED_QOS, SENSOR_QOS, BagReader, BagWriter
from robot_energy.bag.cdr import typestore
from robot_energy.bag.mcap_writer import McapWriter, head
from robot_energy.foundation.errors import BagError, MessageTypeError, MissingTopicError, ShapeError


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_rosbags_reads_what_was_written(tmp_path, bags, compression):
    bags.write_bag(tmp_path / "bag", n=9000, compression=compression)
    expected, _ = bags.read_all(tmp_path / "bag")
    with Reader(tmp_path / "bag") as reader:
        found = [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
        assert reader.message_count == 9090
        assert reader.ros_distro == "jazzy"
        assert reader.start_time == 10**15
        assert reader.duration == 8999 * 10**6 + 1
        assert {c.topic: c.msgcount for c in reader.connections} == {"/joints": 9000, "/heat": 90}
        connection = next(c for c in reader.connections if c.topic == "/heat")
        assert connection.digest == typestore().hash_rihs01(bags.TEMPERATURE)
        assert "float64 temperature" in connection.msgdef.data
    assert sorted(found) == sorted(expected)
    assert [time for _, time, _ in found] == sorted(time for _, time, _ in found)


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_the_mcap_library_finds_summary_indexes_and_checksums_right(tmp_path, bags, compression):
    file = bags.write_bag(tmp_path / "bag", n=9000, compression=compression)
    expected, _ = bags.read_all(tmp_path / "bag")
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == 9090
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) >= 2
        assert summary.statistics.message_start_time == 10**15
        assert sorted(summary.statistics.channel_message_counts.values()) == [90, 9000]
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        assert sorted(found) == sorted(expected)
        channel = next(c for c in summary.channels.values() if c.topic == "/heat")
        assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
        assert [m.name for m in reader.iter_metadata()] == ["rosbag2"]
        stream.seek(0)
        assert sum(1 for _ in StreamReader(stream, validate_crcs=True).records) > 4


def test_the_metadata_is_what_ros2_bag_writes(tmp_path, bags):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/joints", bags.JOINT_STATE, SENSOR_QOS)
        bag.add_topic("/energy/joint_friction", "ros2_energy_msgs/msg/JointFriction", LATCHED_QOS)
        bag.write("/joints", [5, 25], bags.joint_rows(np.array([5, 25])))
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    info = YAML(typ="safe", pure=True).load(text)["rosbag2_bagfile_information"]
    topics = info.pop("topics_with_message_count")
    assert info == {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": 20},
        "starting_time": {"nanoseconds_since_epoch": 5},
        "message_count": 2,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["bag_0.mcap"],
        "files": [
            {
                "path": "bag_0.mcap",
                "starting_time": {"nanoseconds_since_epoch": 5},
                "duration": {"nanoseconds": 20},
                "message_count": 2,
            }
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    assert [topic["message_count"] for topic in topics] == [2, 0]
    forever = {"sec": 9223372036, "nsec": 854775807}
    assert topics[1]["topic_metadata"] == {
        "name": "/energy/joint_friction",
        "type": "ros2_energy_msgs/msg/JointFriction",
        "serialization_format": "cdr",
        "offered_qos_profiles": [
            {
                "history": "keep_last",
                "depth": 1,
                "reliability": "reliable",
                "durability": "transient_local",
                "deadline": forever,
                "lifespan": forever,
                "liveliness": "automatic",
                "liveliness_lease_duration": forever,
                "avoid_ros_namespace_conventions": False,
            }
        ],
        "type_description_hash": typestore().hash_rihs01("ros2_energy_msgs/msg/JointFriction"),
    }
    sensor = topics[0]["topic_metadata"]["offered_qos_profiles"][0]
    assert (sensor["reliability"], sensor["durability"]) == ("best_effort", "volatile")
    with Reader(tmp_path / "bag") as reader:
        assert [c.ext.offered_qos_profiles[0].durability.name for c in reader.connections] == [
            "VOLATILE",
            "TRANSIENT_LOCAL",
        ]


def test_equal_input_gives_equal_bytes(tmp_path, bags):
    files = [bags.write_bag(tmp_path / part / "bag", compression="zstd") for part in ("a", "b")]
    assert files[0].read_bytes() == files[1].read_bytes()
    texts = [(file.parent / "metadata.yaml").read_bytes() for file in files]
    assert texts[0] == texts[1]


def test_byte_strings_of_unequal_length_are_written(tmp_path, bags):
    rows = [b"\x00\x01\x00\x00" + bytes(size) for size in (8, 20, 3)]
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/heat", bags.TEMPERATURE)
        bag.write("/heat", [3, 2, 2], rows)
        bag.write("/heat", [], [])
    found, reader = bags.read_all(tmp_path / "bag")
    assert [(time, row) for _, time, row in found] == [(2, rows[1]), (2, rows[2]), (3, rows[0])]
    assert (reader.start_ns, reader.end_ns) == (2, 3)


def test_an_error_in_the_block_leaves_nothing(tmp_path, bags):
    def record():
        with BagWriter(tmp_path / "bag") as bag:
            bag.add_topic("/heat", bags.TEMPERATURE)
            bag.write("/heat", [1], bags.temperature_rows(np.array([1])))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_raises_and_leaves_nothing(tmp_path, bags):
    """A limit on the size of files stands for a full disk: the system refuses the write."""
    stamps = np.arange(5000)
    rows = bags.joint_rows(stamps)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    bag = BagWriter(tmp_path / "bag", "none")
    bag.add_topic("/joints", bags.JOINT_STATE)

    def fill():
        for i in range(20):
            bag.write("/joints", stamps + 5000 * i, rows)

    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5 * 2**20, limits[1]))
        with refused(BagError, found="bag_0.mcap", remedy="space"):
            fill()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with refused(BagError, expected="open"):
        bag.write("/joints", stamps, rows)
    bag.close()
    assert list(tmp_path.iterdir()) == []


def test_a_bag_is_not_overwritten_unless_asked(tmp_path, bags):
    bags.write_bag(tmp_path / "bag", n=10)
    with refused(BagError, expected="new folder", remedy="--overwrite"):
        BagWriter(tmp_path / "bag")
    with BagWriter(tmp_path / "bag", overwrite=True):
        pass
    assert BagReader(tmp_path / "bag").message_count == 0
    (tmp_path / "bag" / "thesis.tex").write_text("dear")
    with refused(BagError, found="thesis.tex"):
        BagWriter(tmp_path / "bag", overwrite=True)
    assert (tmp_path / "bag" / "thesis.tex").exists()
    assert (tmp_path / "bag" / "bag_0.mcap").exists()


def test_wrong_use_is_refused(tmp_path, bags):
    with refused(BagError, found="'rar'", expected="zstd"):
        BagWriter(tmp_path / "rar", "rar")
    (tmp_path / "file").write_text("")
    with refused(BagError, found="file/bag"):
        BagWriter(tmp_path / "file" / "bag")
    bag = BagWriter(tmp_path / "bag")
    rows = bags.temperature_rows(np.arange(2))
    with refused(MissingTopicError, found="/heat", expected="add_topic"):
        bag.write("/heat", [0, 1], rows)
    with refused(MessageTypeError, found="x/msg/Y"):
        bag.add_topic("/heat", "x/msg/Y")
    bag.add_topic("/heat", bags.TEMPERATURE)
    with refused(BagError, found="/heat", expected="once"):
        bag.add_topic("/heat", bags.TEMPERATURE)
    for times, messages in [([0], rows), ([0, -1], rows), ([0, 1], rows[0]), ([0, 1], rows * 1.0)]:
        with pytest.raises(ShapeError):
            bag.write("/heat", times, messages)
    bag.close()
    bag.close()
    with refused(BagError, expected="open"):
        bag.add_topic("/other", bags.TEMPERATURE)


def test_a_bag_path_may_end_with_a_dot_or_slash(tmp_path, bags, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with BagWriter("bag/"):
        pass
    assert (tmp_path / "bag" / "bag_0.mcap").exists()


def test_origin_is_noted_where_stock_tools_leave_it_alone(tmp_path):
    with BagWriter(tmp_path / "bag", origin='virtual rig: "simulated"') as bag:
        bag.add_topic("/a", "std_msgs/msg/Float64")
    assert BagReader(tmp_path / "bag").origin == 'virtual rig: "simulated"'
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 0
    with BagWriter(tmp_path / "plain") as bag:
        bag.add_topic("/a", "std_msgs/msg/Float64")
    assert BagReader(tmp_path / "plain").origin == ""


@pytest.mark.parametrize("size", [40, 4000])
def test_the_file_is_that_of_the_mcap_library_to_the_byte(size):
    generator, theirs, ours = np.random.default_rng(1), io.BytesIO(), io.BytesIO()
    expected = Writer(theirs, compression=CompressionType.NONE)
    expected.start(profile="ros2", library="a name")
    written = McapWriter(ours, False, "a name")
    schema = expected.register_schema("a/msg/B", "ros2msg", b"float64 x")
    assert written.schema("a/msg/B", "float64 x") == schema
    for topic in ("/one", "/two"):
        expected.register_channel(topic, "cdr", schema, {"key": "value"})
        written.channel(topic, schema, {"key": "value"})
    for count in (1, 300, 3000):
        channels, times = generator.integers(1, 3, count), generator.integers(0, 10**15, count)
        rows = [generator.bytes(length) for length in generator.integers(4, size, count).tolist()]
        records = list[bytes]()
        for channel, time, row in zip(channels.tolist(), times.tolist(), rows, strict=True):
            expected.add_message(channel, time, row, time)
            records.append(head(channel, time, row) + row)
        sizes = np.array([len(record) for record in records])
        written.messages(channels, times, sizes, memoryview(b"".join(records)))
    for writer, note in ((expected, expected.add_metadata), (written, written.metadata)):
        note("rosbag2", {"serialized_metadata": "text"})
        writer.finish()
    assert theirs.getvalue() == ours.getvalue()


def test_messages_of_several_topics_are_in_the_order_of_their_key(tmp_path, bags):
    times = np.arange(1, 6) * 10
    joints, heat = bags.joint_rows(times), np.zeros((2, 12), np.uint8)
    with BagWriter(tmp_path / "bag", "none") as bag:
        bag.add_topic("/joints", bags.JOINT_STATE)
        bag.add_topic("/heat", bags.TEMPERATURE)
        parts = [("/heat", times[[0, 3]], heat), ("/joints", times, joints)]
        bag.write_sorted(parts, [np.array([0, 1]), np.arange(5) // 3])
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        records = make_reader(file).iter_messages(log_time_order=False)
        found = [(channel.topic, message.log_time) for _, channel, message in records]
    assert found == [
        ("/heat", 10), ("/joints", 10), ("/joints", 20), ("/joints", 30),
        ("/heat", 40), ("/joints", 40), ("/joints", 50),
    ]  # fmt: skip
