"""Curves for plots: bounded rows, all joules, the same however the input is cut."""

from types import SimpleNamespace

import numpy as np
import pytest

from robot_energy.accounting.energy_curve import EnergyCurve, add_means


def taken(count, cuts, max_rows, pieces=3):
    """Readings of several pieces each, taken in blocks."""
    rng = np.random.default_rng(1)
    stamp = np.repeat(np.arange(1, count + 1) * 1000, pieces)
    duration = rng.integers(100, 300, len(stamp))
    energy = rng.normal(size=(len(stamp), 2))
    curve = EnergyCurve(2, max_rows)
    for block in np.split(np.arange(len(stamp)), cuts):
        curve.add(stamp[block], duration[block], energy[block])
    return curve.rows(), stamp, duration, energy


@pytest.mark.parametrize("count", [1, 2, 63, 64, 65, 66, 1000, 4097])
def test_rows_are_bounded_and_nothing_is_lost(count):
    rows, stamp, duration, energy = taken(count, [], 64)
    assert len(rows.stamp_ns) <= 65
    assert rows.duration_ns.sum() == duration.sum()
    assert rows.energy.sum(axis=0) == pytest.approx(energy.sum(axis=0))
    assert rows.stamp_ns[-1] == stamp[-1]
    assert rows.begin_ns[0] == stamp[0] - duration[:3].sum()
    assert np.all(np.diff(rows.stamp_ns) > 0)


@pytest.mark.parametrize("cuts", [[1], [2, 3, 4], list(range(1, 3000)), [1500, 1501, 2999]])
def test_any_cutting_gives_the_same(cuts):
    whole, *_ = taken(1000, [], 64)
    cut, *_ = taken(1000, cuts, 64)
    for name in ("stamp_ns", "begin_ns", "duration_ns"):
        assert np.array_equal(getattr(whole, name), getattr(cut, name))
    np.testing.assert_allclose(whole.energy, cut.energy, rtol=1e-12, atol=1e-12)


def test_few_readings_stay_one_row_each():
    rows, _, duration, energy = taken(50, [7, 8], 64)
    assert len(rows.stamp_ns) == 50
    assert np.array_equal(rows.duration_ns, duration.reshape(-1, 3).sum(axis=1))
    np.testing.assert_allclose(rows.energy, energy.reshape(-1, 3, 2).sum(axis=1), rtol=1e-12)


def test_nothing_gives_nothing():
    nothing = np.empty(0, dtype=np.int64)
    curve = EnergyCurve(1)
    curve.add(nothing, nothing, np.empty((0, 1)))
    assert len(curve.rows().stamp_ns) == 0


def test_means_of_known_power_are_energies_of_their_periods():
    """100 W for 2 s and 50 W for half a second; nothing of what is not known."""
    means = SimpleNamespace(
        stamp_ns=np.array([3, 4, 5, 6]) * 10**9,
        predicted_power=np.array([100.0, np.nan, 50.0, 70.0]),
        period=np.array([2.0, 1.0, 0.5, 0.0]),
    )
    curve = EnergyCurve(1)
    add_means(curve, means)
    rows = curve.rows()
    assert rows.stamp_ns.tolist() == [3 * 10**9, 5 * 10**9]
    assert rows.duration_ns.tolist() == [2 * 10**9, 5 * 10**8]
    assert rows.energy.tolist() == [[200.0], [25.0]]
