"""Gears recovered from friction torque, and from a power meter; refused where none shows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import validate
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import PowerBlock, TorqueBlock
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.friction.friction import fit_laws
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.thermal.gear import GearsFound, ambient_offset, fit_gear, fit_gears
from robot_energy_identify.thermal.gears_by_meter import gears_by_meter
from warm_wheel import readings, turning, wheel

PERIOD, AIR = 0.04, 20.0
COULOMB, A, B, C = 0.3, 0.002, 0.02, 25.0
TIME, TO_MOTOR, PER_WATT = 1500.0, 0.5, 0.25


def exponential(degc):
    return A + B * np.exp(-degc / C)


def rounded(degc):
    """It falls little at first, which no exponential does."""
    return 0.004 + 0.012 * np.exp(-((degc / 35.0) ** 2))


def friction_of(seconds, motor_rise, seed, gear=True, start=AIR, off=0.0, law=exponential):
    """One axis at changing speeds; its gear, ``off`` warmer at first, by Euler's rule of 0.04 s."""
    rng = np.random.default_rng(seed)
    count = round(seconds / PERIOD)
    time = PERIOD * np.arange(count)
    speed = np.repeat(rng.uniform(20.0, 100.0, -(-count // 25)), 25)[:count]
    speed *= np.where((time // 2.0) % 2 == 0, 1.0, -1.0)
    motor = start + motor_rise * (1.0 - np.exp(-time / 600.0))
    degc = np.empty(count)
    now = start + off
    for row in range(count):
        degc[row] = now
        viscous = law(now if gear else motor[row])
        heat = COULOMB * abs(speed[row]) + viscous * speed[row] ** 2
        target = PER_WATT * heat + TO_MOTOR * motor[row] + (1.0 - TO_MOTOR) * AIR
        now += PERIOD / TIME * (target - now)
    viscous = law(degc if gear else motor)
    torque = COULOMB * np.sign(speed) + viscous * speed + 0.02 * rng.standard_normal(count)
    data = FrictionData(
        "axle", speed, torque, motor, np.arange(count) // 125, np.zeros(count, dtype=np.int64),
        np.empty((count, 0)), stamp_ns=10**18 + (time * 1e9).astype(np.int64),
    )  # fmt: skip
    return data, degc


def together(parts):
    parts = [
        replace(part, run=np.full(len(part), n), block=part.block + 10_000 * n)
        for n, part in enumerate(parts)
    ]
    return FrictionData.concatenate(parts)


@pytest.fixture(scope="module")
def recorded():
    """A warm-up of forty minutes and two short recordings of soaked gears."""
    return [
        friction_of(2400.0, 12.0, 1),
        friction_of(60.0, 0.0, 2, start=40.0),
        friction_of(60.0, 0.0, 3, start=60.0),
    ]


def test_a_warm_up_shows_the_gear(recorded):
    parts = [part for part, _ in recorded]
    fit, followed = fit_gear(together(parts), AIR)
    truth = np.concatenate([degc for _, degc in recorded])
    assert np.sqrt(np.mean((followed.motor_temperature_degc - truth) ** 2)) < 1.5
    assert fit.error < 0.5 * fit.motor_error
    time, std = fit.time_constant
    assert abs(time - TIME) < 2.5 * std
    gear = fit.gear
    total = gear.motor_conductance.value + gear.ambient_conductance.value
    assert gear.capacity.value / total == pytest.approx(time, rel=1e-6)
    assert gear.capacity.tag == "identified"
    assert 0.0 < (gear.std or 0.0) < 6.0


def short(offs, law=exponential):
    """A warm-up and three recordings of a minute."""
    starts = zip((20.0, 40.0, 60.0), offs, (2, 3, 4), strict=True)
    ran = [friction_of(2400.0, 12.0, 1, law=law)]
    ran += [friction_of(60.0, 0.0, n, start=at, off=off, law=law) for at, off, n in starts]
    return together([part for part, _ in ran])


def test_recordings_of_a_soaked_robot_begin_as_warm_as_its_motors():
    """A free start of the last one makes up for a law of another form, by 7.7 K."""
    _, followed = fit_gear(short((0.0, 0.0, 0.0), rounded), AIR)
    begins = [followed.motor_temperature_degc[followed.run == run][0] for run in (1, 2, 3)]
    np.testing.assert_allclose(begins, [20.0, 40.0, 60.0], atol=1.0)


def test_recordings_that_begin_otherwise_have_a_start_of_their_own():
    _, followed = fit_gear(short((0.0, -6.0, 0.0)), AIR)
    assert 33.0 < followed.motor_temperature_degc[followed.run == 2][0] < 37.0


def test_friction_that_follows_the_motor_is_no_gear():
    parts = [
        friction_of(1500.0, 12.0, 1, gear=False)[0],
        friction_of(60.0, 0.0, 2, gear=False, start=40.0)[0],
        friction_of(60.0, 0.0, 3, gear=False, start=60.0)[0],
    ]
    with pytest.raises(NotIdentifiableError, match="one that follows the motor within"):
        fit_gear(together(parts), AIR)


def scattered(parts):
    """Recordings whose single samples scatter more than the temperature moves friction."""
    data = together(parts)
    noise = np.random.default_rng(5).standard_normal(len(data))
    return replace(data, friction_torque=data.friction_torque + 0.8 * noise)


def test_friction_follows_temperature_where_minutes_show_it_and_single_samples_do_not(recorded):
    _, (axis,) = fit_gears([scattered([part for part, _ in recorded])])
    assert axis.follows_temperature
    fit = fit_laws(axis)
    assert fit.chosen == "exponential"
    assert fit.errors["exponential"].rms > 0.98 * fit.errors["constant"].rms
    assert fit_laws(replace(axis, follows_temperature=False)).chosen == "constant"


@pytest.mark.parametrize("seed", [1, 4])
def test_a_constant_friction_gains_by_chance_and_follows_nothing(seed):
    """With the motor temperature unseen minutes are 5 and 11 % less off, by chance."""

    def law(degc):
        return 0.006 + 0.0 * degc

    parts = [
        friction_of(2400.0, 12.0, seed, law=law),
        friction_of(60.0, 0.0, 2, start=40.0, law=law),
    ]
    _, (axis,) = fit_gears([scattered([part for part, _ in parts])])
    assert not axis.follows_temperature


def test_short_recordings_show_none(recorded):
    parts = [part for part, _ in recorded[1:]]
    found, axes = fit_gears([together(parts)])
    assert not found.fits
    assert found.refused[0].startswith("axle: no recording shows its gear warming up")
    assert "record one warm-up" in found.refused[0].lower()
    np.testing.assert_array_equal(
        axes[0].motor_temperature_degc, together(parts).motor_temperature_degc
    )


def test_axes_without_temperatures_are_left_alone(recorded):
    data = together([recorded[1][0]])
    unknown = replace(data, motor_temperature_degc=np.full(len(data), np.nan))
    found, axes = fit_gears([unknown])
    assert found == GearsFound()
    assert axes[0] is unknown


def test_an_axis_whose_torque_and_speed_are_never_known_together_is_refused_alone(recorded):
    data = together([recorded[1][0]])
    apart = replace(data, motor_velocity=np.full(len(data), np.nan))
    found, axes = fit_gears([apart])
    assert "has no measured torque" in found.refused[0]
    assert axes[0] is apart


def with_gear(model, time, rise, power):
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"] = {"xml": model.urdf_xml}
    total = power / rise
    figures = {
        "capacity": time * total, "motor_conductance": total, "ambient_conductance": 0.0,
    }  # fmt: skip
    data["joints"][0]["gear"] = {
        key: {"value": value, "tag": "assumed"} for key, value in figures.items()
    }
    return validate(data, "with a gear")


def with_exponent(model, exponent):
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"] = {"xml": model.urdf_xml}
    figures = {"exponent": exponent, "velocity": 5.0}
    data["joints"][0]["friction"]["viscous_exponent"] = {
        key: {"value": value, "tag": "assumed"} for key, value in figures.items()
    }
    return validate(data, "with an exponent")


def recording_of(model, truth, seconds):
    """What a model that follows the motor says of work whose meter follows the truth."""
    block = turning(seconds)
    degc = 20.0 + 10.0 * (1.0 - np.exp(-np.arange(seconds) / 500.0))
    temperatures = replace(readings(seconds), motor_temperature_degc=degc[:, None])

    def played(of):
        pipeline = EnergyPipeline(of)
        outputs = [pipeline.step(block, temperatures), pipeline.flush()]
        return (
            PowerBlock.concatenate([o.power for o in outputs if o.power is not None]),
            TorqueBlock.concatenate([o.torque for o in outputs if o.torque is not None]),
        )

    (power, torque), (true, _) = played(model), played(truth)
    energy = [0.5 * (one.grid_power[1:] + one.grid_power[:-1]) * 0.5 for one in (true, power)]
    duration = np.full(len(energy[0]), 500_000_000)
    compared = Compared(power.stamp_ns[1:], duration, *energy, energy[1])
    return Recording(Path("x"), model, torque, power, None, "", (), known=(compared,))


@pytest.mark.parametrize("exponent", [1.0, 0.7])
def test_a_meter_shows_two_figures_for_all_gears(exponent):
    model = with_exponent(wheel(gear=False), exponent)
    power = float(recording_of(model, model, 1800).power.friction_power.mean())
    truth = with_gear(model, 1200.0, 15.0, power)
    found = gears_by_meter([recording_of(model, truth, 1800)], 20.0, "bag")
    (fit,) = found.fits
    assert fit.rise[0] == pytest.approx(15.0, rel=0.05)
    assert fit.error < 0.3 * fit.motor_error
    written = found.write(model, ["axle"])
    assert written.joints[0].gear is not None
    again = recording_of(written, truth, 1800)
    (compared,) = again.compared
    off = compared.predicted / compared.measured - 1.0
    assert np.abs(off[400:]).max() < 0.02


def test_a_meter_that_shows_no_gear_refuses_it():
    model = wheel(gear=False)
    found = gears_by_meter([recording_of(model, model, 1800)], 20.0)
    assert not found.fits
    assert "friction follows the motor temperatures" in found.refused[0]
    short = gears_by_meter([recording_of(model, model, 120)], 20.0)
    assert "shows a warm-up" in short.refused[0]


def warmer(parts, degc):
    data = together([part for part, _ in parts])
    return replace(data, motor_temperature_degc=data.motor_temperature_degc + degc)


def test_a_thermometer_that_reads_too_high_shifts_the_air_of_its_gear_alone(recorded):
    found, _ = fit_gears([warmer(recorded, 0.0), warmer(recorded, 3.0)])
    right, high = (fit.gear for fit in found.fits)
    assert right.ambient_offset is None
    assert high.ambient_offset == pytest.approx(3.0, abs=1e-6)
    for name in ("capacity", "motor_conductance", "ambient_conductance"):
        assert getattr(high, name).value == pytest.approx(getattr(right, name).value, rel=1e-3)


def test_the_air_that_a_user_gives_is_that_of_all_gears(recorded):
    found, _ = fit_gears([warmer(recorded, 0.0), warmer(recorded, 3.0)], ambient_degc=AIR)
    assert [fit.gear.ambient_offset for fit in found.fits] == [None, None]


def test_a_motor_that_was_never_as_cold_says_nothing_of_the_air(recorded):
    assert ambient_offset(warmer(recorded, 6.5), AIR) == 0.0
    assert ambient_offset(warmer(recorded, 5.5), AIR) == 5.5
