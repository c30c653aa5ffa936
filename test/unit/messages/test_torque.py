"""Torque messages: what arrives is what was written, whatever happens to the writer."""

from __future__ import annotations

import numpy as np
import pytest

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.messages.torque import TorqueReader, TorqueWriter
from robot_energy.timeline.blocks import Quality, TorqueBlock

NAMES = ("a", "b")
PERIOD_NS = 4_000_000


def torques(first: int, count: int, segment: int = 0) -> TorqueBlock:
    stamp = 10**18 + np.arange(first, first + count, dtype=np.int64) * PERIOD_NS
    values = np.arange(2.0 * count).reshape(count, 2)
    return TorqueBlock(
        stamp_ns=stamp,
        segment=np.full(count, segment, dtype=np.int64),
        quality=np.zeros(count, dtype=np.uint32),
        joint_position=values,
        joint_velocity=values + 0.1,
        joint_acceleration=values + 0.2,
        joint_torque_rigid=values + 0.3,
        motor_velocity=values + 0.4,
        motor_torque_rigid=values + 0.5,
        motor_torque_measured=np.where(values == 3.0, np.nan, values + 0.6),
        payload_mass=values[:, 0] + 0.7,
    )


def batch(block: TorqueBlock) -> RawBatch:
    rows = TorqueWriter(NAMES, "id").encode(block)
    return RawBatch.from_messages(
        "/t", "ros2_energy_msgs/msg/JointTorque", block.stamp_ns, [row.tobytes() for row in rows]
    )


def read(reader: TorqueReader, block: TorqueBlock) -> TorqueBlock:
    found = reader.decode(batch(block))
    assert found is not None
    return found


def test_blocks_survive_the_wire_bit_by_bit():
    sent = torques(0, 50)
    found = read(TorqueReader(NAMES, "id"), sent)
    for name, values in sent.__dict__.items():
        np.testing.assert_array_equal(getattr(found, name), values, err_msg=name)


def test_restarted_writer_begins_a_new_segment_although_it_counts_from_zero():
    reader = TorqueReader(NAMES, "id")
    before = read(reader, torques(0, 50))
    after = read(reader, torques(300, 50))  # 1 s later, segment 0 again
    assert before.segment[-1] == 0
    assert (after.segment == 1).all()
    assert list(np.flatnonzero(after.quality & Quality.AFTER_GAP)) == [0]
    assert reader.order.gaps == 1


@pytest.mark.parametrize(("max_gap", "segments"), [(0.0, 2), (0.9, 2), (1.5, 1)])
def test_as_much_is_bridged_as_the_torque_monitor_bridges(max_gap, segments):
    reader = TorqueReader(NAMES, "id", max_gap)
    blocks = [read(reader, torques(0, 50)), read(reader, torques(300, 50))]  # 1 s later
    assert len({int(block.segment[-1]) for block in blocks}) == segments
    assert reader.order.gaps == segments - 1


def test_messages_lost_on_the_way_are_a_gap():
    reader = TorqueReader(NAMES, "id")
    block = torques(0, 200)
    kept = block[np.concatenate([np.arange(50), np.arange(150, 200)])]
    found = read(reader, kept)
    assert list(found.segment) == [0] * 50 + [1] * 50


def test_the_writer_s_own_segments_are_kept_and_counted_once():
    reader = TorqueReader(NAMES, "id")
    first, second = torques(0, 50, segment=3), torques(50, 50, segment=4)
    third = torques(400, 50, segment=5)  # determined by the writer and seen in the stamps
    found = read(reader, TorqueBlock.concatenate([first, second, third]))
    assert list(found.segment) == [0] * 50 + [1] * 50 + [2] * 50


def test_cut_changes_nothing():
    whole = TorqueBlock.concatenate(
        [torques(0, 60), torques(60, 40, segment=1), torques(300, 40), torques(340, 20)]
    )
    once = read(TorqueReader(NAMES, "id"), whole)
    reader = TorqueReader(NAMES, "id")
    parts = [read(reader, whole[slice(start, start + 7)]) for start in range(0, len(whole), 7)]
    pieces = TorqueBlock.concatenate(parts)
    assert np.array_equal(once.segment, pieces.segment)
    assert np.array_equal(once.quality, pieces.quality)


def test_two_writers_do_not_count_twice():
    reader = TorqueReader(NAMES, "id")
    doubled = torques(0, 50)[np.repeat(np.arange(50), 2)]
    found = read(reader, doubled)
    assert len(found) == 50
    assert reader.rejections.rejected == {"duplicate_stamp": 50}
    assert reader.rejections.balanced


def test_torque_of_another_model_is_refused():
    reader = TorqueReader(NAMES, "other")
    assert reader.decode(batch(torques(0, 5))) is None
    assert reader.rejections.rejected == {"other_model": 5}
    assert reader.rejections.balanced
