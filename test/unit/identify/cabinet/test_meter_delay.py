"""A meter that lags the joint states is found out, and its readings are brought back."""

from __future__ import annotations

import re
import tracemalloc
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from places import ROOT
from plants import LIMITS, PROGRAM, two_link_profile
from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.foundation.errors import ImplausibleIdentificationError
from robot_energy.model import load
from robot_energy.timeline.blocks import EffortMeaning, MeterBlock, MeterLocation, MeterMeaning
from robot_energy_identify.data import thinned
from robot_energy_identify.data.bags import Bag
from robot_energy_identify.data.recordings import read_recording, undone
from robot_energy_identify.drives.all_drives import find_drives
from robot_energy_identify.drives.delays import (
    estimate_meter_delay,
    estimate_time_constant,
    meter_lags,
    with_meters_earlier,
)
from robot_energy_identify.drives.drive_data import DriveData, drive_data
from robot_energy_identify.drives.total_power import fit_total
from robot_energy_identify.drives.total_sums import sums
from robot_energy_identify.refused_recordings import on_one_clock, refuse_meter
from robot_energy_plan.motion import random_program
from robot_energy_rig import RigConfig, Sensors, VirtualRig, random_profile
from robot_energy_rig.record import record


@pytest.fixture(scope="module", params=[MeterMeaning.MEAN_OVER_INTERVAL, MeterMeaning.CUMULATIVE])
def recording(tmp_path_factory, request):
    """The two-link rig, every effect on, with a meter that keeps time."""
    folder = tmp_path_factory.mktemp("meter")
    profile = two_link_profile(folder)
    config = RigConfig(sensors=Sensors(meter_meaning=request.param, meter_rate=20.0))
    record(VirtualRig(profile, PROGRAM, config, 1, 40.0, rate_hz=100.0), 40.0, folder / "bag")
    model = load(folder / "two_link.yaml")
    return read_recording(folder / "bag", model, EffortMeaning.MOTOR_TORQUE)


def data_of(recording):
    return drive_data([recording], [None], measured_torque=True)


def total_of(recording):
    """What the meter says of the drives."""
    return find_drives(data_of(recording), recording.model).total


@pytest.fixture(scope="module")
def in_time(recording):
    """The same of a meter that keeps time."""
    return total_of(recording)


@pytest.fixture(scope="module")
def own_delay(recording):
    return estimate_meter_delay(data_of(recording)).value


@pytest.mark.parametrize("delay", [-0.06, 0.04, 0.137])
def test_a_known_delay_is_found_and_undone(recording, own_delay, delay):
    late = recording.with_meter_earlier(-delay)
    found = estimate_meter_delay(data_of(late))
    assert (
        abs(own_delay) < 0.015
    )  # the model is not the plant: its braking ends a little early or late
    assert found.applied == pytest.approx(delay + own_delay, abs=0.002)
    back = late.with_meter_earlier(found.applied)
    assert abs(estimate_meter_delay(data_of(back)).value) < 0.002


def test_what_a_late_meter_says_of_the_drives_is_that_of_one_in_time(recording, in_time):
    late = recording.with_meter_earlier(-0.137)
    total = total_of(late)
    assert total.meter_delay.applied == estimate_meter_delay(data_of(late)).applied
    assert total.fit.constant == pytest.approx(in_time.fit.constant, rel=0.02)


def test_a_meter_in_time_is_left_as_it_is(recording):
    found = estimate_meter_delay(data_of(recording))
    assert found.applied == 0.0
    assert with_meters_earlier(data_of(recording), 0.0).meters[0] is recording.meter


def test_readings_moved_are_compared_again(recording):
    """A tenth of a second later, what is predicted for a reading is another energy."""
    moved = recording.with_meter_earlier(0.1)
    np.testing.assert_array_equal(moved.meter.stamp_ns, recording.meter.stamp_ns - 100_000_000)
    before = np.concatenate([part.predicted for part in recording.compared]).sum()
    after = np.concatenate([part.predicted for part in moved.compared]).sum()
    assert after == pytest.approx(before, rel=0.02)
    assert after != before
    same = recording.with_meter_earlier(1e-9).with_meter_earlier(-1e-9)  # compared twice
    again = np.concatenate([part.predicted for part in same.compared]).sum()
    assert again == pytest.approx(before, rel=1e-9)


def test_a_bag_with_a_delay_is_read_without_it(recording):
    bag = Bag(recording.path, EffortMeaning.MOTOR_TORQUE)
    late = replace(bag, meter_delay=0.1).whole(recording.model)
    np.testing.assert_array_equal(late.meter.stamp_ns, recording.meter.stamp_ns - 100_000_000)


