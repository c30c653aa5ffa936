"""The rig as a whole, on plants small enough to work out by hand and on the KR 16 class."""

from dataclasses import fields, replace

import numpy as np
import pytest

import robots
from plants import LIMITS, PROGRAM, ROTOR, TRANSMISSION, two_link_profile
from refusals import refused
from robot_energy.foundation.errors import RigError
from robot_energy.timeline.blocks import MeterMeaning, sum_over_joints
from robot_energy_plan.motion import Program
from robot_energy_rig import RigConfig, Sensors, VirtualRig, load_profile

PERFECT = (
    "encoder",
    "velocity_noise",
    "torque_noise",
    "stamp_jitter",
    "temperature_sensor",
    "meter_error",
)
C1, C2, L1, G = robots.C1, robots.C2, robots.L1, robots.G


@pytest.fixture
def profile(tmp_path):
    return two_link_profile(tmp_path)


def mechanical_energy(q, qd):
    """Kinetic and potential energy of the two-link arm with its rotors, by hand. [J]"""
    a, b = q[:, 0], q[:, 0] + q[:, 1]
    va, vb = qd[:, 0], qd[:, 0] + qd[:, 1]
    kinetic = 0.5 * (robots.M1 * C1**2 + robots.I1) * va**2
    square = (L1 * va) ** 2 + (C2 * vb) ** 2 + 2 * L1 * C2 * va * vb * np.cos(q[:, 1])
    kinetic += 0.5 * robots.M2 * square + 0.5 * robots.I2 * vb**2
    kinetic += 0.5 * ((qd @ TRANSMISSION.T) ** 2 * ROTOR).sum(axis=1)
    potential = robots.M1 * G * C1 * np.sin(a) + robots.M2 * G * (L1 * np.sin(a) + C2 * np.sin(b))
    return kinetic + potential


def spent(truth):
    """Everything that the grid pays for, by the books of the truth. [W]"""
    per_joint = (
        truth.rigid_power
        + truth.friction_power
        + truth.iron_loss
        + truth.copper_loss
        + truth.inverter_loss
    )
    return (
        sum_over_joints(per_joint)
        + truth.loss_dc
        + truth.loss_grid
        + truth.rectifier_loss
        + truth.brake_power
        + truth.capacitor_power
    )


def test_books_balance_at_every_sample(profile):
    truth = VirtualRig(profile, PROGRAM).step(3000).truth
    np.testing.assert_allclose(truth.grid_power, spent(truth), rtol=1e-12, atol=1e-9)
    for name in (
        "friction_power",
        "iron_loss",
        "copper_loss",
        "inverter_loss",
        "brake_power",
        "rectifier_loss",
    ):
        assert (getattr(truth, name) >= 0).all()
    assert truth.brake_power.max() > 0
    assert truth.capacitor_power.min() < 0 < truth.capacitor_power.max()


def test_rigid_power_becomes_kinetic_and_potential_energy(profile):
    rate = 2000.0
    truth = VirtualRig(profile, PROGRAM, rate_hz=rate).step(6000).truth
    energy = mechanical_energy(truth.joint_position, truth.joint_velocity)
    power = truth.rigid_power.sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) / rate)])
    np.testing.assert_allclose(work, energy - energy[0], atol=2e-4 * np.ptp(energy))


def test_grid_energy_is_all_losses_plus_what_is_stored(profile):
    rate = 1000.0
    truth = VirtualRig(profile, PROGRAM, rate_hz=rate).step(4321).truth
    losses = (truth.friction_power + truth.iron_loss + truth.copper_loss + truth.inverter_loss).sum(
        axis=1
    )
    losses += truth.loss_dc + truth.loss_grid + truth.rectifier_loss + truth.brake_power
    # A sample stands for half a period on both sides: trapezoid plus the two ends.
    stored = np.diff(mechanical_energy(truth.joint_position, truth.joint_velocity)[[0, -1]])[0]
    ends = 0.5 * (truth.rigid_power[0] + truth.rigid_power[-1]).sum() / rate
    link = 0.5 * profile.supply.capacitance * (truth.bus_voltage[-1] ** 2 - 300.0**2)
    total = truth.grid_power.sum() / rate
    assert total == pytest.approx(losses.sum() / rate + stored + ends + link, rel=1e-4)


