"""A robot whose friction and losses are off by known amounts, seen through its meter alone."""

import numpy as np
import pytest

from robot_energy.condition.meter_fit import MeterFit
from robot_energy.condition.record import MeterRecord
from robot_energy.foundation.errors import StateFileError

LOSS = 300.0


def taught(factor: float, offset: float, windows: int = 60, noise: float = 0.0) -> MeterFit:
    """A fit after windows of 5 s at changing friction power."""
    fit, rng = MeterFit(LOSS), np.random.default_rng(1)
    for _ in range(windows):
        friction = rng.uniform(0.0, 400.0) * 5.0
        residual = (factor - 1.0) * friction + offset * 5.0 + noise * rng.standard_normal()
        fit.step(5.0, 4000.0 + friction, residual, friction)
    return fit


def test_both_are_found():
    fit = taught(1.3, 45.0)
    assert fit.valid
    assert fit.filtered == pytest.approx((1.3, 45.0), rel=0.02)


def test_standard_deviations_shrink_with_time():
    assert taught(1.3, 45.0, 15, 200.0).std[0] > 1.5 * taught(1.3, 45.0, 60, 200.0).std[0]


def test_nothing_is_valid_before_a_minute():
    assert not taught(1.3, 45.0, 11).valid
    assert taught(1.3, 45.0, 12).valid


def test_bounds_hold_and_the_other_figure_makes_the_best_of_it():
    fit = taught(1.2, 400.0)
    factor, offset = fit.filtered
    assert offset == 150.0  # half of the constant losses
    assert fit.raw[1] > 300.0
    assert factor > fit.raw[0]  # takes what it can of the rest


def test_one_window_of_a_collision_moves_little():
    fit = taught(1.3, 45.0, 60, 30.0)
    before = fit.filtered
    fit.step(5.0, 30_000.0, 25_000.0, 400.0)
    assert fit.refused == 1
    assert fit.filtered == pytest.approx(before, rel=0.25)


def test_a_change_that_stays_is_learned():
    fit = taught(1.3, 45.0)
    for _ in range(600):
        fit.step(5.0, 5000.0, 100.0 * 5.0 + 0.3 * 1000.0, 1000.0)
    assert fit.raw[1] + fit.raw[0] * 200.0 == pytest.approx(100.0 + 1.3 * 200.0, rel=0.02)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_windows_that_are_no_numbers_are_counted(bad):
    fit = taught(1.3, 45.0)
    before = fit.filtered
    fit.step(5.0, bad, 10.0, 20.0)
    fit.step(5.0, 100.0, bad, 20.0)
    assert (fit.refused, fit.filtered) == (2, before)


def test_it_continues_from_its_record():
    fit, again = taught(1.3, 45.0, 60, 30.0), MeterFit(LOSS)
    MeterRecord.from_json(MeterRecord.of(fit).to_json()).put_into(again)
    for each in (fit, again):
        each.step(5.0, 5000.0, 300.0, 700.0)
    assert again.raw == fit.raw
    assert again.std == fit.std
    with pytest.raises(StateFileError, match="numbers in one array"):
        MeterRecord.of(fit).model_copy(update={"target": (1.0,)}).put_into(again)
