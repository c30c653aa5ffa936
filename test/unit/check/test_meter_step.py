"""Readings of a meter that step although the predicted power does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.check.meter_step import by_second, drift_of, step_of

BEGIN = 10**9 * SECOND_NS
RATE = 10


def predicted(seconds: int = 40) -> Float:
    """Power of moves of a second or two, in which the robot takes 400 to 2000 W."""
    rng = np.random.default_rng(4)
    return np.repeat(rng.uniform(400.0, 2000.0, seconds), RATE)


def compared(power: Float, measured: Float, apart: int = 1) -> Compared:
    """Readings that are ``apart`` tenths of a second apart, with noise of 2 %."""
    noisy = measured * (1.0 + 0.02 * np.random.default_rng(5).standard_normal(len(measured)))
    step_ns = apart * SECOND_NS // RATE
    stamp = BEGIN + step_ns * np.arange(1, len(power) + 1) - 1
    seconds = step_ns / SECOND_NS
    energy = power * seconds
    return Compared(stamp, np.full(len(power), step_ns), noisy * seconds, energy, energy)


def later(at: float, count: int) -> Float:
    return (np.arange(count) >= at * RATE).astype(np.float64)


@pytest.mark.parametrize("model", [(1.0, 0.0), (1.02, 20.0)])  # also of a model that is off
def test_a_load_that_begins_is_found_with_its_power_and_time(model: tuple[float, float]) -> None:
    power = predicted()
    factor, constant = model
    sound = factor * power + constant
    assert step_of(compared(power, sound), BEGIN) is None
    found = step_of(compared(power, sound + 300.0 * later(20, len(power))), BEGIN)
    assert found is not None
    assert found.evidence == pytest.approx(300.0, rel=0.1)
    assert found.sentence.startswith("from 20 s on the meter reads 3")
    assert "more than before" in found.sentence


@pytest.mark.parametrize("factor", [1.3, 1e-3])
def test_a_scale_that_changes_is_found(factor: float) -> None:
    """As such: the same of another load would be 5 % less."""
    power = predicted(16)
    changed = np.where(later(8, len(power)) > 0, factor, 1.0)
    found = step_of(compared(power, power * changed), BEGIN)
    assert found is not None
    assert found.evidence == pytest.approx((factor - 1.0) * power[80:].mean(), rel=0.02)
    assert "from 8 s on" in found.sentence


@pytest.mark.parametrize(("load", "noise"), [(60.0, 0.0), (300.0, 180.0)])  # sure; large
def test_a_small_load_or_one_that_may_be_chance_is_no_step(load: float, noise: float) -> None:
    power = predicted()
    scatter = np.repeat(np.random.default_rng(1).normal(0.0, noise, 40), RATE)
    assert step_of(compared(power, power + load * later(20, len(power)) + scatter), BEGIN) is None


def test_a_load_that_switches_every_ten_seconds_is_found() -> None:
    power = predicted()
    load = 300.0 * (np.arange(len(power)) // (10 * RATE) % 2)
    found = step_of(compared(power, power + load), BEGIN)
    assert found is not None
    assert abs(found.evidence) == pytest.approx(300.0, rel=0.1)


def test_a_robot_that_begins_to_move_is_no_step_though_its_losses_are_wrong() -> None:
    power = np.where(later(20, 40 * RATE) > 0, predicted(), 400.0)
    assert step_of(compared(power, 150.0 + 1.6 * power), BEGIN) is None


def test_a_model_that_is_off_by_more_shows_no_step() -> None:
    power = predicted()
    wrong = np.where(later(20, len(power)) > 0, 0.8, 0.6)  # as of axes that move there alone
    assert step_of(compared(power, wrong * power), BEGIN) is None


def test_a_robot_that_warms_up_under_a_slow_meter_is_no_step() -> None:
    count = 60
    power = np.full(count, 1000.0)
    warm = power * (1.0 + 0.6 * np.exp(-np.arange(count) / 10.0))
    assert step_of(compared(power, warm, apart=30 * RATE), BEGIN) is None


@pytest.mark.parametrize("missing", [60, 1800])
def test_a_robot_that_is_warm_after_a_gap_is_no_step(missing: int) -> None:
    power = predicted()
    warm = later(20, len(power)) > 0
    cut = compared(power, np.where(warm, power, power + 300.0))
    assert step_of(cut, BEGIN) is not None  # without the gap
    stamp = cut.stamp_ns + np.where(warm, missing * SECOND_NS, 0)
    assert step_of(replace(cut, stamp_ns=stamp), BEGIN) is None


def test_a_step_is_found_in_seconds_of_which_some_are_missing() -> None:
    power = predicted(80)
    cut = compared(power, power + 300.0 * later(40, len(power)))
    assert step_of(cut[(cut.stamp_ns // SECOND_NS) % 3 > 0], BEGIN) is not None


def test_seconds_of_a_cut_input_differ_by_rounding_alone() -> None:
    power = predicted()
    whole = compared(power, power)
    parts = [by_second(whole[slice(at, at + 37)]) for at in range(0, len(power), 37)]
    again, once = by_second(Compared.concatenate(parts)), by_second(whole)
    assert np.array_equal(again.stamp_ns, once.stamp_ns)
    assert np.array_equal(again.duration_ns, once.duration_ns)
    assert again.measured == pytest.approx(once.measured, rel=1e-12)


def test_a_load_that_rises_slowly_is_no_step_but_a_drift() -> None:
    power = predicted()
    rising = power + 400.0 * np.linspace(-0.5, 0.5, len(power))
    found = drift_of(compared(power, rising))
    assert step_of(compared(power, rising), BEGIN) is None
    assert found is not None
    assert found.evidence == pytest.approx(300.0, rel=0.05)
    assert found.sentence.startswith("the meter reads 299 W more in the last quarter")
    falling = drift_of(compared(power, 2.0 * power - rising))
    assert falling is not None
    assert "W less in the last quarter" in falling.sentence
    assert drift_of(compared(power, power)) is None
    assert drift_of(compared(power, 1.3 * rising)) is None  # the model does not fit at all


@pytest.mark.parametrize("factor", [0.25, 2.0])
def test_a_drift_is_what_the_meter_reads_more_in_the_last_quarter(factor: float) -> None:
    power = np.full(100 * RATE, 300.0)
    measured = power * np.where(later(75, len(power)) > 0, factor, 1.0)
    found = drift_of(compared(power * measured.sum() / power.sum(), measured))
    assert found is not None
    assert found.evidence == pytest.approx((factor - 1.0) * 300.0, rel=0.02)
    assert f"reads {abs(found.evidence):.0f} W" in found.sentence


def test_a_drift_is_of_like_powers() -> None:
    """A rest that reads less than the model has is compared with a rest of the first quarter."""
    rest = later(75, 100 * RATE)
    power = np.where(rest > 0, 250.0, np.resize(predicted(), len(rest)))
    assert drift_of(compared(power, power - 170.0 * rest)) is None
    rested = np.where(later(10, len(rest)) > 0, power, 250.0)  # as in the first quarter
    found = drift_of(compared(rested, rested - 170.0 * rest))
    assert found is not None
    assert found.evidence == pytest.approx(-170.0, rel=0.05)


def test_a_quarter_of_two_seconds_shows_no_drift() -> None:
    power = predicted(100)
    drifting = compared(power, power + 600.0 * later(75, len(power)))
    assert drift_of(drifting) is not None
    second = (drifting.stamp_ns - BEGIN) // SECOND_NS
    assert drift_of(drifting[(second < 76) | (second == 99)]) is None
