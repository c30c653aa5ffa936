"""Rings keep every peak and every joule of their time, however the input is cut."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy_report.page.history import MAX_BUCKETS, HistoryRing

START = 1_700_000_000_000_000_000


def rows(n, period=0.05, seed=1):
    rng = np.random.default_rng(seed)
    stamp = START + (np.arange(1, n + 1) * period * 1e9).astype(np.int64)
    return stamp, rng.normal(1000.0, 500.0, (n, 2)), np.full(n, period)


def plain(ring):
    return ring.table()


@given(st.lists(st.integers(0, 500), max_size=6), st.booleans())
def test_any_cutting_gives_the_same_ring(cuts, whole):
    stamp, power, period = rows(500)
    once, cut = HistoryRing(0.2, 2, whole), HistoryRing(0.2, 2, whole)
    once.add(stamp, power, period)
    bounds = [0, *sorted(cuts), 500]
    for start, stop in pairwise(bounds):
        cut.add(stamp[start:stop], power[start:stop], period[start:stop])
    assert plain(once) == plain(cut)


def test_peaks_and_energy_stay_while_buckets_are_merged():
    stamp, power, period = rows(20_000)
    ring = HistoryRing(0.2, 2, whole=True)
    for start in range(0, 20_000, 7):
        part = slice(start, start + 7)
        ring.add(stamp[part], power[part], period[part])
    table = ring.table()
    assert table["width"] > 0.2
    assert len(table["number"]) <= MAX_BUCKETS
    assert max(table["high"][0]) == pytest.approx(power[:, 0].max(), abs=0.05)
    assert min(table["low"][1]) == pytest.approx(power[:, 1].min(), abs=0.05)
    np.testing.assert_allclose(ring.energy(), (power * period[:, None]).sum(axis=0), rtol=1e-12)


def test_old_buckets_leave_and_what_is_unknown_is_none():
    stamp, power, period = rows(20_000)
    power[-10:, 1] = np.nan
    ring = HistoryRing(0.2, 2)
    ring.add(stamp, power, period)
    table = ring.table()
    assert len(table["number"]) == MAX_BUCKETS
    assert table["number"] == list(range(table["number"][0], table["number"][0] + MAX_BUCKETS))
    assert table["mean"][1][-1] is None
    assert table["mean"][0][-1] is not None
    np.testing.assert_allclose(ring.seconds()[0], MAX_BUCKETS * 0.2, rtol=1e-9)


def test_a_backward_jump_begins_the_ring_again():
    stamp, power, period = rows(100)
    ring = HistoryRing(0.2, 2)
    ring.add(stamp, power, period)
    ring.add(stamp - 3_600_000_000_000, power, period)
    assert len(ring.table()["number"]) == 25
    ring.add(np.concatenate([stamp, stamp]), np.concatenate([power, power]), np.tile(period, 2))
    assert len(ring.table()["number"]) == 25


@pytest.mark.parametrize("whole", [False, True])
def test_a_clock_that_steps_back_keeps_the_history(whole):
    stamp, power, period = rows(2_000)
    ring = HistoryRing(0.2, 2, whole)
    ring.add(stamp, power, period)
    ring.add(stamp[-1:] + np.arange(-60, 140) * 50_000_000, power[:200], period[:200])
    np.testing.assert_allclose(ring.seconds(), 2_200 * 0.05, rtol=1e-9)
    table = ring.table()
    assert (np.diff(table["number"]) == 1).all()
    assert len(table["number"]) == pytest.approx(2_140 * 0.05 / table["width"], abs=2)


def test_buckets_before_the_first_are_merged_like_others():
    stamp, power, period = rows(1_000)
    ring = HistoryRing(0.2, 2, whole=True)
    for seconds in (0, -60, 100, 200):
        ring.add(stamp + seconds * 1_000_000_000, power, period)
    np.testing.assert_allclose(ring.energy(), 4 * (power * 0.05).sum(axis=0), rtol=1e-9)
    assert ring.table()["width"] == pytest.approx(0.8)


def test_gaps_stay_gaps():
    stamp, power, period = rows(8)
    ring = HistoryRing(0.2, 2)
    ring.add(stamp, power, period)
    ring.add(stamp + 10_000_000_000, power, period)
    number = np.diff(ring.table()["number"])
    assert number.max() == 49
