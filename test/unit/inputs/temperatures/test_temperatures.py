import numpy as np

from robot_energy.bag.cdr.decode import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest

SECOND = 10**9
OWN = "ros2_energy_msgs/msg/MotorTemperatures"
STANDARD = "sensor_msgs/msg/Temperature"


def ingest_of(*topics, joints=("a", "b"), **settings):
    sources = {topic: TemperatureSource(topic=topic, **settings) for topic in topics}
    return TemperatureIngest(joints, sources)


def own(topic, stamps, values, names=("a", "b")):
    encoder = Encoder(OWN, {"joint_names": names}, {"temperature_degc": len(names)})
    stamp = np.rint(np.asarray(stamps) * SECOND).astype(np.int64)
    rows = encoder.encode(
        {**stamp_columns(stamp), "temperature_degc": np.asarray(values, dtype=float)}, len(stamp)
    )
    log = np.maximum.accumulate(stamp)
    return RawBatch.from_messages(topic, OWN, log, [row.tobytes() for row in rows])


def standard(topic, stamps, values, frame):
    encoder = Encoder(STANDARD, {"header.frame_id": frame, "variance": 0.0})
    stamp = np.rint(np.asarray(stamps) * SECOND).astype(np.int64)
    rows = encoder.encode({**stamp_columns(stamp), "temperature": np.asarray(values)}, len(stamp))
    log = np.maximum.accumulate(stamp)
    return RawBatch.from_messages(topic, STANDARD, log, [row.tobytes() for row in rows])


def test_joints_are_matched_by_name_and_unknown_ones_listed():
    ingest = ingest_of("/t")
    block = ingest.step([own("/t", [1.0], [[50.0, 30.0, 40.0]], ("x", "a", "b"))])
    np.testing.assert_array_equal(block.motor_temperature_degc, [[30.0, 40.0]])
    assert ingest.ignored_joints == {"x"}


def test_topics_of_one_joint_each_are_merged_by_stamp():
    ingest = ingest_of("/ta", "/tb", "/tx", type=STANDARD)
    block = ingest.step([
        standard("/ta", [1.0, 3.0], [30.0, 31.0], "a"),
        standard("/tb", [2.0, 4.0], [40.0, 41.0], "b"),
        standard("/tx", [2.0], [99.0], "gearbox"),
    ])  # fmt: skip
    np.testing.assert_array_equal(block.stamp_ns, np.array([1, 2, 3, 4]) * SECOND)
    np.testing.assert_array_equal(
        block.motor_temperature_degc,
        [[30, np.nan], [np.nan, 40], [31, np.nan], [np.nan, 41]],
    )
    assert ingest.rejections.rejected == {"unknown_joint": 1}
    assert ingest.rejections.balanced


def test_a_topic_that_says_no_joint_is_named():
    ingest = ingest_of("/ta", "/tb", type=STANDARD)
    ingest.step([standard("/ta", [1.0], [30.0], "a"), standard("/tb", [1.0], [40.0], "")])
    (doubt,) = ingest.doubts
    assert "/tb names no joint" in doubt
    assert ingest.ignored_joints == set()
    assert ingest.rejections.rejected == {"unknown_joint": 1}


def test_a_loop_keeps_the_order_of_arrival():
    ingest = ingest_of("/t")
    block = ingest.step([own("/t", [8.0, 9.0, 1.0, 2.0], np.arange(8.0).reshape(4, 2))])
    np.testing.assert_array_equal(block.stamp_ns, np.array([8, 9, 1, 2]) * SECOND)


def test_bad_messages_are_counted_by_reason():
    ingest = ingest_of("/t")
    batch = own("/t", [0.0, 1.0, 2.0], [[1.0, 2.0], [np.nan, np.nan], [3.0, np.nan]])
    block = ingest.step([batch])
    assert len(block) == 1
    assert ingest.rejections.rejected == {"zero_stamp": 1, "not_finite": 1}
    garbage = RawBatch.from_messages("/t", OWN, np.zeros(1, dtype=np.int64), [b"\x00\x01\x00"])
    assert ingest.step([garbage]) is None
    assert ingest.rejections.rejected["malformed"] == 1
    assert ingest.rejections.balanced


def test_messages_of_which_no_reading_is_usable_give_nothing():
    """Alone in their tick, so that no other reading hides them."""
    for batch in (own("/t", [1.0], [[np.nan, np.inf]]), own("/t", [0.0], [[30.0, 30.0]])):
        ingest = ingest_of("/t")
        assert ingest.step([batch]) is None
        assert (ingest.rejections.received, ingest.rejections.accepted) == (1, 0)
        assert ingest.rejections.balanced
