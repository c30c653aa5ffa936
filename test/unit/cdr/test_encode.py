"""Encoder: columns to complete serialized messages."""

import numpy as np
import pytest

from refusals import refused
from robot_energy.bag.cdr import Decoder, Encoder, stamp_columns
from robot_energy.bag.cdr.schema import compile_schema, leaf_paths
from robot_energy.foundation.errors import MessageTypeError, ShapeError

JOINT_STATE = "sensor_msgs/msg/JointState"
NAMES = ("a", "bb", "ccc")


def joint_state_encoder():
    constants = {"header.frame_id": "base", "name": NAMES}
    return Encoder(JOINT_STATE, constants, {"position": 3, "velocity": 3, "effort": 3})


def joint_state_columns(n):
    base = np.arange(3.0) + 100 * np.arange(n)[:, None]
    stamps = stamp_columns(np.arange(n) * 10**6)
    return {**stamps, "position": base, "velocity": base + 10, "effort": base + 20}


def test_rows_are_the_bytes_rosbags_writes(messages):
    rows = joint_state_encoder().encode(joint_state_columns(40), 40)
    assert rows.dtype == np.uint8
    assert [row.tobytes() for row in rows] == [messages.joint_state(i) for i in range(40)]


def test_no_rows_can_be_encoded():
    encoder = joint_state_encoder()
    assert encoder.encode(joint_state_columns(0), 0).shape == (0, encoder.size)


def test_one_number_serves_all_rows_and_nan_stays_nan():
    columns = joint_state_columns(4) | {"effort": np.nan, "header.stamp.sec": 5}
    rows = joint_state_encoder().encode(columns, 4)
    batch = _batch(rows, JOINT_STATE)
    (run,) = Decoder(JOINT_STATE, ["effort", "header.stamp.sec"]).decode(batch).runs
    assert np.isnan(run.array("effort")).all()
    assert run.array("header.stamp.sec").tolist() == [5] * 4


def _batch(rows, msgtype):
    from robot_energy.bag.cdr import RawBatch

    return RawBatch.from_messages("/t", msgtype, range(len(rows)), [r.tobytes() for r in rows])


def test_arrays_of_messages_take_one_axis_more():
    """Names of unequal length put the numbers at irregular distances."""
    msgtype = "ros2_energy_msgs/msg/PowerState"
    fixed = {"phase": 2, "meter_location": 1, "band": 1}
    encoder = Encoder(
        msgtype, {"model_id": "kr16", "joints.name": NAMES, **fixed}, {"auxiliary": 0}
    )
    assert "joints.shaft_power" in encoder.fields
    assert "phase" not in encoder.fields
    axes = {"joints": (3,), "auxiliary": (0,)}
    shape = {f: (5, *axes.get(f.split(".")[0], ())) for f in encoder.fields}
    columns = {}
    for k, (field, size) in enumerate(shape.items()):
        values = np.arange(np.prod(size)).reshape(size) + 100 * k
        whole = "stamp" in field or field == "quality" or not values.size
        columns[field] = values if whole else values / 7
    rows = encoder.encode(columns, 5)
    paths = [p for p in leaf_paths(compile_schema(msgtype, _store())) if p != "header.frame_id"]
    (run,) = Decoder(msgtype, paths).decode(_batch(rows, msgtype)).runs
    for field, values in columns.items():
        np.testing.assert_array_equal(run.array(field), values)
    assert run.columns["joints.name"] == NAMES
    assert run.columns["model_id"] == "kr16"
    assert run.array("phase").tolist() == [2] * 5
    message = _store().deserialize_cdr(rows[3].tobytes(), msgtype)
    assert message.joints[2].shaft_power == columns["joints.shaft_power"][3, 2]


def _store():
    from robot_energy.bag.cdr import typestore

    return typestore()


def test_constant_numbers_may_be_arrays():
    msgtype = "sensor_msgs/msg/JointState"
    constants = {"name": ("a", "b"), "position": (1.0, 2.0)}
    encoder = Encoder(msgtype, constants, {"velocity": 0, "effort": 0})
    columns = dict.fromkeys(encoder.fields, 0) | {
        "velocity": np.empty((2, 0)),
        "effort": np.empty((2, 0)),
    }
    rows = encoder.encode(columns, 2)
    assert _store().deserialize_cdr(rows[1].tobytes(), msgtype).position.tolist() == [1.0, 2.0]


def test_a_missing_or_unknown_column_is_refused():
    columns = joint_state_columns(2)
    velocity = columns.pop("velocity")
    with refused(MessageTypeError, found="lack ['velocity']"):
        joint_state_encoder().encode(columns, 2)
    with refused(MessageTypeError, found="unknown ['speed']"):
        joint_state_encoder().encode({**columns, "velocity": velocity, "speed": velocity}, 2)


@pytest.mark.parametrize("shape", [(2, 4), (3, 3), (2,), (3,), (1, 3), (2, 3, 1)])
def test_a_column_of_another_shape_is_refused(shape):
    with refused(ShapeError, found="velocity", expected="(2, 3)"):
        joint_state_encoder().encode(joint_state_columns(2) | {"velocity": np.zeros(shape)}, 2)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.5, "got 1.5; expected what fits int32"),
        (np.nan, "got nan; expected what fits int32"),
        (np.array([0, 2**31]), "got 2147483648; expected what fits int32"),
    ],
)
def test_values_that_do_not_fit_are_refused(value, text):
    with pytest.raises(MessageTypeError, match=text):
        joint_state_encoder().encode(joint_state_columns(2) | {"header.stamp.sec": value}, 2)


def test_a_sequence_without_length_is_refused():
    with refused(ShapeError, found=("length", "velocity"), expected="length"):
        Encoder(JOINT_STATE, {"name": NAMES}, {"position": 3, "effort": 3})


def test_lengths_that_contradict_are_refused():
    with refused(ShapeError, found=("name", "[2, 3]")):
        Encoder(JOINT_STATE, {"name": NAMES}, {"name": 2})


@pytest.mark.parametrize(
    ("constants", "text"),
    [
        ({"names": NAMES}, "no field 'names'"),
        ({"name": (1, 2)}, "name of .* got 1; expected a string"),
    ],
)
def test_an_unknown_or_unfit_constant_is_refused(constants, text):
    with pytest.raises(MessageTypeError, match=text):
        Encoder(JOINT_STATE, constants, {"position": 0, "velocity": 0, "effort": 0})


def test_stamps_split_exactly_and_refuse_what_does_not_fit():
    stamps = stamp_columns(np.array([1_700_000_000_123_456_789, -1]))
    assert stamps["header.stamp.sec"].tolist() == [1_700_000_000, -1]
    assert stamps["header.stamp.nanosec"].tolist() == [123_456_789, 999_999_999]
    with pytest.raises(ShapeError, match="2038"):
        stamp_columns(np.array([2**31 * 10**9]))
