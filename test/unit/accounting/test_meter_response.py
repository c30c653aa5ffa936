"""A prediction as a meter shows it: closed forms, another solver, cutting, lags found online."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter, lsim

from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.meter_checks import MeterDiagnostics
from robot_energy.accounting.meter_response import MAX_LAG, LagEstimate, MeterResponse, ShownPower
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning
from robot_energy.timeline.pieces import Compared

SECOND = 10**9
MS = 1_000_000
RATE = 50  # samples a second


def followed(stamp_s, power, constant, delay=0.0, begins=()) -> ShownPower:
    """Samples that a meter follows."""
    shown = ShownPower(delay)
    stamp = np.rint(np.asarray(stamp_s) * SECOND).astype(np.int64)
    first = np.zeros(len(stamp), dtype=bool)
    first[list(begins)] = True
    shown.waiting.append((stamp, np.asarray(power, dtype=float), first))
    shown.follow([], [constant])
    return shown


def energy(shown, edges_s, drawn=0.0):
    """What the meter shows between edges."""
    edges = np.rint(np.asarray(edges_s) * SECOND).astype(np.int64)
    return shown.energy(np.full(len(edges) - 1, drawn), edges[:-1], edges[1:])


@pytest.mark.parametrize("delay", [0.0, 0.13])
def test_a_ramp_is_shown_as_its_closed_form_says(delay):
    """y = s (t - T + T exp(-t / T)) for p = s t, from rest; its integral by hand."""
    slope, slow = 200.0, 0.3
    shown = followed([0.0, 0.4, 1.0, 2.0], slope * np.array([0.0, 0.4, 1.0, 2.0]), slow, delay)
    edges = np.array([0.0, 0.05, 0.4, 0.73, 1.0, 1.999, 2.0])
    since = np.maximum(edges - delay, 0.0)
    whole = slope * (since**2 / 2 - slow * since - slow**2 * np.expm1(-since / slow))
    assert energy(shown, edges) == pytest.approx(np.diff(whole), rel=1e-9, abs=1e-6)


def test_a_jagged_power_is_shown_as_another_solver_says():
    random = np.random.default_rng(1)
    slow, fine = 0.28, np.arange(0.0, 20.0, 1e-4)
    stamp = np.unique(np.round(np.cumsum(random.uniform(0.002, 0.3, 200)), 3))
    stamp = np.concatenate([[0.0], stamp[stamp < 19.0], [20.0]])
    power = random.uniform(-500.0, 3000.0, len(stamp))
    drawn = np.interp(fine, stamp, power)
    _, y, _ = lsim(([1.0], [slow, 1.0]), drawn - power[0], fine)
    shown = y + power[0]
    whole = np.concatenate([[0.0], np.cumsum((shown[1:] + shown[:-1]) / 2 * 1e-4)])
    edges = np.arange(0.0, 19.0, 0.1)
    expected = np.diff(np.interp(edges, fine, whole))
    assert energy(followed(stamp, power, slow), edges) == pytest.approx(expected, abs=1e-3)


def test_a_step_has_an_end_where_two_samples_have_one_stamp():
    shown = followed([0.0, 1.0, 1.0, 3.0], [100.0, 100.0, 500.0, 500.0], 0.5)
    missed = 400.0 * 0.5 * (1.0 - np.exp(-2.0 / 0.5))
    assert energy(shown, [0.0, 1.0, 3.0]) == pytest.approx([100.0, 1000.0 - missed])


@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_every_stretch_of_known_power_begins_settled(delay):
    shown = followed([0.0, 1.0, 5.0, 6.0], [0.0, 900.0, 300.0, 300.0], 0.5, delay, begins=[2])
    assert energy(shown, [5.0, 5.2, 6.0]) == pytest.approx([60.0, 240.0])


def test_a_sample_of_no_number_begins_another_stretch():
    shown = followed(np.arange(6), [9.0, 9.0, np.nan, 5.0, 5.0, 5.0], 0.5, begins=[2, 3])
    assert energy(shown, [3.0, 4.0, 5.0]) == pytest.approx([5.0, 5.0])


def test_without_a_response_the_meter_shows_what_is_drawn():
    drawn = np.array([1.0, 2.0])
    shown = followed([0.0, 1.0, 2.0], [0.0, 2.0, 2.0], 0.0)
    edges = np.arange(3) * SECOND
    assert shown.energy(drawn, edges[:-1], edges[1:]) is drawn


def readings(power, first=0, meaning=MeterMeaning.MEAN_OVER_INTERVAL) -> MeterBlock:
    """Ten a second, means of samples."""
    means = power.reshape(-1, RATE // 10).mean(axis=1)
    stamp = first * SECOND + (np.arange(len(means)) + 1) * 100 * MS
    counter = meaning is MeterMeaning.CUMULATIVE
    nothing = np.full(len(means), np.nan)
    return MeterBlock(
        stamp,
        nothing if counter else means,
        np.cumsum(means * 0.1) if counter else nothing,
        nothing if counter else np.full(len(means), 0.1),
        meaning,
        MeterLocation.GRID,
    )


def work(seconds, seed=3):
    """A power that steps every second, and what a low pass of 0.3 s shows of it."""
    power = np.repeat(np.random.default_rng(seed).uniform(100.0, 900.0, seconds), RATE)
    kept = np.exp(-1.0 / RATE / 0.3)
    return power, lfilter([1.0 - kept], [1.0, -kept], power, zi=[kept * power[0]])[0]


def compared(comparison, power, cuts=(), first=0) -> Compared:
    """What becomes comparable where power arrives in pieces."""
    stamp = first * SECOND + np.arange(len(power)) * (SECOND // RATE)
    bounds = [0, *cuts, len(power)]
    segment = np.zeros(len(power), dtype=np.int64)
    return Compared.concatenate(
        [
            comparison.predict(stamp[start:stop], segment[start:stop], power[start:stop])
            for start, stop in pairwise(bounds)
        ]
    )


def off(found: Compared) -> float:
    """RMS of the residual. [W]"""
    seconds = found.duration_ns * 1e-9
    return float(np.sqrt(np.sum((found.predicted - found.measured) ** 2 / seconds) / seconds.sum()))


def test_a_stated_low_pass_takes_the_meter_out_of_the_residual_and_no_energy():
    power, shown = work(60)
    plain, stated = Comparison(response=MeterResponse()), Comparison(
        response=MeterResponse(0.3, stated=True)
    )  # fmt: skip
    for each in (plain, stated):
        each.measure(readings(shown))
    before, after = compared(plain, power), compared(stated, power)
    assert off(before) > 100.0
    assert off(after) < 0.12 * off(before)  # samples of 20 ms are not quite steps
    assert (after.drawn == before.predicted).all()
    assert stated.predicted_energy == plain.predicted_energy
    assert stated.measured_energy == plain.measured_energy


@pytest.mark.parametrize("response", [None, MeterResponse(0.3, 0.07, stated=True)])
def test_how_the_input_is_cut_makes_no_difference(response):
    random = np.random.default_rng(4)
    power, shown = work(180)
    power[random.choice(len(power), 50)] = np.nan
    found = []
    for cuts in ((), sorted(random.choice(len(power), 400, replace=False))):
        comparison = Comparison(response=response)
        comparison.measure(readings(shown))
        found.append(compared(comparison, power, cuts))
        assert comparison.response.stated is (response is not None)
    assert comparison.response.time_constant > 0.2
    edges = [np.cumsum(each.duration_ns) for each in found]
    assert np.isin(edges[0], edges[1]).all()
    place = np.searchsorted(edges[0], edges[1])
    for name in ("drawn", "predicted"):
        joined = np.bincount(place, getattr(found[1], name))
        np.testing.assert_allclose(joined, getattr(found[0], name), rtol=1e-9, atol=1e-9)


def test_where_the_meter_is_ahead_of_the_prediction_no_sample_is_kept_for_long():
    """As with a wide derivative window: every sample is compared in the step that brings it."""
    power, shown = work(600)
    for _ in range(2):  # what Python and numpy keep once and for all is there after the first
        comparison = Comparison(response=MeterResponse(0.3, stated=True))
        comparison.measure(readings(shown))
        tracemalloc.start()
        compared(comparison, power, range(RATE, len(power), RATE))
        held = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
    assert comparison.compared_ns > 590 * SECOND
    assert held < len(power) * 8  # a sixth of what all samples take


def test_a_lag_that_nobody_states_is_found_and_used_from_then_on():
    power, shown = work(240)
    comparison = Comparison()
    comparison.measure(readings(shown))
    found = compared(comparison, power)
    late = found.stamp_ns > 120 * SECOND
    assert comparison.response.time_constant == pytest.approx(0.3, abs=0.03)
    early = found.stamp_ns < 60 * SECOND
    np.testing.assert_allclose(found.predicted[early], found.drawn[early], rtol=1e-9)
    assert off(found[late]) < 0.2 * off(found[early])


def test_a_meter_without_a_lag_is_given_none():
    power, _ = work(240)
    comparison = Comparison()
    noise = np.random.default_rng(5).normal(0.0, 20.0, len(power))
    comparison.measure(readings(power + noise))
    compared(comparison, power)
    assert comparison.response.time_constant < 0.02


def test_a_counter_shows_what_is_drawn():
    power, _ = work(30)
    comparison = Comparison(response=MeterResponse(0.3, stated=True))
    comparison.measure(readings(power, meaning=MeterMeaning.CUMULATIVE))
    found = compared(comparison, power)
    assert len(found)
    assert (found.predicted == found.drawn).all()
    assert comparison.response == MeterResponse(stated=True)


def test_a_jump_back_of_the_clock_keeps_the_lag():
    power, shown = work(120)
    comparison = Comparison()
    for _ in range(2):
        comparison.measure(readings(shown))
        found = compared(comparison, power)
    early = found.stamp_ns < 30 * SECOND
    assert off(found[early]) < 50.0


def test_a_later_run_begins_with_the_windows_of_an_earlier_one():
    estimate = LagEstimate()
    steps = np.random.default_rng(6).normal(0.0, 500.0, 60)
    estimate.begin([(0.25 * step + 40.0, step) for step in steps.tolist()])
    assert estimate.lags == [pytest.approx(0.25)]
    estimate.begin([(5.0 * step, step) for step in steps.tolist()] * 2)
    assert estimate.lags[-1] <= MAX_LAG


def against_late_meter(stamp, power, cut=1, response=None):
    """A comparison of a power with a meter that is 0.28 s late and reads at every stamp."""
    kept = np.exp(-(stamp[1] - stamp[0]) / SECOND / 0.28)
    shown = power[0] + lfilter([1.0 - kept], [1.0, -kept], power - power[0])
    comparison = Comparison(response=response)
    nothing = np.full(len(stamp), np.nan)
    for rows in np.array_split(np.arange(len(stamp)), cut):
        comparison.measure(
            MeterBlock(stamp[rows], shown[rows], nothing[rows], nothing[rows],
                       MeterMeaning.INSTANTANEOUS, MeterLocation.GRID)
        )  # fmt: skip
        comparison.predict(stamp[rows], np.zeros(len(rows), dtype=np.int64), power[rows])
    return comparison


def stepping(seconds):
    """Stamps at 50 Hz, and a power that steps every 1.7 s."""
    fine = np.arange(0.0, seconds + 1e-9, 0.02)
    power = 1500.0 + 1500.0 * np.sign(np.sin(2.0 * np.pi * (fine + 0.05) / 3.4))
    return np.rint(fine * SECOND).astype(np.int64), power


def compared_for(seconds, cut=1, response=None):
    return against_late_meter(*stepping(seconds), cut, response)


def test_energies_are_set_against_each_other_once_the_lag_hardly_matters():
    """In the first seconds the difference is the lag: -10 % after 2 s, of a perfect model."""
    late = MeterResponse(0.28, stated=True)
    early = compared_for(2.0, response=late)
    assert abs(early.predicted_energy / early.measured_energy - 1.0) > 0.1
    assert np.isnan(early.comparable_energy)
    now = compared_for(45.0, response=late)
    assert now.comparable_energy == now.predicted_energy
    for seconds in np.arange(2.0, 45.0, 0.5):
        one = compared_for(seconds, response=late)
        if not np.isnan(one.comparable_energy):
            assert one.predicted_energy == pytest.approx(one.measured_energy, rel=0.02)
    now.reset()
    assert np.isnan(now.comparable_energy)


def test_a_lag_that_is_not_known_may_be_as_long_as_any():
    assert np.isnan(compared_for(45.0).comparable_energy)
    assert not np.isnan(compared_for(70.0).comparable_energy)  # found from a minute of readings


@pytest.mark.parametrize(
    ("power", "rate"), [(1500.0, 50), (20.0, 500), (60.2, 1000), (60.215, 1000), (3333.3, 1000)]
)
def test_a_robot_at_rest_is_compared_at_once(power, rate):
    stamp = np.arange(rate // 2 + 1) * (SECOND // rate)
    found = against_late_meter(stamp, np.full(len(stamp), power))
    assert found.comparable_energy == pytest.approx(0.5 * power, rel=1e-6)


@pytest.mark.parametrize("rate", [100, 500, 1000])
def test_a_small_step_of_the_power_is_waited_for(rate):
    """The meter has shown 4 % less than was drawn 0.3 s after a step from 55 to 65 W."""
    stamp = np.arange(8 * rate // 10 + 1) * (SECOND // rate)
    power = np.where(stamp > SECOND // 2, 65.0, 55.0)
    found = against_late_meter(stamp, power)
    assert found.predicted_energy > 1.03 * found.measured_energy
    assert np.isnan(found.comparable_energy)
    std = np.std(0.5 * (power[1:] + power[:-1]))
    assert found.late_energy == pytest.approx(MAX_LAG * 1.645 * np.sqrt(2.0) * std, rel=1e-3)


def test_a_counter_is_compared_at_once():
    stamp, power = stepping(2.0)
    counted = np.concatenate([[0.0], np.cumsum(0.01 * (power[1:] + power[:-1]))])
    nothing, comparison = np.full(len(stamp), np.nan), Comparison()
    comparison.measure(
        MeterBlock(stamp, nothing, counted, nothing, MeterMeaning.CUMULATIVE, MeterLocation.GRID)
    )
    comparison.predict(stamp, np.zeros(len(stamp), dtype=np.int64), power)
    assert comparison.comparable_energy == pytest.approx(counted[-1], rel=1e-6)


def test_the_cutting_of_the_input_does_not_decide_what_is_set_against_each_other():
    sums = [compared_for(20.0, cut).swing for cut in (1, 3, 50)]
    assert sums[0] == sums[1] == sums[2]


def still(power, swing=1500.0, cut=1):
    """Readings at 10 Hz of a robot whose predicted power steps every 1.7 s."""
    stamp = np.rint(np.arange(0.0, len(power) / 10.0, 0.1) * SECOND).astype(np.int64)
    predicted = 1500.0 + swing * np.sign(np.sin(2.0 * np.pi * (stamp / SECOND + 0.05) / 3.4))
    comparison, nothing = Comparison(response=MeterResponse()), np.full(len(stamp), np.nan)
    for rows in np.array_split(np.arange(len(stamp)), min(cut, len(stamp))):
        comparison.measure(
            MeterBlock(stamp[rows], power[rows], nothing[rows], nothing[rows],
                       MeterMeaning.INSTANTANEOUS, MeterLocation.GRID)
        )  # fmt: skip
        comparison.predict(stamp[rows], np.zeros(len(rows), dtype=np.int64), predicted[rows])
    return comparison


@pytest.mark.parametrize("cut", [1, 7, 300])
@pytest.mark.parametrize("value", [743.0, 0.0])
def test_a_meter_that_repeats_a_reading_while_the_robot_works_is_named(value, cut):
    power = 1500.0 + 100.0 * np.random.default_rng(1).standard_normal(300)
    power[100:220] = value
    one = still(power, cut=cut)
    (said,) = MeterDiagnostics().findings(one, ended=True)
    assert said.startswith(f"the meter reads the same {value:g} W for 12 s")
    assert MeterDiagnostics().findings(one) == []  # it goes on again
    (now,) = MeterDiagnostics().findings(still(power[:220], cut=cut))
    assert now.startswith(f"the meter reads the same {value:g} W for 12 s")


def test_equal_readings_of_a_robot_at_rest_or_for_a_moment_are_none_of_a_meter_that_stands_still():
    assert MeterDiagnostics().findings(still(np.full(300, 1400.0), swing=0.0), ended=True) == []
    power = 1500.0 + 100.0 * np.random.default_rng(1).standard_normal(300)
    power[100:170] = 743.0
    assert MeterDiagnostics().findings(still(power), ended=True) == []