def test_few_readings_say_no_delay(recording):
    short = replace(recording, meter=recording.meter[:50])
    assert estimate_meter_delay(data_of(short)) is None


@pytest.fixture(scope="module")
def filtered(tmp_path_factory):
    """The same rig, its meter behind a low pass of 0.25 s."""
    folder = tmp_path_factory.mktemp("filtered")
    profile = two_link_profile(folder)
    config = RigConfig(sensors=Sensors(meter_rate=20.0, meter_filter=0.25)).having("meter_filter")
    record(VirtualRig(profile, PROGRAM, config, 1, 40.0, rate_hz=100.0), 40.0, folder / "bag")
    model = load(folder / "two_link.yaml")
    return read_recording(folder / "bag", model, EffortMeaning.MOTOR_TORQUE)


@pytest.fixture(scope="module")
def sharpened(filtered):
    return total_of(filtered)


def test_a_low_pass_is_found_and_undone(in_time, filtered, sharpened):
    found = estimate_time_constant(data_of(filtered))
    assert found.applied == pytest.approx(0.25, rel=0.25)  # the model is not the plant
    back = filtered.with_meter_earlier(0.0, found.applied)
    assert estimate_time_constant(data_of(back)).applied == 0.0
    assert sharpened.meter_time_constant.applied == found.applied
    assert sharpened.fit.constant == pytest.approx(in_time.fit.constant, rel=0.12)
    blurred = fit_total(sums(data_of(filtered), filtered.model))
    assert sharpened.fit.losses.rms < 0.5 * blurred.losses.rms


def test_recordings_of_other_sample_periods_show_the_same_low_pass(filtered):
    """As long ones do, of which every second sample is kept."""
    thin = replace(filtered, torque=filtered.torque[::2], power=filtered.power[::2], known=())
    both = drive_data([filtered, thin], [None] * 2, measured_torque=True)
    alone = estimate_time_constant(data_of(filtered)).applied
    assert estimate_time_constant(both).applied == pytest.approx(alone, rel=0.05)


def test_a_low_pass_does_not_take_up_a_delay(tmp_path):
    """A meter with both; without a DC link the supply passes on what the estimate takes it to."""
    profile = two_link_profile(tmp_path)
    config = RigConfig(sensors=Sensors(meter_rate=20.0, meter_filter=0.25)).having("meter_filter")
    rig = VirtualRig(profile, PROGRAM, config.without("capacitor"), 1, 40.0, rate_hz=100.0)
    record(rig, 40.0, tmp_path / "bag")
    model = load(tmp_path / "two_link.yaml")
    late = read_recording(tmp_path / "bag", model, EffortMeaning.MOTOR_TORQUE)
    data = data_of(late.with_meter_earlier(-0.12))
    low_pass, delay = meter_lags(partial(with_meters_earlier, data, 0.0))
    assert low_pass.applied == pytest.approx(0.25, rel=0.1)
    assert delay.applied == pytest.approx(0.12, abs=0.02)


@pytest.fixture(scope="module")
def varied(tmp_path_factory):
    """The same in motions that do not repeat, without a DC link."""
    folder = tmp_path_factory.mktemp("varied")
    profile = two_link_profile(folder)
    config = RigConfig(sensors=Sensors(meter_rate=20.0, meter_filter=0.25)).having("meter_filter")
    program = random_program(LIMITS, 3, dwell=0.15)
    rig = VirtualRig(profile, program, config.without("capacitor"), 1, 40.0, rate_hz=100.0)
    record(rig, 40.0, folder / "bag")
    model = load(folder / "two_link.yaml")
    return read_recording(folder / "bag", model, EffortMeaning.MOTOR_TORQUE)


@pytest.mark.parametrize("ahead", [0.05, 0.14])
def test_a_low_pass_is_found_behind_a_clock_that_is_ahead(varied, ahead):
    in_time, _ = meter_lags(partial(with_meters_earlier, data_of(varied), 0.0))
    early = data_of(varied.with_meter_earlier(ahead))
    low_pass, delay = meter_lags(partial(with_meters_earlier, early, 0.0))
    assert low_pass.applied == pytest.approx(in_time.applied, rel=0.1)
    assert delay.applied == pytest.approx(-ahead, abs=0.02)


def raised(part, rise):
    """The same recording with a meter that shows more by so much over time [W]."""
    meter = replace(part.meter, power=part.meter.power + rise(np.arange(len(part.meter))))
    return replace(part, meter=meter, known=None)


