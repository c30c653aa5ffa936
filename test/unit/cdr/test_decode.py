"""Decoder: chosen fields of serialized messages as columns, never more than the bytes say."""

import numpy as np
import pytest

from refusals import refused
from robot_energy.bag.cdr import Decoder, RawBatch, stamp_ns
from robot_energy.bag.cdr.decode import MAX_LAYOUTS
from robot_energy.foundation.errors import MessageTypeError

JOINT_STATE = "sensor_msgs/msg/JointState"
FIELDS = ["header.stamp.sec", "header.stamp.nanosec", "name", "position", "velocity", "effort"]


def test_columns_of_one_publisher_come_in_one_run(messages):
    batch = messages.batch([messages.joint_state(i) for i in range(50)])
    decoded = Decoder(JOINT_STATE, FIELDS).decode(batch)
    (run,) = decoded.runs
    assert run.rows.tolist() == list(range(50))
    assert run.names("name") == ("a", "bb", "ccc")
    np.testing.assert_array_equal(run.array("velocity")[7], [710, 711, 712])
    assert run.array("effort").shape == (50, 3)
    assert stamp_ns(run).tolist() == [i * 10**6 for i in range(50)]
    assert decoded.malformed.size == 0


def test_columns_have_own_memory_and_native_order(messages):
    rows = [messages.joint_state(i, little_endian=False) for i in range(3)]
    (run,) = Decoder(JOINT_STATE, FIELDS).decode(messages.batch(rows)).runs
    position = run.array("position")
    assert position.dtype == np.dtype(float)
    assert position.dtype.isnative
    assert position.flags.f_contiguous  # number by number
    assert position.base is None
    assert position.flags.writeable
    np.testing.assert_array_equal(position[2], [200, 201, 202])


def test_layouts_are_kept_apart_and_rows_stay_in_order(messages):
    rows = [
        messages.joint_state(i, names=("a", "b") if i % 3 else ("b", "a"), little_endian=i % 2 == 0)
        for i in range(24)
    ]
    runs = Decoder(JOINT_STATE, FIELDS).decode(messages.batch(rows)).runs
    assert len(runs) == 4
    assert sorted(np.concatenate([run.rows for run in runs])) == list(range(24))
    assert [int(run.rows[0]) for run in runs] == [0, 1, 2, 3]
    for run in runs:
        assert (np.diff(run.rows) > 0).all()
        for row, position in zip(run.rows, run.array("position"), strict=True):
            assert position[0] == 100 * row
            assert run.columns["name"] == (("a", "b") if row % 3 else ("b", "a"))


def test_runs_come_in_the_order_of_their_first_row(messages):
    """Whatever the decoder has met before."""
    decoder = Decoder(JOINT_STATE, FIELDS)
    rows = [messages.joint_state(i, names=(name,)) for i, name in enumerate("abcab")]
    for order in ([0, 1, 2], [2, 1, 0], [1, 0, 2]):
        decoder.decode(messages.batch([rows[i] for i in order]))
        runs = decoder.decode(messages.batch(rows)).runs
        assert [run.rows.tolist() for run in runs] == [[0, 3], [1, 4], [2]]


def test_a_name_of_equal_length_is_not_taken_for_another(messages):
    """Names decide which joint a number belongs to: one differing byte is another layout."""
    decoder = Decoder(JOINT_STATE, FIELDS)
    rows = [messages.joint_state(0, ("left", "arm1")), messages.joint_state(1, ("left", "arm2"))]
    assert [run.columns["name"] for run in decoder.decode(messages.batch(rows)).runs] == [
        ("left", "arm1"),
        ("left", "arm2"),
    ]


def test_missing_arrays_are_empty_columns(messages):
    rows = [messages.joint_state(i, sizes=(3, 0, 0)) for i in range(2)]
    (run,) = Decoder(JOINT_STATE, FIELDS).decode(messages.batch(rows)).runs
    assert run.array("position").shape == (2, 3)
    assert run.array("velocity").shape == (2, 0)


def test_bytes_of_padding_are_not_compared(messages):
    good = messages.joint_state(1, names=("a", "bb"))
    pad = next(i for i in range(8, len(good)) if _same_after_change(messages, good, i))
    odd = bytearray(good)
    odd[pad] = 0xAA
    odd[2:4] = b"\x07\x09"  # options of the encapsulation header
    (run,) = Decoder(JOINT_STATE, FIELDS).decode(messages.batch([good, bytes(odd), good])).runs
    assert len(run.rows) == 3


