"""Two publishers of the same joint."""

import numpy as np
import pytest

from joint_messages import NAMES, SECOND, limits, message, take
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.joint_states.publisher_conflicts import PositionJumpDetector


def driver(seconds=4.0, rate=100.0, start=10.0):
    """A robot that moves within its limits."""
    stamps = start + np.arange(0, seconds, 1 / rate)
    return [
        (t, message(t, NAMES, (1 + 0.3 * np.sin(t), 0.5), (0.3 * np.cos(t), 0.0))) for t in stamps
    ]


def stand(begin, end, rate=100.0, offset=0.0, pose=(0.0, 0.1)):
    """What a second publisher sends next to it: a pose without velocity."""
    return [
        (t, message(t, NAMES, pose, ()))
        for t in np.round(np.arange(begin, end, 1 / rate), 9) + offset
    ]


def together(*parts):
    return [entry for _, entry in sorted((pair for part in parts for pair in part), key=at)]


def at(pair):
    return pair[0]


@pytest.mark.parametrize(
    ("offset", "rate", "reason"),
    [(0.0, 100.0, "conflicting_stamp"), (0.004, 100.0, None), (0.004, 10.0, None),
     (0.0, 50.0, "conflicting_stamp"), (0.001, 300.0, None)],
)  # fmt: skip
def test_a_pose_next_to_the_driver_is_refused_until_it_has_ended(offset, rate, reason):
    """From 11 to 12 s a second publisher sends a pose, at the same or at other stamps. None of
    its samples is used, the time until a second after it is a gap, the joints are named."""
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, together(driver(), stand(11.0, 12.0, rate, offset)))
    used = block.stamp_ns / SECOND
    assert (block.joint_position[:, 0] > 0.5).all()
    assert not ((used > 11.02 + 1 / rate) & (used < 12.9)).any()
    assert (used > 13.05).sum() >= 90
    (gap,) = np.flatnonzero(np.diff(block.segment))
    assert np.diff(used)[gap] > 1.8
    assert ingest.rejections.rejected["conflicting_publisher"] > 100
    if reason:
        assert ingest.rejections.rejected[reason] > 40
        assert "two publishers" in ingest.findings()[-1].sentence
    else:
        assert ingest.conflicting_joints == {"a", "b"}
        (finding,) = ingest.findings()
        assert "the positions of a, b jump back and forth" in finding.sentence
    assert ingest.findings()[-1].severe


def test_the_same_message_from_two_publishers_is_no_conflict():
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, together(driver(), driver()))
    assert len(block) == 400
    assert ingest.rejections.rejected == {"duplicate_stamp": 400}
    assert not ingest.findings()


@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize(("rate", "offset"), [(10.0, 0.0), (10.0, 0.004), (100.0, 0.0), (300.0, 0)])
def test_zeros_next_to_the_driver_are_left_out_and_the_driver_is_used(rate, offset, cut):
    """All the time, from the first message on, at the same or at other stamps."""
    ingest = JointStateIngest(NAMES, limits=limits())
    lie = stand(10.0, 14.0, rate, offset, (0.0, 0.0))
    sent = together(lie, driver())
    blocks = [take(ingest, sent[row : row + cut], flush=False) for row in range(0, len(sent), cut)]
    blocks.append(ingest.flush())
    used = [block for block in blocks if block is not None]
    assert sum(map(len, used)) == 400
    assert all((block.joint_position[:, 0] > 0.5).all() for block in used)
    assert ingest.rejections.rejected == {"zero_state": len(lie)}
    (finding,) = ingest.findings()
    assert f"{len(lie)} joint states in which all joints are exactly zero" in finding.sentence


def test_a_robot_that_stands_at_zero_or_is_referenced_there_is_used():
    sent = [message(t, NAMES, (0.0, 0.0), (0.0, 0.0)) for t in np.arange(10, 12, 0.01)]
    ingest = JointStateIngest(NAMES, limits=limits())
    assert len(take(ingest, sent)) == 200
    sent = [message(t, NAMES, (1.0 * (t < 11), 0.0), (0.0, 0.0)) for t in np.arange(10, 14, 0.01)]
    ingest = JointStateIngest(NAMES, limits=limits())
    assert take(ingest, sent).stamp_ns[-1] > 13.9 * SECOND
    assert ingest.rejections.rejected["zero_state"] <= 110  # a second, and it is zero that counts