@pytest.mark.parametrize(
    "rise", [lambda reading: 60.0 * (reading % 400 > 200), lambda reading: 0.15 * reading]
)
def test_a_low_pass_does_not_take_up_a_level_that_is_off(varied, rise):
    """As that of a load that is switched, or of friction that changes with the temperature."""
    alone = estimate_time_constant(data_of(varied)).applied
    assert estimate_time_constant(data_of(raised(varied, rise))).applied == pytest.approx(
        alone, rel=0.03
    )


def test_a_low_pass_is_not_shorter_where_speeds_are_late(varied):
    alone = estimate_time_constant(data_of(varied)).applied
    late = data_of(varied.with_meter_earlier(0.02))
    assert estimate_time_constant(late).applied == pytest.approx(alone, rel=0.02)


@pytest.mark.parametrize("late", [-0.3, 0.3, 5.0])
def test_a_clock_that_differs_from_the_others_is_found_and_undone(varied, late):
    off = varied.with_meter_earlier(-late)
    (_, moved, _), (note,) = on_one_clock([varied, off, varied])
    assert np.abs(moved.meter.stamp_ns - varied.meter.stamp_ns).max() < 0.03e9
    assert f"{abs(late):.1f}" in note
    assert ("behind" if late > 0 else "ahead of") in note


@pytest.mark.parametrize("late", [-8.0, -5.0, 3.0])
def test_a_clock_is_found_where_a_smaller_shift_explains_a_little(late):
    """Power of a cold robot that is 3 s late explains a fifth of it as it stands."""
    parts = [
        read_recording(ROOT / f"bags/drawn_train_{name}", load("kr16"), EffortMeaning.NONE)
        for name in ("cold", "middle", "warm")
    ]
    kept, notes = on_one_clock(parts)
    assert not notes
    (moved, *_), (note,) = on_one_clock([parts[0].with_meter_earlier(-late), *parts[1:]])
    assert note.startswith("drawn_train_cold")
    assert np.abs(moved.meter.stamp_ns - kept[0].meter.stamp_ns).max() < 0.05e9


def test_of_two_clocks_that_nearer_to_the_joint_states_stays(varied):
    off = varied.with_meter_earlier(1.0)
    for pair in ([varied, off], [off, varied]):
        kept, notes = on_one_clock(pair)
        assert len(notes) == 1
        stamps = [part.meter.stamp_ns[0] for part in kept]
        assert np.abs(np.array(stamps) - varied.meter.stamp_ns[0]).max() < 0.03e9


def test_recordings_with_one_clock_are_left_as_they_are(varied):
    late = varied.with_meter_earlier(-0.05)
    kept, notes = on_one_clock([varied, late, varied])
    assert [part.meter for part in kept] == [part.meter for part in (varied, late, varied)]
    assert not notes


def test_forty_readings_do_not_show_that_a_clock_differs_a_little(tmp_path):
    """A drawn plant at 1 Hz: sound clocks look 0.26 s apart, and one of 1 s is found."""
    profile, model = random_profile("ur10e", 1), load("ur10e")
    limits = profile.motion_limits(profile.mechanics()[0])
    meter = Sensors(meter_rate=1.0, meter_meaning=MeterMeaning.INSTANTANEOUS, meter_filter=0.3)
    config = RigConfig(sensors=meter).having("meter_filter", "fan")
    parts = []
    for seed, degc, dwell in ((10, 20.0, 0.1), (11, 40.0, 0.8), (12, 60.0, 2.0)):
        program, bag = random_program(limits, seed, dwell=dwell), tmp_path / f"{seed}"
        record(VirtualRig(profile, program, config, seed, degc, rate_hz=100.0), 40.0, bag)
        parts.append(read_recording(bag, model, EffortMeaning.NONE))
    kept, notes = on_one_clock(parts)
    assert not notes
    assert [part.meter for part in kept] == [part.meter for part in parts]
    _, (note,) = on_one_clock([*parts[:2], parts[2].with_meter_earlier(-1.0)])
    assert note.startswith("12: its meter is 1.")


def counted(part):
    """The same recording with an energy counter in place of its meter."""
    meter = undone(part.meter, 0.0, 0.25)
    nothing = np.full(len(meter), np.nan)
    energy = np.cumsum(meter.power * meter.interval)
    counter = MeterBlock(
        meter.stamp_ns, nothing, energy, nothing, MeterMeaning.CUMULATIVE, MeterLocation.GRID
    )
    return replace(part, meter=counter, known=None)


