"""Whether a fan runs, by the windows of a meter."""

from math import exp

import pytest

from robot_energy.condition.fan_odds import FanOdds

SECOND = 1_000_000_000


def odds(residuals, measured=100.0, now=60):
    """Windows of 5 s from 5 s on, a fan of 30 W."""
    fan = FanOdds(30.0)
    for place, residual in enumerate(residuals, 1):
        fan.step(5 * SECOND * place, residual, measured)
    return fan.odds(now * SECOND)


def test_odds_follow_from_the_power_that_is_missing():
    """Predictions of 100 W are off by 5 W: log odds of 30 (30 - 15) / 25 = 18."""
    assert odds([30.0]) == pytest.approx(exp(18.0))
    assert odds([30.0] * 6) == pytest.approx(exp(18.0))  # not surer: they are off alike
    assert odds([0.0]) == pytest.approx(exp(-18.0))
    assert odds([15.0]) == 1.0
    assert odds([30.0], 1000.0) == pytest.approx(exp(30.0 * 15.0 / 50.0**2))
    assert odds([30.0], 10.0) == pytest.approx(exp(20.0))  # of 2 W at least, and no surer


def test_windows_that_scatter_say_less():
    """A mean of 30 W of two windows at +-10 W has a variance of 100 / 2 on top of 25 W^2."""
    assert odds([20.0, 40.0]) == pytest.approx(exp(30.0 * 15.0 / 75.0))


def test_the_newest_half_minute_counts_and_nothing_older_than_a_minute():
    assert odds([30.0] * 9 + [0.0] * 6, now=75) == pytest.approx(exp(-18.0))
    assert odds([30.0], now=64) > 1.0
    assert odds([30.0], now=65) == odds([]) == 1.0
    assert odds([30.0], now=4) == 1.0  # a clock that was set back
    assert odds([float("nan")]) == 1.0
