from dataclasses import replace

import numpy as np
import pytest

import robots
from accounts import power_block
from robot_energy.accounting.registers import Registers
from robot_energy.model.payload import payload
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import (
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    Phase,
    PowerBlock,
    Quality,
    TemperatureBlock,
    sum_over_joints,
)
from robots import figure


def run(pipeline, *steps):
    outputs = [pipeline.step(**step) for step in steps]
    outputs.append(pipeline.flush())
    return PowerBlock.concatenate([out.power for out in outputs if out.power is not None])


def spin(velocity, seconds=1.0, rate=100.0, start=0.0):
    stamp = start + np.arange(int(seconds * rate) + 1) / rate
    speed = np.full((len(stamp), 1), velocity)
    return robots.joint_block(stamp, speed * stamp[:, None], speed)


def test_wheel_at_constant_speed_by_hand():
    # motor 10 * 3 = 30 rad/s: (0.5 + 0.02 * 30) * 30 = 33 W friction, + 20 W DC + 30 W grid
    pipeline = EnergyPipeline(robots.one_wheel())
    power = run(pipeline, {"joints": spin(3.0)})
    np.testing.assert_allclose(power.grid_power, 83.0, rtol=1e-12)
    np.testing.assert_allclose(power.friction_power, 33.0, rtol=1e-12)
    assert set(power.phase.tolist()) == {Phase.MOTION}
    account = pipeline.account
    assert account.registers.cabinet("grid_import") == pytest.approx(83.0, abs=1e-6)
    assert account.phase_energy(Phase.MOTION) == pytest.approx(83.0, abs=1e-6)
    assert account.registers.time.observed_ns == 10**9


def test_standing_robot_draws_the_constant_losses_and_nothing_else():
    power = run(
        EnergyPipeline(robots.two_link()),
        {
            "joints": robots.joint_block(
                np.arange(50) / 100, np.full((50, 2), 0.4), np.zeros((50, 2))
            )
        },
    )
    np.testing.assert_array_equal(power.grid_power, 50.0)
    assert set(power.phase.tolist()) == {Phase.HOLD}


def test_braking_wheel_generates_by_hand():
    # from 20 rad/s at -10 rad/s^2: motor torque (2 * -10)/10 - 0.01 * 100 = -3 N m
    stamp = np.arange(101) / 100
    velocity = (20 - 10 * stamp)[:, None]
    pipeline = EnergyPipeline(robots.one_wheel())
    power = run(pipeline, {"joints": robots.joint_block(stamp, velocity * 0, velocity)})
    motor = 10 * velocity[:, 0]
    shaft = (-3.0 + 0.5 + 0.02 * motor) * motor
    middle = slice(5, -5)
    demand = shaft + 20.0
    np.testing.assert_allclose(power.shaft_power[middle, 0], shaft[middle], rtol=1e-9, atol=1e-9)
    expected = np.where(demand < 0, 30.0, demand + 30.0)
    np.testing.assert_allclose(power.grid_power[middle], expected[middle], rtol=1e-9)
    np.testing.assert_allclose(power.brake_power[middle], np.maximum(-demand, 0)[middle], atol=1e-6)
    generating = power.phase == Phase.GENERATING
    np.testing.assert_array_equal(generating[middle], (demand < 0)[middle])


def temperatures(stamp_s, values):
    return TemperatureBlock(
        np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64), np.asarray(values, dtype=float)
    )


def warm_wheel():
    joint = robots.one_wheel().joints[0].model_dump()
    joint["friction"]["viscous"] = {
        "law": "table",
        "motor_temperature_degc": [20.0, 40.0],
        "viscous": [0.04, 0.02],
        "tag": "assumed",
    }
    return robots.one_wheel(joints=[joint], temperature={"fallback_degc": 20.0, "stale_after": 2.0})


def test_temperature_counts_from_its_stamp_onward():
    power = run(
        EnergyPipeline(warm_wheel()),
        {"joints": spin(3.0, seconds=2.0), "temperatures": temperatures([1.0], [[40.0]])},
    )
    expected = np.where(power.stamp_ns < 10**9, 0.04, 0.02)
    np.testing.assert_allclose(power.viscous[:, 0], expected)
    missing = (power.quality & Quality.TEMPERATURE_MISSING) > 0
    np.testing.assert_array_equal(missing, power.stamp_ns < 10**9)