@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize("by", [-700.0, 0.5])
def test_one_impossible_position_costs_that_message(by, cut):
    """It must not become a jerk of the arm, nor cost a second as a second publisher does."""
    sent = [entry for _, entry in driver()]
    sent[150] = message(11.5, NAMES, (1 + 0.3 * np.sin(11.5) + by, 0.5), (0.0, 0.0))
    ingest = JointStateIngest(NAMES, limits=limits())
    blocks = [take(ingest, sent[row : row + cut], flush=False) for row in range(0, 400, cut)]
    blocks.append(ingest.flush())
    used = [block for block in blocks if block is not None]
    assert sum(map(len, used)) == 399
    assert {0} == {int(segment) for block in used for segment in block.segment}
    assert ingest.rejections.rejected == {"impossible_position": 1}
    assert not ingest.conflicting_joints
    (finding,) = ingest.findings()
    assert "1 joint states refused as impossible_position" in finding.sentence
    assert not finding.severe


def test_a_second_impossible_position_within_seconds_shows_another_publisher():
    sent = [entry for _, entry in driver()]
    for row in (100, 200):
        sent[row] = message(10 + row / 100, NAMES, (0.1, 0.5), (0.0, 0.0))
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, sent)
    assert ingest.rejections.rejected == {"impossible_position": 1, "conflicting_publisher": 101}
    assert ingest.conflicting_joints == {"a"}
    (finding,) = ingest.findings()
    assert "two publishers contradict each other" in finding.sentence


def test_a_jump_that_stays_is_a_gap_and_no_conflict():
    """An encoder that is referenced again: one interval is lost, no more."""
    sent = [message(t, NAMES, (0.0 if t < 11 else 1.5, 0.0), ()) for t in np.arange(10, 12, 0.01)]
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, sent)
    assert len(block) == 200
    np.testing.assert_array_equal(np.unique(block.segment), [0, 1])
    assert not ingest.conflicts.count


def test_pairs_of_messages_are_found_too():
    """Both publishers in bursts of two: steps that last two samples and come back."""
    sent = []
    for burst in range(50):
        for row in range(2):
            q = 0.0 if burst % 2 else 1.0
            sent.append(message(10 + 0.02 * burst + 0.01 * row, NAMES, (q, 0.3), ()))
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, sent)
    assert ingest.conflicting_joints == {"a"}
    assert len(block) <= 4


def test_fast_motion_beyond_a_wrong_limit_is_no_conflict():
    """A URDF with placeholder limits must not cost energy: only flags may follow."""
    sent = [
        message(t, NAMES, (np.sin(6 * t), 0.0), (6 * np.cos(6 * t), 0.0))
        for t in np.arange(10, 14, 0.01)
    ]
    ingest = JointStateIngest(NAMES, limits=limits(velocity=0.5))
    block = take(ingest, sent)
    assert len(block) == 400
    assert not ingest.conflicts.count
    assert ingest.rejections.rejected == {}


def test_a_continuous_joint_that_wraps_is_no_conflict():
    """Noise around pi changes the sign of the position at every sample."""
    sent = [
        message(t, NAMES, (np.pi * (-1) ** row, 0.0), (0.0, 0.0))
        for row, t in enumerate(np.arange(10, 11, 0.01))
    ]
    ingest = JointStateIngest(NAMES, limits=limits(wraps=True))
    assert len(take(ingest, sent)) == 100
    assert not ingest.conflicts.count


def test_parts_of_one_joint_from_two_publishers_conflict():
    names = ("a", "b")
    sent = [(t, message(t, ("a",), (0.1 * t,), (0.1,))) for t in np.arange(10, 13, 0.01)]
    sent += [(t, message(t, ("b",), (1.0,), (0.0,))) for t in np.arange(10.002, 13, 0.01)]
    sent += [(t, message(t, ("b",), (0.0,), (0.0,))) for t in np.arange(11.006, 11.5, 0.01)]
    ingest = JointStateIngest(names, limits=limits())
    block = take(ingest, [entry for _, entry in sorted(sent)])
    assert ingest.conflicting_joints == {"b"}
    used = block.stamp_ns / SECOND
    assert not ((used > 11.05) & (used < 12.4)).any()
    assert (used > 12.6).any()


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_leaps_do_not_depend_on_how_values_that_repeat_are_cut(size):
    random = np.random.default_rng(2)
    stamp = np.cumsum(random.integers(2, 40, 400)) * 10**6
    new = random.random((400, 2)) < np.where(np.arange(400) % 100 < 50, 0.3, 1.0)[:, None]
    position = np.cumsum(np.where(new, random.normal(0.02, 0.1, (400, 2)), 0.0), axis=0)
    whole, cut = (PositionJumpDetector.of(2, limits()) for _ in range(2))
    rows = [slice(row, row + size) for row in range(0, 400, size)]
    none = np.zeros((400, 2))
    found = [cut.leaps(stamp[one], position[one]) for one in rows]
    joined = [none[one] if leap is None else leap for one, leap in zip(rows, found, strict=True)]
    expected = whole.leaps(stamp, position)
    assert expected.any()
    np.testing.assert_array_equal(np.concatenate(joined), expected)
    assert vars(cut.repeats) == vars(whole.repeats)
    assert whole.repeats.count
