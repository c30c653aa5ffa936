"""Joint states that come in parts, from one topic or several."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_messages import NAMES, SECOND, batch, limits, message, take
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource
from robot_energy.timeline.blocks import JointBlock


def motion(t):
    """Position and velocity of joints a and b."""
    return np.array([np.sin(2 * t), 1 + 0.3 * t]), np.array([2 * np.cos(2 * t), 0.3])


def part(t, joint, velocity=True):
    q, v = motion(t)
    return message(t, (NAMES[joint],), (q[joint],), (v[joint],) if velocity else ())


def streams(seconds=3.0, rate_a=100.0, rate_b=70.0, start=10.0):
    """Messages of a and of b in order of their stamps."""
    a = [(t, part(t, 0)) for t in start + np.arange(0, seconds, 1 / rate_a)]
    b = [(t + 0.003, part(t + 0.003, 1)) for t in start + np.arange(0, seconds, 1 / rate_b)]
    return [entry for _, entry in sorted(a + b, key=lambda pair: pair[0])]


def test_every_reading_of_the_first_joint_is_a_sample_of_all_at_its_stamp():
    """Line and sine: the other joint stands where it was at that instant, not where it was
    last heard of."""
    ingest = JointStateIngest(NAMES)
    block = take(ingest, streams())
    at = block.stamp_ns / SECOND
    q, v = np.stack([motion(t)[0] for t in at]), np.stack([motion(t)[1] for t in at])
    np.testing.assert_allclose(block.joint_position, q, atol=2e-9)
    np.testing.assert_allclose(block.joint_velocity, v, atol=1e-9)
    assert len(block) >= 297
    assert not np.diff(block.segment).any()


def test_a_moving_joint_in_between_follows_the_cubic_through_its_velocities():
    """A sine of 20 Hz sampling, seen at 100 Hz: the cubic errs by 1e-6, a line by 1e-3."""
    names = ("b", "a")
    a = [(t, part(t, 0)) for t in 10 + np.arange(0, 2, 0.05)]
    b = [(t, part(t, 1)) for t in 10.001 + np.arange(0, 1.9, 0.01)]
    messages = [entry for _, entry in sorted(a + b)]
    block = take(JointStateIngest(names), messages)
    true = np.sin(2 * block.stamp_ns / SECOND)
    assert np.abs(block.joint_position[:, 1] - true).max() < 2e-6
    bare = [(t, part(t, 0, velocity=False)) for t, _ in a]
    block = take(JointStateIngest(names), [entry for _, entry in sorted(bare + b)])
    assert 1e-4 < np.abs(block.joint_position[:, 1] - true).max() < 2e-3
    assert np.isnan(block.joint_velocity[:, 1]).any()


def test_a_part_that_stops_is_a_gap_and_not_held():
    """Joint b is silent for a second: those samples are missing, and nothing bridges them."""
    silent = [
        entry
        for t, entry in sorted(
            [(t, part(t, 0)) for t in 10 + np.arange(0, 4, 0.01)]
            + [(t, part(t, 1)) for t in 10.003 + np.arange(0, 4, 0.01) if not 11 < t < 12]
        )
    ]
    ingest = JointStateIngest(NAMES)
    block = take(ingest, silent)
    step = np.diff(block.stamp_ns) / SECOND
    (gap,) = np.flatnonzero(np.diff(block.segment))
    assert 0.9 < step[gap] < 1.1
    assert step[np.arange(len(step)) != gap].max() < 0.02
    assert ingest.rejections.rejected["missing_joint"] == pytest.approx(100, abs=3)


def test_waiting_is_bounded_by_stamps():
    """Joint b never comes: after a second of stamps a message is given up, one by one."""
    ingest = JointStateIngest(NAMES)
    messages = [part(t, 0) for t in 10 + np.arange(0, 3, 0.01)]
    assert take(ingest, messages, flush=False) is None
    assert ingest.rejections.waiting == pytest.approx(101, abs=1)
    assert ingest.missing_joints == {"b"}
    assert ingest.ages["b"] == np.inf


def test_ages_say_which_joint_is_behind():
    ingest = JointStateIngest(NAMES)
    take(ingest, [part(10.0, 1), part(10.0, 0), part(10.25, 0)], flush=False)
    assert ingest.ages == {"a": 0.0, "b": pytest.approx(0.25)}
    whole = JointStateIngest(NAMES)
    take(whole, [message(1.0)])
    assert whole.ages == {"a": 0.0, "b": 0.0}


def test_several_topics_give_what_one_topic_gives():
    one = JointStateIngest(NAMES)
    expected = take(one, streams())
    two = JointStateIngest(NAMES)
    a = batch([part(t, 0) for t in 10 + np.arange(0, 3.0, 0.01)], "/a")
    b = batch([part(t + 0.003, 1) for t in 10 + np.arange(0, 3.0, 1 / 70)], "/b")
    found = JointBlock.concatenate([x for x in (two.step([a, b]), two.flush()) if x is not None])
    np.testing.assert_array_equal(found.stamp_ns, expected.stamp_ns)
    np.testing.assert_array_equal(found.joint_position, expected.joint_position)


def test_seven_joints_over_three_publishers_with_lag():
    """Each publisher 5 and 12 ms behind the other: still every instant is known exactly."""
    names = tuple("abcdefg")
    groups = (("a", "b", "c"), ("d", "e"), ("f", "g"))
    speed = np.arange(1, 8) * 0.1
    sent = [
        (t + lag, message(t, group, [t * speed[names.index(name)] for name in group], ()))
        for group, lag in zip(groups, (0.0, 0.005, 0.012), strict=True)
        for t in 20 + np.arange(0, 2, 0.008) + lag / 3
    ]
    ingest = JointStateIngest(names)
    block = take(ingest, [entry for _, entry in sorted(sent)])
    expected = block.stamp_ns[:, None] / SECOND * speed
    np.testing.assert_allclose(block.joint_position, expected, atol=1e-9)
    assert len(block) >= 248


def test_a_wrapped_joint_is_not_interpolated_the_long_way_round():
    wrapped = lambda t: (t + np.pi) % (2 * np.pi) - np.pi  # noqa: E731
    sent = [(t, message(t, ("a",), (wrapped(t),), ())) for t in np.arange(3, 3.4, 0.02)]
    sent += [(t, message(t, ("b",), (0.0,), ())) for t in np.arange(3.005, 3.35, 0.01)]
    block = take(JointStateIngest(("b", "a"), limits=limits(("b", "a"), wraps=True)),
                 [entry for _, entry in sorted(sent)])  # fmt: skip
    turn = np.exp(1j * block.joint_position[:, 1])
    np.testing.assert_allclose(turn, np.exp(1j * block.stamp_ns / SECOND), atol=1e-9)


@pytest.mark.parametrize("cut", [None, 60, 155])
def test_a_part_that_comes_after_the_wait_is_too_late_however_the_input_is_cut(cut):
    """Joint a runs to 11.5 s before b comes on: what was given up by then stays given up."""
    early = [part(9.99, 1), *(part(t, 0) for t in np.arange(10, 11.501, 0.01))]
    late = [part(t, 1) for t in np.arange(10.6, 11.7, 0.05)]
    messages, ingest = early + late, JointStateIngest(NAMES)
    blocks = [ingest.step(batch(messages[:cut]))]
    blocks += [ingest.step(batch(messages[cut:]))] if cut else []
    block = JointBlock.concatenate([found for found in (*blocks, ingest.flush()) if found])
    assert block.stamp_ns[0] / SECOND == pytest.approx(10.5)
    assert ingest.rejections.rejected == {"missing_joint": 50}


def test_the_last_whole_message_is_the_first_reading_of_the_parts():
    whole = [message(t, NAMES, *motion(t)) for t in np.arange(10, 11, 0.01)]
    parts = [part(t, joint) for t in np.arange(11, 12, 0.01) for joint in (0, 1)]
    ingest = JointStateIngest(NAMES)
    block = take(ingest, [*whole, *parts[:1], *parts[2:]])  # without b at 11.00
    assert len(block) == 200
    assert ingest.rejections.rejected == {}
    expected = np.stack([motion(t)[0] for t in block.stamp_ns / SECOND])
    np.testing.assert_allclose(block.joint_position, expected, atol=1e-7)


def test_an_epoch_that_begins_a_little_after_the_last_sample_is_still_a_new_one():
    """Joint b was a second ahead of a when both began again: no derivative across."""
    b = [part(t, 1) for t in np.arange(12, 13.05, 0.01)]
    both = [part(t, joint) for t in np.arange(10, 12.005, 0.01) for joint in (0, 1)]
    again = [part(t, joint) for t in np.arange(12.03, 12.5, 0.01) for joint in (1, 0)]
    block = take(JointStateIngest(NAMES), both + b[1:] + again)
    step = np.diff(block.stamp_ns) / SECOND
    assert (step > 0).all()
    (seam,) = np.flatnonzero(np.diff(block.segment))
    assert step[seam] == pytest.approx(0.03)


def test_parts_and_whole_messages_mix():
    """A driver that sends some joints first and all of them later."""
    early = [part(t, joint) for t in 10 + np.arange(0, 1, 0.01) for joint in (0, 1)]
    late = [message(t, NAMES, *motion(t)) for t in 11 + np.arange(0, 0.5, 0.01)]
    ingest = JointStateIngest(NAMES)
    block = take(ingest, early + late + early[-2:])
    assert len(block) == 150
    assert ingest.rejections.rejected == {"older_stamp": 2}


def disturbed(seed):
    """Two topics with loops, strays, losses, duplicates, zeros, late and whole messages."""
    rng = np.random.default_rng(seed)
    stamp = 100 + np.cumsum(rng.uniform(0.005, 0.02, 150))
    if rng.random() < 0.5:
        stamp[rng.integers(1, 150) :] -= 30
    entries = []
    for t in stamp:
        kind = rng.random()
        t = float(t) + (rng.normal() * 0.03 if kind < 0.1 else 0.0)
        if kind > 0.97:
            t = float(rng.choice([0.0, t - 7, t + 5]))
        q, v = motion(t)
        q = q * 0 if rng.random() < 0.02 else q
        who = rng.integers(0, 3)
        names = (NAMES, NAMES[:1], NAMES[1:])[who]
        keep = slice(None) if who == 0 else slice(who - 1, who)
        entries.append(message(t, names, q[keep], v[keep] if rng.random() < 0.9 else ()))
        if rng.random() < 0.05:
            entries.append(entries[-1])
    return entries


@settings(deadline=None, max_examples=12)
@given(
    seed=st.integers(0, 2**31),
    cuts=st.lists(st.integers(0, 160), max_size=20),
    reorder=st.sampled_from([0.0, 0.05]),
    whole=st.booleans(),
)
def test_any_cutting_gives_the_same_samples(seed, cuts, reorder, whole):
    messages = disturbed(seed)
    if whole:  # messages with all joints only
        messages = [m for m in messages if b"a\x00" in m and b"b\x00" in m]

    def run(bounds):
        ingest = JointStateIngest(
            NAMES, limits=limits(), source=JointStateSource(reorder_window=reorder)
        )
        blocks = []
        for start, stop in zip([0, *bounds], [*bounds, len(messages)], strict=True):
            blocks.append(ingest.step(batch(messages[start:stop])))
            assert ingest.rejections.balanced
        blocks.append(ingest.flush())
        assert ingest.rejections.balanced
        found = [block for block in blocks if block is not None]
        return ingest, JointBlock.concatenate(found) if found else None

    a, block_a = run([])
    b, block_b = run(sorted(min(cut, len(messages)) for cut in cuts))
    assert a.rejections == b.rejections
    assert (a.conflicts.count, a.conflicts.last_ns) == (b.conflicts.count, b.conflicts.last_ns)
    assert (a.order.jumps, a.order.gaps, a.samples) == (b.order.jumps, b.order.gaps, b.samples)
    assert a.findings() == b.findings()
    assert (block_a is None) == (block_b is None)
    if block_a is not None and block_b is not None:
        for name in block_a.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(block_a, name), getattr(block_b, name), name)
        within = np.diff(block_a.segment) == 0
        assert (np.diff(block_a.stamp_ns)[within] > 0).all()


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 2**31))
def test_interleaving_of_topics_does_not_matter(seed):
    """Each topic in order, neither ahead by more than a second: the same samples."""
    rng = np.random.default_rng(seed)
    topics = [
        [part(t, joint) for t in 10 + np.cumsum(rng.uniform(0.005, 0.02, 60))] for joint in (0, 1)
    ]

    def run(bounds):
        ingest = JointStateIngest(NAMES)
        blocks = []
        for (a0, a1), (b0, b1) in bounds:
            pieces = [batch(topics[0][a0:a1], "/a"), batch(topics[1][b0:b1], "/b")]
            blocks.append(ingest.step(pieces if rng.random() < 0.5 else pieces[::-1]))
        blocks.append(ingest.flush())
        return JointBlock.concatenate([block for block in blocks if block is not None])

    whole = run([((0, 60), (0, 60))])
    cuts = [[0, *sorted(rng.integers(0, 60, 3).tolist()), 60] for _ in topics]
    pairs = [list(pairwise(cut)) for cut in cuts]
    pieces = run(list(zip(*pairs, strict=True)))
    for name in ("stamp_ns", "segment", "joint_position", "joint_velocity"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name), name)