def test_stale_temperature_falls_back_with_a_flag_and_no_jump_to_zero():
    power = run(
        EnergyPipeline(warm_wheel()),
        {
            "joints": spin(3.0, seconds=4.0, start=7.0),
            "temperatures": temperatures([7.0], [[40.0]]),
        },
    )
    stale = power.stamp_ns > 9 * 10**9
    np.testing.assert_allclose(power.viscous[:, 0], np.where(stale, 0.04, 0.02))
    np.testing.assert_array_equal((power.quality & Quality.TEMPERATURE_STALE) > 0, stale)
    np.testing.assert_array_equal(np.isnan(power.motor_temperature_degc[:, 0]), stale)
    assert (power.grid_power > 50).all()


def test_temperature_that_arrives_late_still_counts_from_its_stamp():
    joints = spin(3.0, seconds=1.0)
    late = run(
        EnergyPipeline(warm_wheel()),
        {"joints": joints[slice(0, 55)]},
        {"joints": joints[slice(55, None)], "temperatures": temperatures([0.5], [[40.0]])},
    )
    np.testing.assert_allclose(late.viscous[:, 0], np.where(late.stamp_ns < 5 * 10**8, 0.04, 0.02))


def test_bad_temperatures_change_nothing_and_are_counted():
    pipeline = EnergyPipeline(warm_wheel())
    power = run(
        pipeline,
        {
            "joints": spin(3.0, start=1.0),
            "temperatures": temperatures([1.0, 1.1, 1.2], [[40.0], [999.0], [np.nan]]),
        },
    )
    np.testing.assert_allclose(power.viscous[:, 0], 0.02)
    refused = (power.quality & Quality.TEMPERATURE_IMPLAUSIBLE) > 0
    np.testing.assert_array_equal(refused, power.stamp_ns >= 11 * 10**8)
    stage = pipeline.friction
    assert stage.rejections.rejected["temperature_implausible"] == 1
    assert stage.rejections.rejected["temperature_not_finite"] == 1
    assert stage.rejections.received == stage.rejections.accepted + sum(
        stage.rejections.rejected.values()
    )


def test_nan_position_is_nan_power_not_zero_and_not_energy():
    joints = spin(3.0)
    joints.joint_position[50] = np.nan
    pipeline = EnergyPipeline(robots.one_wheel())
    power = run(pipeline, {"joints": joints})
    bad = ~np.isfinite(power.grid_power)
    assert bad[50]
    assert (power.quality[bad] & Quality.NOT_FINITE).all()
    assert (power.phase[bad] == Phase.UNKNOWN).all()
    time = pipeline.account.registers.time
    assert time.observed_ns + time.gap_ns == 10**9
    assert time.gap_ns == (int(bad.sum()) + 1) * 10**7
    assert time.gap_count == 1


def test_breakdown_sums_to_the_grid_with_every_option_on():
    data = robots.two_link_data()
    for joint in data["joints"]:
        joint["losses"] = {
            "constant": figure(1.0),
            "linear": figure(0.01),
            "quadratic": figure(1e-4),
            "copper": figure(5.0),
        }
    data["cabinet"] |= {
        "regeneration_efficiency": figure(0.8),
        "capacitor": {
            "capacitance": figure(1e-4),
            "nominal_voltage": figure(560.0),
            "chopper_voltage": figure(600.0),
        },
    }
    data["drive"] = "loss_model"
    model = robots.two_link(**data)
    stamp = np.arange(800) / 200
    phase = np.stack([8 * stamp, 13 * stamp], axis=1)
    position, velocity = np.sin(phase), np.cos(phase) * [8, 13]
    pipeline = EnergyPipeline(model)
    power = run(pipeline, {"joints": robots.joint_block(stamp, position, velocity)})
    total = sum_over_joints(power.rigid_power + power.friction_power + power.drive_loss)
    total += power.loss_dc + power.loss_grid + power.brake_power + power.capacitor_power
    np.testing.assert_allclose(total, power.grid_power, rtol=1e-12, atol=1e-9)
    assert (power.grid_power < 0).any()
    assert (power.capacitor_power != 0).any()
    book = pipeline.account.registers
    drawn = book.cabinet("grid_import") - book.cabinet("grid_return")
    parts = sum(book.joints(name).sum() for name in ("rigid", "friction", "drive_loss"))
    parts += sum(book.cabinet(name) for name in ("loss_dc", "loss_grid", "brake", "capacitor"))
    assert drawn == pytest.approx(parts, abs=1e-4)


