"""The test for wear over bags of a few minutes."""

import numpy as np
import pytest

from robot_energy.condition.wear_records import FEATURES, WearRecord
from robot_energy.foundation.units import HOUR_NS
from robot_energy_fleet.findings import wear_history

DAY_NS = 24 * HOUR_NS
FEATURE = tuple(0.25 if place in (12, 13, 16, 17) else 0.0 for place in range(FEATURES))


def records(seed, change=lambda day: 0.0, days=35, noise=0.01):
    """One short bag a day."""
    random = np.random.default_rng(seed)
    return [
        WearRecord(
            day * DAY_NS, 0.01, 50.0, change(day) + noise * random.standard_normal(), 1e-5, FEATURE
        )
        for day in range(days)
    ]


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.05])
def test_bags_that_scatter_are_no_wear(noise):
    for seed in range(10):
        assert not wear_history(records(seed, noise=noise), 0.4).changes


def test_a_ramp_is_found_with_its_beginning():
    ramp = lambda day: 0.3 * max(day - 17, 0) / 17  # noqa: E731
    test = wear_history(records(1, ramp), 0.4)
    assert test.changes
    assert not test.drift.fell
    assert 15 * DAY_NS < test.drift.since_ns < 28 * DAY_NS
    assert test.drift.size == pytest.approx(np.expm1(0.3), abs=0.04)


def test_regreasing_is_a_fall():
    test = wear_history(records(2, lambda day: -0.2 * (day >= 20)), 0.4)
    assert test.drift.fell
    assert test.drift.size == pytest.approx(np.expm1(-0.2), abs=0.03)
    assert abs(test.drift.since_ns / DAY_NS - 19.5) <= 1.0


def test_a_thousand_bags_are_merged_and_nothing_is_no_history():
    many = [one._replace(stamp_ns=one.stamp_ns // 40) for one in records(3, days=1400)]
    assert len(wear_history(many, 0.4).records) == 48
    assert not wear_history([], 0.4).changes