def test_a_counter_next_to_other_recordings_leaves_their_low_pass(varied):
    parts = [varied, counted(varied)]
    alone = estimate_time_constant(data_of(varied)).applied
    both = drive_data(parts, [None] * 2, measured_torque=True)
    assert estimate_time_constant(both).applied == pytest.approx(alone, rel=0.1)
    kept, notes = on_one_clock([*parts, varied])
    assert kept[1].meter is parts[1].meter
    assert not notes


@pytest.mark.parametrize("late", [0.9, 4.0])
def test_a_meter_later_than_any_is_refused_with_the_line_that_mends_it(varied, late):
    refuse_meter([varied], EffortMeaning.NONE)
    with pytest.raises(ImplausibleIdentificationError) as caught:
        refuse_meter([varied.with_meter_earlier(-late)], EffortMeaning.NONE)
    (offset,) = re.findall(r"meter: {stamp_offset: (-[0-9.]+)}", str(caught.value))
    assert -float(offset) == pytest.approx(late, abs=0.2)


def test_of_many_readings_some_say_the_delay(recording, monkeypatch):
    late = data_of(recording.with_meter_earlier(-0.137))
    by_all = estimate_meter_delay(late)
    monkeypatch.setattr(thinned, "MOST_ROWS", len(recording.meter) // 3)
    by_some = estimate_meter_delay(late)
    assert by_some.applied == pytest.approx(by_all.applied, abs=0.01)
    assert by_some.std != by_all.std  # a third of the readings


def test_a_meter_without_low_pass_and_a_late_one_are_left_as_they_are(recording):
    for meter in (recording, recording.with_meter_earlier(-0.137)):
        found = estimate_time_constant(data_of(meter))
        assert found is None or found.applied == 0.0


def test_a_ramp_behind_a_low_pass_lags_by_its_time_constant():
    """A settled low pass of a ramp of 50 W/s lags by ``50 T``; a gap takes no slope across it."""
    seconds = np.concatenate([np.arange(20) * 0.1, 100.0 + np.arange(20) * 0.1])
    ramp = 300.0 + 50.0 * (seconds % 100.0)
    nothing = np.full(len(seconds), np.nan)
    meter = MeterBlock(
        np.rint(seconds * 1e9).astype(np.int64),
        ramp - 50.0 * 0.3,
        nothing,
        np.full(len(seconds), 0.1),
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )
    np.testing.assert_allclose(undone(meter, 0.0, 0.3).power, ramp, rtol=1e-9)


def test_readings_that_are_not_used_take_no_memory_at_each_delay(varied, monkeypatch):
    """Of 35,000 readings 700 are used; 41 delays of all would keep more than 100 MB."""
    meter, ms = varied.meter, np.arange(35_000)
    many = replace(
        meter[ms // 50],
        stamp_ns=meter.stamp_ns[0] + ms * 1_000_000,
        interval=np.full(len(ms), 1e-3),
    )
    data = replace(data_of(varied), meters=(many,))
    monkeypatch.setattr(thinned, "MOST_ROWS", 700)
    tracemalloc.start()
    try:
        assert estimate_meter_delay(data) is not None
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 60e6


def late_by_25_ms(noise):
    """A made-up drive with a late meter of 50 Hz without low pass, and noise in its torque."""
    rng = np.random.default_rng(0)
    stamp = np.arange(6000) * 10_000_000
    second = stamp * 1e-9
    velocity = sum(40.0 * np.sin(w * second + w) for w in (1.3, 2.9, 4.1))
    torque = 0.02 * np.gradient(velocity, second) + 0.6 * np.tanh(velocity) + 2.0
    power = torque * velocity + 4.0 * torque**2 + 0.02 * np.abs(velocity) + 180.0
    area = np.append(0.0, np.cumsum(0.5 * (power[1:] + power[:-1]))) * 0.01
    rows = np.arange(2, 6000, 2)
    meter = MeterBlock(
        stamp[rows] + 25_000_000,
        (area[rows] - area[rows - 2]) / 0.02,
        np.full(len(rows), np.nan),
        np.full(len(rows), 0.02),
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )
    read = (torque + noise * rng.normal(size=len(torque)))[:, None]
    zero = np.zeros(len(stamp), dtype=np.int64)
    return DriveData(
        ("a",), stamp, zero, zero, velocity[:, None], read, np.full_like(read, 40.0),
        np.full_like(read, np.nan), (meter,), (MeterLimits(),), zero.astype(bool), read,
    )  # fmt: skip


def test_a_low_pass_that_averages_the_noise_of_the_torque_is_not_applied():
    found = estimate_time_constant(late_by_25_ms(noise=0.2))
    assert found.value > 0.01
    assert found.gain > 0.05
    assert found.applied == 0.0