def test_means_carry_what_the_meter_measured_over_the_same_time():
    stamp = np.arange(0, 21) * 10**8
    meter = MeterBlock(
        stamp,
        np.full(21, 90.0),
        np.full(21, np.nan),
        np.full(21, np.nan),
        MeterMeaning.INSTANTANEOUS,
        MeterLocation.GRID,
    )
    pipeline = EnergyPipeline(robots.one_wheel())
    out = [pipeline.step(joints=spin(3.0, seconds=2.0), meter=meter), pipeline.flush()]
    means = [part.means for part in out if part.means is not None]
    shown = np.concatenate([mean.measured_power for mean in means])
    adjacent = np.concatenate([mean.predicted_power_at_meter for mean in means])
    assert np.isnan(shown[0])
    np.testing.assert_allclose(shown[10:], 90.0)
    np.testing.assert_allclose(adjacent[10:], 83.0)
    age = np.concatenate([mean.measurement_age for mean in means])[10:]
    assert ((age >= 0) & (age <= 0.1)).all()


def test_meter_on_the_dc_bus_is_compared_without_the_grid_side_loss():
    stamp = np.arange(0, 21) * 10**8
    meter = MeterBlock(
        stamp,
        np.full(21, 50.0),
        np.full(21, np.nan),
        np.full(21, np.nan),
        MeterMeaning.INSTANTANEOUS,
        MeterLocation.DC_BUS,
    )
    pipeline = EnergyPipeline(robots.one_wheel())
    run(pipeline, {"joints": spin(3.0, seconds=2.0), "meter": meter})
    assert pipeline.account.comparison.predicted_energy == pytest.approx(53.0 * 2)
    assert pipeline.account.comparison.measured_energy == pytest.approx(50.0 * 2)


def test_temperature_older_than_the_last_of_its_motor_is_counted_and_left():
    pipeline = EnergyPipeline(warm_wheel())
    power = run(
        pipeline,
        {
            "joints": spin(3.0, start=1.0),
            "temperatures": temperatures([1.5, 1.2, 1.6], [[40.0], [20.0], [40.0]]),
        },
    )
    np.testing.assert_allclose(power.viscous[power.stamp_ns >= 15 * 10**8, 0], 0.02)
    assert pipeline.friction.rejections.rejected["temperature_older"] == 1


def patient_wheel():
    joint = warm_wheel().joints[0]
    return robots.one_wheel(
        joints=[joint.model_dump()], temperature={"fallback_degc": 20.0, "stale_after": 1e6}
    )


def test_friction_of_a_looped_recording_stays_in_its_epoch():
    # pass one warms from 20 to 40 degC; the temperatures of pass two arrive before its torque
    pipeline = EnergyPipeline(patient_wheel())
    once = spin(3.0, seconds=8.0, start=100.0)
    again = robots.joint_block(once.stamp_ns * 1e-9, once.joint_position, once.joint_velocity)
    again.segment[:] = 1
    readings = temperatures([100.0, 106.0], [[20.0], [40.0]])
    power = run(
        pipeline,
        {"temperatures": readings},
        {"temperatures": readings},
        {"joints": once},
        {"joints": again},
    )
    expected = np.where(power.stamp_ns < 106 * 10**9, 0.04, 0.02)
    np.testing.assert_allclose(power.viscous[:, 0], expected)


def test_thermometers_whose_clock_alone_jumps_back_are_followed_after_a_while():
    pipeline = EnergyPipeline(patient_wheel())
    power = run(
        pipeline,
        {"temperatures": temperatures([100.0, 50.0], [[40.0], [20.0]])},
        {"joints": spin(3.0, seconds=5.0, start=100.0)},
        {"joints": spin(3.0, seconds=10.0, start=105.01)},
    )
    np.testing.assert_allclose(power.viscous[power.stamp_ns < 104 * 10**9, 0], 0.02)
    np.testing.assert_allclose(power.viscous[-1, 0], 0.04)


