"""Calibrated bands: shares of readings within them, restarts, cutting, place of the meter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from accounts import IDENTITY, NAMES, SECOND, power_block, restarted, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.certainty.band_calibration import MIN_STEP
from robot_energy.certainty.deviation import CABINET_DEVIATIONS, FORM, LOSS_GRID, Z90, BandKind
from robot_energy.certainty.energy_calibration import BIAS, DISTINCT, EnergyCalibration
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning

RATE = 50  # samples a second
READINGS = 10  # a second


def readings(
    seconds: int, error, location=MeterLocation.GRID, first: float = 0.0, rate: int = READINGS
) -> MeterBlock:
    """Means of 100 W and an error."""
    stamp = round(first * SECOND) + (np.arange(seconds * rate) + 1) * (SECOND // rate)
    nothing = np.full(len(stamp), np.nan)
    watts = 100.0 + np.broadcast_to(error, len(stamp))
    interval = np.full(len(stamp), 1.0 / rate)
    return MeterBlock(stamp, watts, nothing, interval, MeterMeaning.MEAN_OVER_INTERVAL, location)


def counted(error, seconds=900, cuts=(), location=MeterLocation.GRID):
    """An account of 100 W that is compared with a meter, and its means."""
    account = EnergyAccount(len(NAMES))
    account.measure(readings(seconds, error, location))
    block = steady(0, seconds, 100.0, RATE)
    bounds = [0, *cuts, len(block)]
    means = [account.step(block[slice(start, stop)]) for start, stop in pairwise(bounds)]
    return account, MeanBlock.concatenate([one for one in means if one is not None])


@pytest.mark.parametrize("size", [0.5, 30.0])
def test_nine_of_ten_readings_lie_within_the_band_whatever_their_errors(size):
    rng = np.random.default_rng(1)
    error = size * rng.standard_t(3, 9000)
    account, means = counted(error)
    late = means.stamp_ns > 300 * SECOND
    assert (means.band[late] == BandKind.CALIBRATED).all()
    held = (
        np.abs(error[3000:])[:, None]
        <= np.interp(np.arange(3000, 9000), means.stamp_ns * READINGS / SECOND, means.band_half)[
            :, None
        ]
    )
    assert held.mean() == pytest.approx(0.9, abs=0.02)
    calibration = account.calibration
    readings, inside, _ = calibration.counts.sum(axis=0)
    assert inside / readings == pytest.approx(0.9, abs=0.03)


def test_a_band_follows_errors_that_become_four_times_as_large_within_seconds():
    """As those of a robot that is started much colder than it was before."""
    error = np.random.default_rng(3).normal(0.0, 5.0, 9000)
    error[6000:] *= 4.0
    before, _ = counted(error[:6000], 600)
    after, means = counted(error)
    counts = after.calibration.counts - before.calibration.counts
    readings_after, inside = counts[:, :2].sum(axis=0)
    assert readings_after == pytest.approx(3000, abs=20)
    assert 0.87 <= inside / readings_after <= 0.93
    first_seconds = (means.stamp_ns > 605 * SECOND) & (means.stamp_ns < 630 * SECOND)
    assert np.median(means.band_half[first_seconds]) > 0.8 * Z90 * 20.0


def test_the_band_is_that_of_the_figures_until_a_meter_is_read():
    account = EnergyAccount(len(NAMES))
    means = account.step(steady(0, 10, 100.0, RATE))
    assert means is not None
    assert (means.band == BandKind.PARAMETRIC).all()
    # loss_dc 3 W, loss_grid 4 W and two axes of 2 W each, independent
    half = means.band_half[means.period > 0]
    assert half == pytest.approx(Z90 * np.sqrt(9.0 + 16.0 + 4.0 + 4.0))
    band = account.energy_band
    assert band.kind is BandKind.PARAMETRIC
    assert band.std == pytest.approx(10.0 * np.sqrt(33.0 + 25.0))  # form 5 W
    assert band.half == pytest.approx(Z90 * band.std)


def deviation_of(missed: float, distinct: float = DISTINCT) -> float:
    """Power of 100 W: figures 33 W^2, seen as one sum in every window, form 5 W off by `missed`.

    One column of windows: 1 / (1 / 33 + D / (missed 25)), the variances of two sources combined.
    """
    return float(np.sqrt(1.0 / (1.0 / 33.0 + distinct / (25.0 * missed)) + 25.0 * missed))


def test_a_bias_widens_the_band_of_energies_and_its_absence_narrows_it():
    """20 W are m = 4 times the form's 5 W."""
    account, _ = counted(20.0)
    band = account.energy_band
    assert band.kind is BandKind.CALIBRATED
    expected = Z90 * deviation_of((BIAS + 16.0) / 2.0) * 900
    assert band.half == pytest.approx(expected, rel=0.01)
    assert band.half > 20.0 * 900  # the same work goes on
    exact, _ = counted(0.0)
    assert exact.energy_band.half == pytest.approx(Z90 * deviation_of(BIAS / 2.0) * 900, rel=0.01)
    assert exact.energy_band.half > 0.0


