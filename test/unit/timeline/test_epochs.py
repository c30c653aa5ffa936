"""Epochs of stamps and their outliers, for any stream."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.stamps import Reach, sentence_of, slow_reach
from robot_energy.timeline.streams import EpochSplitter

S = SECOND_NS
REACHES = [Reach(), Reach(patient=False), Reach(prompt=True), slow_reach(60 * S)]


def sort(epochs, stamps, cuts=(), flush=True):
    """Accepted and refused stamps, and the stamps that began new epochs."""
    stamps = np.asarray(stamps, dtype=np.int64)
    taken, strays, begins, held = [], [], [], np.empty(0, dtype=np.int64)

    def note(whole, found):
        for run in found.runs:
            rows = whole if run.rows is None else whole[run.rows]
            if run.new_epoch:
                begins.append(int(rows[0]))
            taken.extend(rows.tolist())
        strays.extend(whole[found.strays].tolist())
        return whole[np.asarray(found.held, dtype=np.int64)]

    for part in np.split(stamps, sorted(cuts)):
        if len(part):
            held = note(np.concatenate([held, part]), epochs.step(part))
            assert len(held) <= 8
    if flush:
        note(held, epochs.flush())
        assert len(taken) + len(strays) == len(stamps)
    assert epochs.strays == len(strays)
    return taken, strays, begins


def ticks(start, count=100, period=S // 100):
    return [start * S + row * period for row in range(count)]


@pytest.mark.parametrize("reach", REACHES)
@pytest.mark.parametrize("by", [-86_400, -10, 10, 7200])
@pytest.mark.parametrize("row", [1, 50, 99])
def test_one_message_of_another_time_is_refused(reach, by, row):
    stamps = ticks(100_000)
    right = stamps[row]
    stamps[row] += by * S
    taken, strays, begins = sort(EpochSplitter(reach), stamps)
    if reach.prompt and row == 1:  # neither of the first two is known to be right
        assert strays == []
        return
    assert strays == [right + by * S]
    assert not begins
    assert len(taken) == 99


@pytest.mark.parametrize("by", [-86_400, 1, 7200])
def test_the_first_message_may_be_the_wrong_one(by):
    stamps = ticks(100_000)
    stamps[0] += by * S
    assert sort(EpochSplitter(), stamps)[1:] == ([stamps[0]], [])


def test_three_messages_are_given_out_before_one_confirms_another():
    """The fourth, 180 s before the third, is refused and begins no epoch."""
    stamps = [100 * S, 50 * S, 200 * S, 20 * S, 300 * S]
    found = sort(EpochSplitter(Reach(prompt=True)), stamps, flush=False)
    assert found == ([100 * S, 50 * S, 200 * S], [20 * S], [50 * S])


@pytest.mark.parametrize("reach", REACHES)
def test_a_loop_and_a_pause_lose_nothing(reach):
    stamps = [*ticks(100), *ticks(50), *ticks(80)]
    assert sort(EpochSplitter(reach), stamps) == (stamps, [], [50 * S])


@pytest.mark.parametrize("period", [2, 30, 300])
def test_a_slow_stream_is_no_outlier(period):
    stamps = ticks(100, 20, period * S)
    for reach in (slow_reach(600 * S), Reach(max_ahead_ns=3600 * S, prompt=True)):
        epochs = EpochSplitter(reach)
        taken, strays, _ = sort(epochs, stamps, range(1, 20), flush=False)
        assert (taken, strays) == (stamps, [])


@pytest.mark.parametrize("burst", [1, 2, 4, 7])
def test_of_two_clocks_that_take_turns_one_is_believed(burst):
    turns = [
        clock * S + (row * burst + number) * S // 100
        for row in range(200)
        for clock in (100, 9000)
        for number in range(burst)
    ]
    _, strays, begins = sort(EpochSplitter(), turns)
    assert len(begins) <= 2
    assert len(strays) > 0.45 * len(turns)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    cuts=st.lists(st.integers(0, 200), max_size=20),
    reach=st.sampled_from(REACHES),
    share=st.sampled_from([0.0, 0.02, 0.2, 0.5]),
)
def test_any_cutting_gives_the_same(seed, cuts, reach, share):
    rng = np.random.default_rng(seed)
    stamps = 10**6 * S + np.cumsum(rng.integers(0, int(rng.choice([S // 50, S, 20 * S])), 200))
    stamps[rng.integers(200) :] -= int(rng.choice([0, 1, 500])) * S
    away = rng.random(200) < share
    stamps[away] += rng.choice([-7200, -10, -1, 1, 3, 7200], int(away.sum())) * S
    assert sort(EpochSplitter(reach), stamps) == sort(EpochSplitter(reach), stamps, cuts)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), reach=st.sampled_from(REACHES))
def test_outliers_that_stand_alone_cost_themselves_only(seed, reach):
    """Up to one in four, at any place but the first three, by any time: no right message lost."""
    rng = np.random.default_rng(seed)
    stamps = np.asarray(ticks(10**6, 200))
    away = 3 + np.flatnonzero(rng.random(197) < 0.25)
    away = away[np.append(True, np.diff(away) > 1)]
    stamps[away] += rng.choice([-86_400, -7200, -60, 60, 7200], len(away)) * S
    taken, strays, begins = sort(EpochSplitter(reach), stamps)
    assert strays == stamps[away].tolist()
    assert taken == np.delete(stamps, away).tolist()
    assert not begins


def test_a_stray_of_before_a_jump_back_is_of_long_ago():
    stamps = ticks(100_000)
    stamps[50] += 7200 * S
    before, after = EpochSplitter(), EpochSplitter()
    sort(before, stamps)
    sort(after, stamps + ticks(90_000, 2000))
    assert "7200.0 s ahead" in sentence_of(before, "readings", within=10.0)
    assert "7200.0 s ahead" in sentence_of(after, "readings")
    assert not sentence_of(after, "readings", within=10.0)