def _same_after_change(messages, data, i):
    changed = data[:i] + b"\xaa" + data[i + 1 :]
    try:
        message = messages.store.deserialize_cdr(changed, JOINT_STATE)
    except Exception:
        return False
    return messages.serialize(message) == data


@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("extra", range(6))
def test_up_to_three_bytes_may_follow_the_payload(messages, extra, warm):
    rows = [messages.joint_state(0) + bytes(extra), messages.joint_state(1)]
    decoder = Decoder(JOINT_STATE, FIELDS)
    if warm:
        decoder.decode(messages.batch(rows[1:]))
    decoded = decoder.decode(messages.batch(rows))
    assert decoded.malformed.tolist() == ([] if extra <= 3 else [0])


@pytest.mark.parametrize("warm", [False, True])
def test_a_message_cut_anywhere_is_malformed(messages, warm):
    whole = messages.joint_state(3)
    decoder = Decoder(JOINT_STATE, FIELDS)
    if warm:
        decoder.decode(messages.batch([whole]))
    cuts = [whole[:i] for i in range(len(whole))]
    decoded = decoder.decode(messages.batch([*cuts, whole]))
    assert decoded.malformed.tolist() == list(range(len(cuts)))
    assert [run.rows.tolist() for run in decoded.runs] == [[len(cuts)]]


@pytest.mark.parametrize(
    "head", [b"\x00\x02", b"\x00\x03", b"\x00\x07", b"\x00\x0b", b"\x01\x01", b"\xff\xff"]
)
def test_another_encapsulation_than_cdr_is_malformed(messages, head):
    row = head + messages.joint_state(0)[2:]
    assert Decoder(JOINT_STATE, FIELDS).decode(messages.batch([row])).malformed.tolist() == [0]


def test_an_absurd_length_is_malformed_without_being_followed(messages):
    row = bytearray(messages.joint_state(0, frame=""))
    row[12:16] = b"\xff\xff\xff\xff"
    assert Decoder(JOINT_STATE, FIELDS).decode(messages.batch([bytes(row)])).malformed.size == 1
    row = b"\x00\x01\x00\x00" + bytes(8) + b"\x01\x00\x00\x00\x00" + bytes(3) + b"\xff" * 4
    assert Decoder(JOINT_STATE, FIELDS).decode(messages.batch([row])).malformed.size == 1


@pytest.mark.parametrize("bad", [b"\xff\xfea", b"ab\xc3"])
def test_a_string_not_in_utf8_or_not_closed_is_malformed(messages, bad):
    good = messages.joint_state(0, names=("xyz",))
    rows = [good.replace(b"xyz", bad), good.replace(b"xyz\x00", b"xyzz"), good]
    assert Decoder(JOINT_STATE, FIELDS).decode(messages.batch(rows)).malformed.tolist() == [0, 1]


def test_rows_outside_the_buffer_are_malformed(messages):
    good = np.frombuffer(messages.joint_state(0), np.uint8)
    n, big = len(good), 2**63 - 1
    offset = np.array([0, -1, 1, n, big, 0, 0, -(2**63)])
    length = np.array([n, n, n, n, n, big, -5, n])
    batch = RawBatch("/t", JOINT_STATE, np.arange(8), good, offset, length)
    decoded = Decoder(JOINT_STATE, FIELDS).decode(batch)
    assert decoded.malformed.tolist() == list(range(1, 8))


def test_arrays_of_messages_add_one_axis(messages):
    decoder = Decoder(
        "diagnostic_msgs/msg/DiagnosticArray",
        ["status.level", "status.name", "status.values.key", "status.values.value"],
    )
    make = messages.make
    value = [make("diagnostic_msgs/msg/KeyValue", key, "1.5") for key in ("t1", "t2", "t3")]
    status = [
        make("diagnostic_msgs/msg/DiagnosticStatus", level, f"n{level}", "m", "h", value[level:])
        for level in (0, 2)
    ]
    array = make("diagnostic_msgs/msg/DiagnosticArray", messages.header(), status)
    rows = [messages.serialize(array)] * 2
    (run,) = decoder.decode(messages.batch(rows, array.__msgtype__)).runs
    assert run.array("status.level").tolist() == [[0, 2], [0, 2]]
    assert run.columns["status.name"] == ("n0", "n2")
    assert run.columns["status.values.key"] == (("t1", "t2", "t3"), ("t3",))