def test_repeating_a_program_does_not_narrow_the_band_of_energies():
    """Errors of -30 and +30 W in turn cancel over a program; other work has other motions."""
    per_window = 5 * READINGS
    error = np.tile(np.repeat([30.0, -30.0], per_window), 9000 // (2 * per_window))
    once, often = counted(error[:1800], 180)[0].energy_band, counted(error)[0].energy_band
    expected = Z90 * deviation_of(BIAS / 2.0 + 36.0 / DISTINCT)
    assert once.half / 180 == pytest.approx(expected, rel=0.05)
    assert often.half / 900 == pytest.approx(expected, rel=0.05)


def test_a_low_pass_of_the_meter_does_not_widen_the_band_of_energies():
    """It shows later what is drawn now, so it moves energy from one window to the next."""
    rng = np.random.default_rng(3)
    seconds, constant = 600, 0.3
    power = np.repeat(rng.uniform(20.0, 400.0, seconds), RATE)
    kept = np.exp(-1.0 / RATE / constant)
    late = lfilter([1.0 - kept], [1.0, -kept], power)
    bands = []
    for shown in (power, late):
        account = EnergyAccount(len(NAMES))
        means = shown.reshape(-1, RATE // READINGS).mean(axis=1)
        account.measure(readings(seconds, means - 100.0))
        account.step(power_block(np.arange(len(power)) * (SECOND // RATE), power))
        bands.append(account.energy_band.half)
    assert bands[1] == pytest.approx(bands[0], rel=0.1)


def test_figures_that_no_window_showed_keep_their_deviation():
    columns = len(CABINET_DEVIATIONS)
    seen, unseen = np.zeros(columns + 4), np.zeros(columns + 4)
    seen[columns], unseen[columns + 1] = 100.0, 100.0
    seen[FORM] = unseen[FORM] = 20.0
    calibration = EnergyCalibration()
    for _ in range(60):
        calibration.take(seen, 0.0, 0.0, at_bus=False)
    missed = BIAS / 2.0 * 20.0**2
    known = np.sqrt(1.0 / (1.0 / 100.0**2 + DISTINCT / missed) + missed)
    assert calibration.half(seen) == pytest.approx(Z90 * known)
    assert calibration.half(unseen) == pytest.approx(Z90 * np.sqrt(100.0**2 + missed))


def test_how_the_input_is_cut_makes_no_difference():
    rng = np.random.default_rng(2)
    error = rng.normal(0.0, 10.0, 9000)
    whole, means = counted(error)
    cut, means_cut = counted(error, cuts=sorted(rng.choice(45_000, 300, replace=False)))
    assert whole.state(IDENTITY) == cut.state(IDENTITY)
    np.testing.assert_array_equal(means.band, means_cut.band)
    np.testing.assert_allclose(means.band_half, means_cut.band_half, rtol=1e-12)


def work(random, moves: int, rest: float):
    """Power of motions of half a second to three, with rests, and what a low pass of it shows."""
    parts = []
    for seconds in random.uniform(0.5, 3.0, moves):
        parts.append(np.full(round(seconds * RATE), random.uniform(200.0, 900.0)))
        parts.append(np.full(round(rest * RATE), 100.0))
    power = np.concatenate(parts)
    power = power[: len(power) // RATE * RATE]
    kept = np.exp(-1.0 / RATE / 0.3)
    part = (1.0 - kept) * RATE * 0.3  # of a step that is straight between two samples
    shown = lfilter([1.0 - part, part - kept], [1.0, -kept], power)
    return power, 0.5 * (shown + np.append(shown[1:], shown[-1]))


def worked(account, first: int, power, shown, cuts=()):
    """Let an account see such work from a second on; return where it ends, and its means."""
    means = shown.reshape(-1, RATE // READINGS).mean(axis=1)
    account.measure(readings(len(power) // RATE, means - 100.0, first=first))
    block = power_block(first * SECOND + np.arange(len(power)) * (SECOND // RATE), power)
    bounds = [0, *cuts, len(block)]
    found = [account.step(block[slice(start, stop)]) for start, stop in pairwise(bounds)]
    return first + len(power) // RATE, MeanBlock.concatenate([m for m in found if m is not None])


def test_the_band_of_power_behind_a_low_pass_holds_for_work_with_shorter_rests():
    """The low pass is in the prediction, so the noise of the meter is left."""
    random = np.random.default_rng(5)
    account = EnergyAccount(len(NAMES), response=MeterResponse(0.3, stated=True))

    def noisy(moves, rest):
        power, shown = work(random, moves, rest)
        each = random.normal(1.0, 0.1, len(power) * READINGS // RATE)
        return power, shown * np.repeat(each, RATE // READINGS)

    first, means = worked(account, 0, *noisy(230, 1.0))
    noise, calibration = np.nanmedian(means.band_half[-RATE * 60 :]), account.calibration
    readings, inside, _ = calibration.counts.sum(axis=0)
    assert inside / readings == pytest.approx(0.9, abs=0.01)
    _, means = worked(account, first, *noisy(60, 0.1))
    later, still, _ = calibration.counts.sum(axis=0)
    share = (still - inside) / (later - readings)
    assert 0.87 <= share <= 0.93
    off = np.abs(means.predicted_power_at_meter - means.measured_power)
    known = np.isfinite(off)
    assert (off <= means.band_half)[known].mean() > 0.75  # each is that of the reading before
    assert noise < 120.0  # steps have 100 to 800 W


def test_how_the_input_is_cut_makes_no_difference_behind_a_low_pass():
    random = np.random.default_rng(6)
    power, shown = work(random, 60, 0.5)
    whole, cut = EnergyAccount(len(NAMES)), EnergyAccount(len(NAMES))
    _, means = worked(whole, 0, power, shown)
    cuts = sorted(random.choice(len(power), 200, replace=False))
    _, means_cut = worked(cut, 0, power, shown, cuts)
    assert whole.state(IDENTITY) == cut.state(IDENTITY)
    np.testing.assert_array_equal(means.band, means_cut.band)
    np.testing.assert_allclose(means.band_half, means_cut.band_half, rtol=1e-12)


def test_readings_of_a_fast_meter_count_from_the_same_second_however_the_input_is_cut():
    """A group of readings that ends at a whole second is complete with the first one after it."""
    random = np.random.default_rng(7)
    error = random.normal(0.0, 10.0, 120 * RATE)
    bands = []
    for cuts in ((), range(RATE, 120 * RATE, RATE // 2)):
        account = EnergyAccount(len(NAMES))
        account.measure(readings(120, error, rate=RATE))
        block = steady(0, 120, 100.0, RATE)
        parts = pairwise([0, *cuts, len(block)])
        means = [account.step(block[slice(start, stop)]) for start, stop in parts]
        bands.append(MeanBlock.concatenate([m for m in means if m is not None]).band_half)
    np.testing.assert_allclose(bands[0], bands[1], rtol=1e-12)


def test_a_restart_keeps_the_calibration():
    account, _ = counted(20.0)
    fresh = restarted(account)
    assert fresh.energy_band == account.energy_band
    means = fresh.step(steady(901, 911, 100.0, RATE))  # without a meter
    assert means is not None
    assert (means.band == BandKind.CALIBRATED).all()
    half = means.band_half[means.period > 0]
    # the error of the readings before, within a step of the scale
    assert half == pytest.approx(20.0, rel=MIN_STEP)


def test_a_meter_on_the_dc_bus_says_nothing_of_the_loss_before_it():
    account, means = counted(-30.0, location=MeterLocation.DC_BUS)
    assert means.band[-1] == BandKind.CALIBRATED  # 30 W lie before the bus: no error there
    loss = Z90 * means.deviation[-1, LOSS_GRID]
    assert means.band_half[-1] >= loss
    assert means.band_half[-1] == pytest.approx(loss, rel=0.2)
    assert account.energy_band.half >= loss * 900


def test_a_jump_back_of_the_stamps_scores_nothing_across_it():
    account = EnergyAccount(len(NAMES))
    account.measure(readings(60, 5.0))
    account.step(steady(0, 60, 100.0, RATE))
    before = account.calibration.counts[:, 0].sum()
    assert before > 500
    again = power_block(np.arange(500, 1000) * (SECOND // RATE), np.full(500, 100.0), segment=1)
    account.step(again)
    assert account.calibration.counts[:, 0].sum() <= before + 1