def test_friction_of_a_block_longer_than_a_minute_is_that_of_its_own_time():
    """A slow driver's replay block spans minutes; its first samples keep their temperature."""
    stamp = np.arange(3000) / 10
    joints = robots.joint_block(stamp, np.zeros((3000, 2)), np.full((3000, 2), 0.5))
    warm = temperatures(np.arange(300), np.linspace(20, 80, 300)[:, None] * np.ones(2))
    whole = run(EnergyPipeline(robots.two_link()), {"temperatures": warm, "joints": joints})
    parts = [joints[slice(start, start + 100)] for start in range(0, 3000, 100)]
    feed = [
        {"temperatures": warm[slice(10 * i, 10 * i + 10)], "joints": part}
        for i, part in enumerate(parts)
    ]
    cut = run(EnergyPipeline(robots.two_link()), *feed)
    np.testing.assert_array_equal(whole.viscous, cut.viscous)
    np.testing.assert_array_equal(whole.grid_power, cut.grid_power)


@pytest.mark.parametrize("speed", [1e6, 1e12, 1e150, 1e300])
@pytest.mark.parametrize("blocks", [1, 60])
def test_one_absurd_velocity_is_a_gap_and_not_a_register_full_of_nonsense(speed, blocks):
    """A wheel at 3 rad/s draws 83 W; a driver that once sends 1e12 rad/s must not undo a month."""
    joints = spin(3.0, seconds=2.0)
    velocity = joints.joint_velocity.copy()
    velocity[100] = speed
    joints = replace(joints, joint_velocity=velocity)
    pipeline = EnergyPipeline(robots.one_wheel())
    size = -(-len(joints) // blocks)
    cuts = range(0, len(joints), size)
    power = run(pipeline, *({"joints": joints[slice(cut, cut + size)]} for cut in cuts))
    account = pipeline.account
    bad = (power.quality & Quality.NOT_FINITE) > 0
    assert bad[100]
    assert bad.sum() <= 5  # the acceleration of its neighbours is as absurd
    assert np.isnan(power.grid_power[bad]).all()
    observed = account.registers.time.observed_ns / 1e9
    assert observed == pytest.approx(2.0 - 0.01 * (bad.sum() + 1), abs=1e-9)
    assert account.registers.cabinet("grid_import") == pytest.approx(83.0 * observed, rel=1e-4)
    assert account.registers.time.span_ns == 2 * 10**9
    assert account.counts.peak_power < 100.0


def test_an_energy_that_no_register_takes_is_a_gap():
    registers = Registers(2)
    power = np.array([100.0, 3e15, 100.0, 100.0])
    taken, _ = registers.step(power_block(np.arange(4) * 10**9, power))
    np.testing.assert_array_equal(taken.energy[:, 0], [0, 0, 0, 100])
    assert (registers.time.observed_ns, registers.time.gap_ns) == (10**9, 2 * 10**9)


def test_temperatures_of_which_none_is_left_do_nothing():
    pipeline = EnergyPipeline(robots.one_wheel())
    empty = temperatures([], np.empty((0, 1)))
    assert pipeline.step(temperatures=empty).friction is None


def test_joint_states_of_60_ms_go_through_the_stages_together():
    pipeline, block = EnergyPipeline(robots.one_wheel()), spin(3.0, rate=500.0)
    singles = [pipeline.step(joints=block[slice(n, n + 1)]) for n in range(len(block))]
    assert sum(out.torque is not None for out in singles) <= 1.0 / 0.06 + 1
    power = [out.power for out in (*singles, pipeline.flush()) if out.power is not None]
    whole = run(EnergyPipeline(robots.one_wheel()), {"joints": block})
    np.testing.assert_array_equal(PowerBlock.concatenate(power).grid_power, whole.grid_power)


def test_a_payload_that_is_set_while_joint_states_wait_counts_after_them():
    pipeline, block = EnergyPipeline(robots.two_link()), robots.joint_block(
        np.arange(50) / 500, np.full((50, 2), 0.4), np.zeros((50, 2))
    )  # fmt: skip
    parts = [pipeline.step(joints=block[slice(0, 1)]), pipeline.step(joints=block[slice(1, 30)])]
    assert parts[1].torque is None
    pipeline.torque.set_payload(payload("fore", 2.0))
    parts += [pipeline.step(joints=block[slice(30, 50)]), pipeline.flush()]
    mass = np.concatenate([out.power.payload_mass for out in parts if out.power is not None])
    np.testing.assert_array_equal(mass, np.where(np.arange(50) < 30, 0.0, 2.0))


def test_a_restart_drops_joint_states_that_wait():
    pipeline, block = EnergyPipeline(robots.one_wheel()), spin(3.0, rate=500.0)
    pipeline.step(joints=block[slice(0, 30)])
    pipeline.step(joints=block[slice(30, 35)])
    pipeline.restart()
    assert pipeline.flush().power is None
