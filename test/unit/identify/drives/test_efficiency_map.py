"""Reduced efficiency maps of a hand-made drive whose efficiency is known everywhere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.physics.drives_and_cabinet import EfficiencyMaps
from robot_energy_identify.drives.drive_data import DriveData
from robot_energy_identify.drives.efficiency_map import (
    MIN_EFFICIENCY,
    processed,
    reduced_map,
    smooth,
    without_outliers,
)

PERIOD = 0.004
MOTOR, GENERATOR = 0.8, 1.25  # P_mech / P_el: 1 / 1.25 of what brakes comes back


def drive(seconds=60.0):
    """Slow sweep of all quadrants; true efficiencies by mode, and by speed in motor mode."""
    time = np.arange(0.0, seconds, PERIOD)
    torque = 2.0 * np.sin(0.7 * time) + 0.5
    velocity = 100.0 * np.sin(0.45 * time + 0.3)
    shaft = torque * velocity
    eta = np.where(shaft >= 0, MOTOR - 0.2 * np.abs(velocity) / 100.0, GENERATOR)
    return torque, velocity, shaft / eta, eta


def make(torque, velocity, power, rows=None, **options):
    size = len(torque)
    rows = np.ones(size, dtype=bool) if rows is None else rows
    stamp, none = np.rint(np.arange(size) * PERIOD * 1e9).astype(np.int64), np.zeros(size, int)
    columns = (values[:, None] for values in (velocity, torque, np.full(size, 20.0), power))
    braking, shares = np.zeros(size, bool), torque[:, None]
    data = DriveData(("axis",), stamp, none, none, *columns, (None,), (), braking, shares)
    return reduced_map(data, 0, rows, **options)


def test_the_known_map_comes_back_in_four_quadrants():
    torque, velocity, power, _ = drive()
    found = make(torque, velocity, power)
    at_torque, at_speed = (
        np.asarray(found.entry.motor_torque),
        np.asarray(found.entry.motor_velocity),
    )
    for sign in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        rows = (at_torque * sign[0] > 0.6) & (at_speed * sign[1] > 30.0)
        assert rows.sum() > 20, sign
        expected = np.where(
            at_torque * at_speed > 0, MOTOR - 0.2 * np.abs(at_speed) / 100.0, GENERATOR
        )
        error = np.asarray(found.entry.efficiency)[rows] - expected[rows]
        assert np.median(np.abs(error)) < 0.01
    assert len(at_torque) <= 500
    assert found.generator_efficiency == pytest.approx(GENERATOR, abs=0.02)


def test_the_map_runs_in_the_drive_model():
    torque, velocity, power, _ = drive()
    entry = make(torque, velocity, power).entry
    columns = [array[:, None] for array in (torque * velocity, velocity, torque, torque)]
    predicted, extrapolated = EfficiencyMaps([entry]).input_power(*columns)
    assert predicted[:, 0].sum() == pytest.approx(power.sum(), rel=0.02)
    assert extrapolated.mean() < 0.01


def test_absurd_values_of_the_measured_power_do_not_reach_the_map():
    torque, velocity, power, _ = drive()
    lost = np.random.default_rng(3).random(len(power)) < 0.01
    dirty = np.where(lost, power * 0.02, power)  # efficiencies of 30 to 60
    clean, found = make(torque, velocity, power), make(torque, velocity, dirty)
    assert found.removed >= clean.removed + 0.005
    error = np.asarray(found.entry.efficiency) - np.asarray(clean.entry.efficiency)
    assert np.median(np.abs(error)) < 0.003


def test_outliers_are_those_beyond_three_scaled_deviations():
    """Median 0, median deviation 1, scaled by 1.4826: the limit is 4.4478."""
    values = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0, 4.4, -4.5, np.nan])
    kept = np.isfinite(without_outliers(values))
    assert kept.tolist() == [True] * 8 + [False, False]


def test_gaps_are_straight():
    line = np.linspace(0.0, 3.0, 1000)
    holed = line.copy()
    holed[400:460] = np.nan
    result = smooth(holed, np.zeros(1000, dtype=np.int64), PERIOD, 5.0)
    assert np.abs(result - line)[50:-50].max() < 5e-3


def test_the_filter_takes_noise_and_shifts_nothing():
    time = np.arange(0.0, 20.0, PERIOD)
    signal = np.sin(2 * np.pi * 0.2 * time)
    noisy = signal + 0.3 * np.sin(2 * np.pi * 60.0 * time)
    result = smooth(noisy, np.zeros(len(time), dtype=np.int64), PERIOD, 5.0)
    assert np.abs(result - signal)[250:-250].max() < 1e-3


def test_one_stretch_does_not_leak_into_the_next():
    values = np.concatenate([np.zeros(300), np.full(300, 7.0)])
    stretch = np.repeat([0, 1], 300)
    np.testing.assert_allclose(smooth(values, stretch, PERIOD, 5.0), values, atol=1e-9)


def test_samples_that_are_held_out_are_not_used():
    torque, velocity, power, _ = drive()
    rows = np.arange(len(power)) < 8000
    spoiled = np.where(rows, power, 1e5)
    assert make(torque, velocity, spoiled, rows).entry == make(torque, velocity, power, rows).entry


def test_rest_is_no_efficiency():
    """Four fifths of the time standing under load: the median of all would be 0."""
    torque, velocity, power, _ = drive()
    stands = np.full(4 * len(power), 20.0)
    held = make(
        np.concatenate([torque, np.full(len(stands), 1.0)]),
        np.concatenate([velocity, np.zeros(len(stands))]),
        np.concatenate([power, stands]),
    )
    assert held.samples <= len(power)
    assert held.motor_efficiency == pytest.approx(
        make(torque, velocity, power).motor_efficiency, abs=0.02
    )


def test_too_little_motion_is_refused():
    nothing = np.zeros(5000)
    with pytest.raises(NotIdentifiableError, match="axis moves in 0 samples"):
        make(nothing + 1.0, nothing, nothing + 20.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(5, 60))
def test_thinning_keeps_its_promises(seed, points):
    rng = np.random.default_rng(seed)
    torque, velocity = rng.normal(size=1500), 50.0 * rng.normal(size=1500)
    power = torque * velocity / 0.7 + rng.normal(size=1500)
    entry = make(torque, velocity, power, points=points).entry
    assert 1 <= len(entry.efficiency) <= points
    assert min(abs(value) for value in entry.efficiency) >= MIN_EFFICIENCY * 0.999
    largest = max(abs(value) for value in entry.motor_torque)
    assert largest <= np.abs(torque).max() * 1.0001


def test_the_second_stage_is_the_first_one_on_power():
    rng = np.random.default_rng(1)
    power = 100.0 + rng.normal(size=2000)
    power[500] = 1e4
    stretch = np.zeros(2000, dtype=np.int64)
    result = processed(power, stretch, PERIOD, 5.0)
    assert np.abs(result - 100.0).max() < 2.0
