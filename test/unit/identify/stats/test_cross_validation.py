"""Blocks and folds of held-out data."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy_identify.stats.cross_validation import (
    EnergyScore,
    contiguous_blocks,
    contiguous_folds,
    folds_by_value,
    held_out,
)

SECOND = 1_000_000_000


def test_blocks_are_as_long_as_asked_and_end_with_a_segment():
    stamp = np.array([0, 1, 2, 3, 10, 11, 12]) * SECOND
    segment = np.array([4, 4, 4, 4, 7, 7, 7])
    assert contiguous_blocks(stamp, segment, 2.0).tolist() == [0, 0, 1, 1, 2, 2, 3]


@given(
    st.lists(st.integers(1, 5 * SECOND), min_size=1, max_size=60),
    st.lists(st.booleans(), min_size=60, max_size=60),
)
def test_no_block_spans_two_segments_or_more_than_its_length(steps, breaks):
    stamp = np.cumsum(np.array(steps, dtype=np.int64))
    segment = np.cumsum(np.array(breaks[: len(steps)], dtype=np.int64))
    block = contiguous_blocks(stamp, segment, 3.0)
    for number in np.unique(block):
        inside = block == number
        assert len(np.unique(segment[inside])) == 1
        assert np.ptp(stamp[inside]) < 3 * SECOND
        assert (np.diff(np.flatnonzero(inside)) == 1).all()


def test_contiguous_folds_are_contiguous_and_even():
    assert contiguous_folds(7, 3).tolist() == [0, 0, 0, 1, 1, 2, 2]


def test_folds_by_value_follow_the_value():
    fold = folds_by_value(np.array([30.0, 20.0, 50.0, 40.0]), 2)
    assert fold.tolist() == [0, 0, 1, 1]


def test_held_out_samples_are_never_in_their_own_training():
    """Predicting the training mean: a ramp gives a known error, seen samples would give less."""
    target = np.array([0.0, 0.0, 2.0, 2.0])

    def mean(train, test):
        assert not (train & test).any()
        return np.full(int(test.sum()), target[train].mean())

    result = held_out(target, contiguous_folds(4, 2), mean)
    assert result.folds == 2
    assert result.rms == pytest.approx(2.0)
    assert result.relative == pytest.approx(4.0 / np.sqrt(8.0))


def test_a_better_power_may_cost_what_the_folds_cannot_say_of_the_energy():
    def score(rms, *shares):
        return EnergyScore(rms, float(np.abs(shares).mean()), max(shares, key=abs), shares)

    given = score(100.0, 0.010, -0.012, 0.011)
    assert score(60.0, 0.012, -0.014, 0.013).beats(given)  # 0.2 points of energy
    assert not score(60.0, 0.015, -0.017, 0.016).beats(given)  # 0.5 points, alike in every fold
    # 0.5 points in the mean, but 2 points apart from fold to fold
    assert score(60.0, 0.030, -0.008, 0.010).beats(given)
    assert not score(99.0, 0.001, -0.001, 0.001).beats(given)