def test_all_off_is_the_computation_by_hand(profile):
    output = VirtualRig(profile, PROGRAM, RigConfig.plain(), rate_hz=500.0).step(2000)
    truth = output.truth
    expected = PROGRAM.sample(np.arange(2000) * 2_000_000 * 1e-9)
    np.testing.assert_array_equal(output.joints.joint_position, expected.joint_position)
    np.testing.assert_array_equal(output.joints.joint_velocity, expected.joint_velocity)
    np.testing.assert_array_equal(output.joints.stamp_ns, truth.stamp_ns)
    speed = expected.joint_velocity @ TRANSMISSION.T
    viscous = np.array([6e-5, 3e-5]) * np.sqrt(profile.lubricant[0].viscosity(60.0) / 150.0)
    friction = np.array([0.02, 0.01]) * np.sign(speed) + viscous * speed
    # Two-link dynamics by hand, both axes against the vertical plane.
    q, qd, qdd = expected.joint_position, expected.joint_velocity, expected.joint_acceleration
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    m22 = robots.M2 * C2**2 + robots.I2
    m12 = m22 + robots.M2 * L1 * C2 * cosine
    m11 = (
        robots.M1 * C1**2 + robots.I1 + robots.M2 * L1**2 + m22 + (2 * robots.M2 * L1 * C2 * cosine)
    )
    h = robots.M2 * L1 * C2 * sine
    g2 = robots.M2 * G * C2 * np.cos(q[:, 0] + q[:, 1])
    g1 = (robots.M1 * C1 + robots.M2 * L1) * G * np.cos(q[:, 0]) + g2
    joint = np.stack(
        [
            m11 * qdd[:, 0] + m12 * qdd[:, 1] - h * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2) + g1,
            m12 * qdd[:, 0] + m22 * qdd[:, 1] + h * qd[:, 0] ** 2 + g2,
        ],
        axis=1,
    )
    torque = joint @ np.linalg.inv(TRANSMISSION) + (qdd @ TRANSMISSION.T) * ROTOR + friction
    np.testing.assert_allclose(truth.motor_torque, torque, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(output.joints.measured_motor_torque, torque, rtol=1e-9, atol=1e-11)
    demand = (torque * speed).sum(axis=1) + 3.0
    np.testing.assert_allclose(truth.grid_power, np.maximum(demand, 0) + 30.0, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(truth.brake_power, np.maximum(-demand, 0), rtol=1e-9, atol=1e-8)
    assert np.ptp(truth.motor_temperature_degc) == 0


def test_holding_against_gravity_costs_copper(profile):
    pose = np.array([[0.4, -0.3]])
    hold = Program(pose, LIMITS, dwell=1.0)
    truth = (
        VirtualRig(profile, hold, RigConfig().without("warming"), start_temperature_degc=70.0)
        .step(100)
        .truth
    )
    a, b = 0.4, 0.1
    g2 = robots.M2 * G * C2 * np.cos(b)
    g1 = (robots.M1 * C1 + robots.M2 * L1) * G * np.cos(a) + g2
    torque = np.array([g1, g2]) @ np.linalg.inv(TRANSMISSION)
    current = torque / (np.array([0.2, 0.1]) * (1 - 1e-3 * 50))
    copper = 3 * np.array([0.5, 1.0]) * (1 + 4e-3 * 50) * current**2
    inverter = 1.5 * np.abs(current) + 0.04 * current**2
    np.testing.assert_allclose(truth.copper_loss, np.tile(copper, (100, 1)), rtol=1e-9)
    assert not truth.friction_power.any()
    assert not truth.rigid_power.any()
    expected = (copper.sum() + inverter.sum() + 3.0) / 0.98 + 30.0
    np.testing.assert_allclose(truth.grid_power, expected, rtol=1e-9)


def test_demagnetised_motors_read_too_much_and_heat_more(profile):
    quiet = RigConfig().without(*PERFECT, "warming")
    fresh = VirtualRig(
        profile, PROGRAM, quiet.without("demagnetisation"), start_temperature_degc=80.0
    ).step(500)
    weak = VirtualRig(profile, PROGRAM, quiet, start_temperature_degc=80.0).step(500)
    np.testing.assert_allclose(
        weak.joints.measured_motor_torque * (1 - 1e-3 * 60),
        fresh.joints.measured_motor_torque,
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        weak.truth.copper_loss * (1 - 1e-3 * 60) ** 2, fresh.truth.copper_loss, rtol=1e-12
    )


def test_friction_falls_with_gear_temperature_not_motor_temperature(profile):
    config = RigConfig().without("stribeck", "load_friction", "warming")
    cold, hot = (
        VirtualRig(profile, PROGRAM, config, start_temperature_degc=t).step(500).truth
        for t in (20.0, 80.0)
    )
    fast = np.abs(cold.motor_velocity) > 20
    dry = np.broadcast_to([0.02, 0.01], fast.shape)[fast]
    viscous = [(np.abs(t.motor_torque_friction[fast]) - dry) for t in (cold, hot)]
    oil = profile.lubricant[0]
    np.testing.assert_allclose(
        viscous[0] / viscous[1], np.sqrt(oil.viscosity(20.0) / oil.viscosity(80.0)), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("effect", "name"),
    [
        ("copper", "copper_loss"),
        ("iron", "iron_loss"),
        ("inverter", "inverter_loss"),
        ("capacitor", "capacitor_power"),
        ("rectifier", "rectifier_loss"),
    ],
)
def test_each_loss_can_be_switched_off(profile, effect, name):
    on = VirtualRig(profile, PROGRAM).step(1500).truth
    off = VirtualRig(profile, PROGRAM, RigConfig().without(effect)).step(1500).truth
    assert getattr(on, name).any()
    assert not getattr(off, name).any()
    np.testing.assert_allclose(off.grid_power, spent(off), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("effect", ["stribeck", "load_friction"])
def test_each_friction_term_can_be_switched_off(profile, effect):
    on, off = (
        VirtualRig(profile, PROGRAM, c).step(500).truth
        for c in (RigConfig(), RigConfig().without(effect))
    )
    assert (on.friction_power.sum(axis=0) > off.friction_power.sum(axis=0)).all()


def test_switching_one_sensor_leaves_the_others_alone(profile):
    full = VirtualRig(profile, PROGRAM, seed=5).step(500)
    less = VirtualRig(
        profile, PROGRAM, RigConfig().without("velocity_noise", "stamp_jitter"), seed=5
    ).step(500)
    np.testing.assert_array_equal(
        full.joints.measured_motor_torque, less.joints.measured_motor_torque
    )
    np.testing.assert_array_equal(full.meter.power, less.meter.power)
    assert (full.joints.joint_velocity != less.joints.joint_velocity).all()


def test_encoders_quantise_at_the_motor(profile):
    joints = VirtualRig(profile, PROGRAM, RigConfig.plain().having("encoder")).step(500).joints
    counts = joints.joint_position @ TRANSMISSION.T * 16384 / (2 * np.pi)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)


def test_noise_has_the_size_it_says(profile):
    output = VirtualRig(profile, PROGRAM, seed=1).step(20_000)
    error = (output.joints.joint_velocity - output.truth.joint_velocity) @ TRANSMISSION.T
    np.testing.assert_allclose(error.std(axis=0), 0.05, rtol=0.05)
    jitter = output.joints.stamp_ns - output.truth.stamp_ns
    assert jitter.std() == pytest.approx(50e3, rel=0.05)
    assert np.abs(jitter).max() <= 150e3
    assert (np.diff(output.joints.stamp_ns) > 0).all()


def test_temperatures_come_at_their_rate_rounded(profile):
    output = VirtualRig(profile, PROGRAM, start_temperature_degc=40.4, start_stamp_ns=7).step(1001)
    readings = output.temperatures
    np.testing.assert_array_equal(readings.stamp_ns, 7 + np.arange(5) * 10**9)
    np.testing.assert_array_equal(
        readings.motor_temperature_degc, np.rint(readings.motor_temperature_degc)
    )
    assert np.abs(readings.motor_temperature_degc - 40.4).max() < 2.0


def test_perfect_thermometers_follow_the_motor(profile):
    config = RigConfig(thermal_speedup=10.0).without("temperature_sensor")
    output = VirtualRig(profile, PROGRAM, config).step(5000)
    begins = np.searchsorted(output.truth.stamp_ns, output.temperatures.stamp_ns)
    np.testing.assert_allclose(
        output.temperatures.motor_temperature_degc,
        output.truth.motor_temperature_degc[begins],
        atol=0.2,
    )
    assert (output.temperatures.motor_temperature_degc[-1] > 21).any()


def test_perfect_meter_counts_every_joule(profile):
    config = RigConfig().without("meter_error")
    output = VirtualRig(profile, PROGRAM, config).step(2501)
    meter = output.meter
    assert meter.meaning is MeterMeaning.MEAN_OVER_INTERVAL
    np.testing.assert_array_equal(np.diff(meter.stamp_ns), 10**8)
    measured = (meter.power * meter.interval).sum()
    power = output.truth.grid_power
    weight = np.full(2501, 0.004)
    weight[[0, -1]] = 0.002
    assert meter.stamp_ns[-1] == output.truth.stamp_ns[-1]
    assert measured == pytest.approx((power * weight).sum(), rel=1e-9)


@pytest.mark.parametrize("rate", [1.0, 7.3, 50.0])
@pytest.mark.parametrize("meaning", [MeterMeaning.CUMULATIVE, MeterMeaning.MEAN_OVER_INTERVAL])
def test_meters_of_any_rate_and_meaning_agree(profile, rate, meaning):
    config = RigConfig(sensors=Sensors(meter_rate=rate, meter_meaning=meaning))
    config = config.without("meter_error")
    meter = VirtualRig(profile, PROGRAM, config).step(2600).meter
    truth = VirtualRig(profile, PROGRAM, config).step(2600).truth
    energy = (
        meter.energy[-1]
        if meaning is MeterMeaning.CUMULATIVE
        else (meter.power * meter.interval).sum()
    )
    rows = truth.stamp_ns <= meter.stamp_ns[-1]
    assert energy == pytest.approx(truth.grid_power[rows].sum() * 0.004, rel=2e-2)


def test_instantaneous_meter_reads_the_power(profile):
    config = RigConfig(sensors=Sensors(meter_meaning=MeterMeaning.INSTANTANEOUS))
    output = VirtualRig(profile, PROGRAM, config.without("meter_error")).step(1000)
    rows = np.searchsorted(output.truth.stamp_ns, output.meter.stamp_ns)
    np.testing.assert_allclose(output.meter.power, output.truth.grid_power[rows], rtol=1e-12)


def test_meter_errs_within_its_class(profile):
    config = RigConfig(sensors=Sensors(meter_noise=0.0, meter_class=0.01))
    gain = []
    for seed in range(20):
        meter = VirtualRig(profile, PROGRAM, config, seed).step(300).meter
        true = VirtualRig(profile, PROGRAM, config.without("meter_error"), seed).step(300).meter
        ratio = meter.power / true.power
        assert np.ptp(ratio) < 1e-12
        gain.append(ratio[0] - 1)
    assert np.abs(gain).max() <= 0.01
    assert np.ptp(gain) > 0.01


def test_speedup_warms_faster_and_moves_the_same(profile):
    slow = VirtualRig(profile, PROGRAM, RigConfig()).step(2500)
    fast = VirtualRig(profile, PROGRAM, RigConfig(thermal_speedup=8.0)).step(2500)
    np.testing.assert_array_equal(slow.truth.joint_position, fast.truth.joint_position)
    rise = [o.truth.motor_temperature_degc[-1] - 20.0 for o in (slow, fast)]
    assert (rise[1] > 5 * rise[0]).all()
    assert (rise[0] > 0).all()


def test_step_until_gives_what_is_due(profile):
    rig = VirtualRig(profile, PROGRAM, start_stamp_ns=1000)
    assert rig.step_until(999) is None
    assert len(rig.step_until(1000).joints) == 1
    assert rig.step_until(4_000_999) is None
    assert len(rig.step_until(20_001_000).joints) == 5
    assert rig.stamp_ns == 24_001_000


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"rate_hz": 0.0}, "the rate is 0.0 Hz"),
        ({"start_temperature_degc": np.zeros(3)}, "start temperature has shape"),
        ({"start_temperature_degc": 300.0}, "the start temperature is 300.0 degC"),
        ({"ambient_degc": float("nan")}, "the ambient is"),
        ({"config": RigConfig(thermal_speedup=1e5)}, "thermal_speedup is 100000"),
    ],
)
def test_figures_that_make_no_sense_are_refused(profile, arguments, text):
    with pytest.raises(RigError, match=text):
        VirtualRig(profile, PROGRAM, **arguments)


def test_a_program_for_another_robot_is_refused(profile):
    with refused(RigError, found="2 joints", expected="6"):
        VirtualRig(load_profile("kr16"), PROGRAM)
    with refused(RigError, found="0", expected="1"):
        VirtualRig(profile, PROGRAM).step(0)


def test_config_and_profile_refuse_nonsense(profile):
    with refused(RigError, found="'gravity'", expected="stribeck"):
        RigConfig().without("gravity")
    with refused(RigError, found="meter_rate"):
        Sensors(meter_rate=0)
    with refused(RigError, found="resistance", expected="2 axes"):
        replace(profile, resistance=np.ones(3))
    with refused(RigError, found="gear_capacity"):
        replace(profile, gear_capacity=np.zeros(2))
    with refused(RigError, found="360.0 V", expected="rising"):
        replace(profile.supply, chopper_on_voltage=360.0)


def test_plain_switches_everything_off_and_having_back_on():
    switches = [f.name for f in fields(RigConfig) if isinstance(f.default, bool)]
    assert len(switches) == 27
    assert not any(getattr(RigConfig.plain(), name) for name in switches)
    switches.remove("creep")  # what presliding keeps does not stay then
    assert RigConfig.plain().having(*switches) == RigConfig.hard()