def test_arrays_of_stamps_are_decoded_to_ns(messages):
    msgtype = "ros2_energy_msgs/msg/JointFriction"
    path = "temperature_stamp"
    decoder = Decoder(msgtype, [f"{path}.sec", f"{path}.nanosec", "temperature_source"])
    make = messages.make
    stamps = [make("builtin_interfaces/msg/Time", i, 7) for i in range(3)]
    defaults = {
        "header": messages.header(),
        "joint_names": ["a", "b", "c"],
        "temperature_stamp": stamps,
        "temperature_source": np.array([0, 1, 2], np.uint8),
        "model_id": "m",
    }
    fields = [name for name, _ in messages.store.fielddefs[msgtype][1]]
    kinds = messages.store.fielddefs[msgtype][1]
    arrays = {name for name, (kind, _) in kinds if kind.name == "SEQUENCE"}
    values = [defaults.get(name, np.zeros(3) if name in arrays else 0) for name in fields]
    row = messages.serialize(make(msgtype, *values))
    (run,) = decoder.decode(messages.batch([row, row], msgtype)).runs
    assert stamp_ns(run, path).tolist() == [[7, 10**9 + 7, 2 * 10**9 + 7]] * 2
    assert run.array("temperature_source").tolist() == [[0, 1, 2]] * 2


def test_strings_that_always_change_cost_a_walk_but_stay_right(messages):
    rows = [messages.joint_state(i, names=(f"joint_{i:04d}",)) for i in range(300)]
    decoder = Decoder(JOINT_STATE, FIELDS)
    runs = decoder.decode(messages.batch(rows)).runs
    assert [run.columns["name"] for run in runs] == [(f"joint_{i:04d}",) for i in range(300)]
    assert [float(run.array("position")[0, 0]) for run in runs] == [100.0 * i for i in range(300)]
    assert len(decoder._layouts) <= MAX_LAYOUTS


def test_what_a_decoder_remembers_is_bounded(messages):
    decoder = Decoder(JOINT_STATE, FIELDS)
    for i in range(3 * MAX_LAYOUTS):
        decoder.decode(messages.batch([messages.joint_state(i, names=(f"j{i}",))]))
    assert len(decoder._layouts) == MAX_LAYOUTS


def test_an_empty_batch_has_no_runs(messages):
    decoded = Decoder(JOINT_STATE, FIELDS).decode(messages.batch([]))
    assert decoded.runs == []
    assert decoded.malformed.tolist() == []


@pytest.mark.parametrize(
    ("msgtype", "path", "text"),
    [
        ("x/msg/Y", "a", "message type x/msg/Y is unknown"),
        (JOINT_STATE, "torque", "no field 'torque'; expected one of header, name, position"),
        (JOINT_STATE, "header.stamp.msec", "header.stamp has no field 'msec'"),
        (JOINT_STATE, "header.stamp", "a group of fields; expected one of header.stamp.sec"),
        (JOINT_STATE, "position.x", "no field 'x'"),
    ],
)
def test_a_wrong_path_is_refused_with_what_there_is(msgtype, path, text):
    with pytest.raises(MessageTypeError, match=text):
        Decoder(msgtype, [path])


def test_a_batch_of_another_type_is_refused(messages):
    batch = messages.batch([messages.joint_state(0)], "std_msgs/msg/Float64")
    with refused(MessageTypeError, found="/t", expected=JOINT_STATE):
        Decoder(JOINT_STATE, FIELDS).decode(batch)


def test_a_column_of_the_other_kind_is_refused(messages):
    batch = messages.batch([messages.joint_state(0)])
    (run,) = Decoder(JOINT_STATE, [*FIELDS, "header.frame_id"]).decode(batch).runs
    assert run.columns["header.frame_id"] == "base"
    with pytest.raises(MessageTypeError):
        run.array("name")
    with pytest.raises(MessageTypeError):
        run.names("position")
    with pytest.raises(MessageTypeError):
        run.names("header.frame_id")
