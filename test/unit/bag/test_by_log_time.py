"""Topics that lie one behind the other in a bag are brought together by their log times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.reader import merged

SECOND = 10**9
TOPICS = ("/joints", "/heat")


def written(bags, path, order, jump=0):
    """A bag of 20 s with one topic behind the other; the joints may jump back in the middle."""
    joints, heat = 10**15 + np.arange(20_000) * 10**6, 10**15 + np.arange(20) * SECOND
    joints = joints - np.where(np.arange(20_000) < 10_000, 0, jump)
    rows = {
        "/joints": (bags.JOINT_STATE, joints, bags.joint_rows(joints)),
        "/heat": (bags.TEMPERATURE, heat, bags.temperature_rows(heat)),
    }
    with BagWriter(path) as bag:
        for topic in order:
            kind, stamps, data = rows[topic]
            bag.add_topic(topic, kind)
            for at in range(0, len(stamps), 1000):
                bag.write(topic, stamps[at : at + 1000], data[at : at + 1000])
    return path


@pytest.mark.parametrize("order", [TOPICS, TOPICS[::-1]])
def test_no_topic_is_far_ahead_of_another(tmp_path, bags, order):
    reader = BagReader(written(bags, tmp_path / "bag", order))
    newest = dict.fromkeys(TOPICS, 10**15)
    counts = dict.fromkeys(TOPICS, 0)
    for part in reader.parts(TOPICS):
        for topic, batch in part.items():
            assert batch.log_time_ns[0] >= newest[topic]
            newest[topic] = int(batch.log_time_ns[-1])
            counts[topic] += len(batch)
        assert abs(newest["/joints"] - newest["/heat"]) <= SECOND
    assert counts == {"/joints": 20_000, "/heat": 20}
    assert not reader.problems


def test_a_topic_whose_clock_was_set_back_keeps_the_order_of_the_file(tmp_path, bags):
    path = written(bags, tmp_path / "bag", TOPICS, jump=30 * SECOND)
    found, _ = bags.read_all(path)
    assert [topic for topic, _, _ in found] == ["/joints"] * 20_000 + ["/heat"] * 20


def test_files_with_a_topic_each_are_read_together(tmp_path, bags):
    folder = tmp_path / "bag"
    folder.mkdir()
    for number, topic in enumerate(TOPICS):
        part = written(bags, tmp_path / str(number), (topic,))
        (part / f"{number}_0.mcap").rename(folder / f"bag_{number}.mcap")
    reader = BagReader(folder)
    first = next(iter(reader.parts(TOPICS)))
    assert set(first) == set(TOPICS)
    assert not reader.problems


@given(
    st.lists(st.lists(st.lists(st.integers(0, 50), min_size=1, max_size=5), max_size=4), max_size=4)
)
def test_merging_loses_nothing_and_keeps_the_order_of_each_topic(drawn):
    topics = []
    for number, cuts in enumerate(drawn):
        times = np.sort(np.concatenate([*map(np.array, cuts), np.empty(0)])).astype(np.int64)
        ends = np.cumsum([len(cut) for cut in cuts])[:-1]
        topics.append(
            [
                RawBatch.from_messages(f"/{number}", "t", part, [b"%d" % time for time in part])
                for part in (np.split(times, ends) if cuts else [])
            ]
        )
    parts = list(merged([iter(batches) for batches in topics]))
    latest = -1
    for part in parts:
        assert all(int(batch.log_time_ns[0]) >= latest for batch in part.values())
        latest = max(int(batch.log_time_ns[-1]) for batch in part.values())
    for number, batches in enumerate(topics):
        given_times = [time for batch in batches for time in batch.log_time_ns.tolist()]
        found = [part[f"/{number}"] for part in parts if f"/{number}" in part]
        assert [time for batch in found for time in batch.log_time_ns.tolist()] == given_times
