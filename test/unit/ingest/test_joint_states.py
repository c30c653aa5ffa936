import numpy as np
import pytest

from robot_energy.blocks import Quality
from robot_energy.ingest import JointStateIngest
from robot_energy.wire.batch import RawBatch
from robot_energy.wire.layout import Encoder, stamp_columns

NAMES = ("a", "b")
SECOND = 10**9


def message(stamp_s, names=NAMES, position=(1.0, 2.0), velocity=(3.0, 4.0)):
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": tuple(names)},
        {"position": len(position), "velocity": len(velocity), "effort": 0},
    )
    columns = {
        **stamp_columns(np.array([round(stamp_s * SECOND)])),
        "position": np.array([position], dtype=float).reshape(1, -1),
        "velocity": np.array([velocity], dtype=float).reshape(1, -1),
        "effort": np.zeros((1, 0)),
    }
    return encoder.encode(columns, 1)[0].tobytes()


def take(ingest, messages):
    stamps = np.arange(len(messages), dtype=np.int64)
    block = ingest.step(
        RawBatch.from_messages("/joint_states", "sensor_msgs/msg/JointState", stamps, messages)
    )
    assert ingest.account.balanced
    return block


def test_joints_are_matched_by_name_in_every_message():
    ingest = JointStateIngest(NAMES)
    block = take(
        ingest,
        [
            message(1.0),
            message(1.1, ("b", "a"), (2.0, 1.0), (4.0, 3.0)),
            message(1.2, ("x", "b", "a"), (9.0, 2.0, 1.0), (9.0, 4.0, 3.0)),
        ],
    )
    np.testing.assert_array_equal(block.joint_position, [[1.0, 2.0]] * 3)
    np.testing.assert_array_equal(block.joint_velocity, [[3.0, 4.0]] * 3)
    assert ingest.ignored_joints == {"x"}


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ({"names": ("a",), "position": (1.0,), "velocity": (1.0,)}, "missing_joint"),
        ({"names": ("a", "b", "b"), "position": (1.0,) * 3, "velocity": ()}, "repeated_joint"),
        ({"position": (1.0, 2.0, 3.0)}, "wrong_length"),
        ({"velocity": (1.0,)}, "wrong_length"),
        ({"position": (1.0, np.nan)}, "not_finite"),
        ({"velocity": (1.0, np.inf)}, "not_finite"),
    ],
)
def test_bad_message_is_rejected_with_its_reason_and_its_neighbours_stay(bad, reason):
    ingest = JointStateIngest(NAMES)
    block = take(ingest, [message(1.0), message(1.1, **bad), message(1.2)])
    assert len(block) == 2
    assert ingest.account.rejected == {reason: 1}


def test_stamps_must_be_set_and_newer():
    ingest = JointStateIngest(NAMES)
    block = take(ingest, [message(t) for t in (0.0, 2.0, 2.0, 1.5, 2.1)])
    np.testing.assert_array_equal(block.stamp_ns, [2 * SECOND, 2_100_000_000])
    assert ingest.account.rejected == {"zero_stamp": 1, "duplicate_stamp": 1, "older_stamp": 1}


def test_missing_velocity_stays_nan_for_the_derivative():
    block = take(
        JointStateIngest(NAMES), [message(1.0, velocity=()), message(1.1, velocity=(np.nan, 4.0))]
    )
    np.testing.assert_array_equal(np.isnan(block.joint_velocity), [[True, True], [True, False]])


def test_gap_begins_a_segment_and_is_flagged():
    stamps = [*np.arange(1, 2, 0.01), *np.arange(2.2, 2.3, 0.01)]
    block = take(JointStateIngest(NAMES), [message(t) for t in stamps])
    np.testing.assert_array_equal(np.unique(block.segment), [0, 1])
    flagged = np.flatnonzero(block.quality & Quality.AFTER_GAP)
    np.testing.assert_array_equal(flagged, [100])


def test_slow_stream_is_not_all_gaps():
    # 4 Hz: 0.25 s is the period, not a gap; 2 s is one
    stamps = [*np.arange(1, 11, 0.25), 13.0, 13.25]
    block = take(JointStateIngest(NAMES), [message(t) for t in stamps])
    np.testing.assert_array_equal(block.segment, [0] * 40 + [1] * 2)


def test_bag_loop_begins_a_new_epoch():
    ingest = JointStateIngest(NAMES)
    loop = [message(t) for t in np.arange(1, 6, 0.5)]
    block = take(ingest, loop + loop + loop)
    assert ingest.account.accepted == 30
    assert ingest.order.jumps == 2
    assert block.segment[-1] == 2


def test_garbage_is_counted_as_malformed():
    ingest = JointStateIngest(NAMES)
    good = message(1.0)
    block = take(ingest, [good, b"", b"\x00\x01", good[:-9], b"\xff" * 80, message(2.0)])
    assert len(block) == 2
    assert ingest.account.rejected["malformed"] == 4


def with_effort(stamp_s, names, effort):
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": tuple(names)},
        {"position": len(names), "velocity": 0, "effort": len(effort)},
    )
    columns = {
        **stamp_columns(np.array([round(stamp_s * SECOND)])),
        "position": np.zeros((1, len(names))),
        "velocity": np.zeros((1, 0)),
        "effort": np.array([effort], dtype=float).reshape(1, -1),
    }
    return encoder.encode(columns, 1)[0].tobytes()


def test_effort_is_matched_by_name_and_its_absence_rejects_nothing():
    messages = [
        with_effort(1.0, ("a", "b"), (5.0, 6.0)),
        with_effort(1.1, ("b", "x", "a"), (6.0, 9.0, 5.0)),
        with_effort(1.2, ("a", "b"), ()),
        with_effort(1.3, ("a", "b"), (5.0,)),
        with_effort(1.4, ("a", "b"), (np.nan, np.inf)),
    ]
    nothing = [np.nan, np.nan]
    block = take(JointStateIngest(NAMES, effort=True), messages)
    expected = [[5.0, 6.0], [5.0, 6.0], nothing, nothing, [np.nan, np.inf]]
    np.testing.assert_array_equal(block.joint_effort, expected)
    unread = take(JointStateIngest(NAMES), messages)
    assert np.isnan(unread.joint_effort).all()
    assert len(unread) == len(block) == 5
