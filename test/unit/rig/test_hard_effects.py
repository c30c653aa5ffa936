"""Effects that models have no term for, against cases solved by hand, and drawn plants."""

from dataclasses import fields, replace

import numpy as np
import pytest

from plants import PROGRAM, two_link_profile
from robot_energy.foundation.errors import RigError
from robot_energy.model import load, save
from robot_energy.timeline.blocks import sum_over_joints
from robot_energy_plan.motion import Trajectory, random_program
from robot_energy_rig import (
    HardEffects,
    RigConfig,
    Sensors,
    VirtualRig,
    load_profile,
    random_profile,
)
from robot_energy_rig.config import HARD
from robot_energy_rig.plant import PlantFriction
from robot_energy_rig.sensors import LowPass
from robot_energy_rig.virtual_rig import Fan

DT = 0.004


@pytest.fixture
def profile(tmp_path):
    return two_link_profile(tmp_path)


def test_hard_switches_on_everything_and_the_default_none_of_it():
    switches = {f.name for f in fields(RigConfig) if isinstance(f.default, bool)}
    assert {name for name in switches if getattr(RigConfig.hard(), name)} == switches - {"creep"}
    assert {name for name in switches if not getattr(RigConfig(), name)} == {*HARD, "creep"}


def test_the_power_sums_to_the_grid_with_everything_on():
    profile = load_profile("kr16")
    robot, _ = profile.mechanics()
    program = random_program(profile.motion_limits(robot), 3)
    rig = VirtualRig(profile, program, RigConfig.hard(), start_temperature_degc=50.0)
    truth = rig.step(3000).truth
    joints = (
        truth.rigid_power
        + truth.friction_power
        + truth.iron_loss
        + truth.copper_loss
        + truth.inverter_loss
    )
    total = sum_over_joints(joints) + truth.loss_dc + truth.loss_grid + truth.rectifier_loss
    total += truth.brake_power + truth.capacitor_power
    np.testing.assert_allclose(truth.grid_power, total, rtol=1e-12, atol=1e-9)


def test_any_cutting_gives_the_same_bytes_with_everything_on():
    profile = load_profile("kr16")
    robot, _ = profile.mechanics()
    program = random_program(profile.motion_limits(robot), 3)
    whole, cut = (VirtualRig(profile, program, RigConfig.hard(), 5) for _ in range(2))
    one = whole.step(900).joints
    parts = [cut.step(n).joints for n in (1, 7, 300, 592)]
    for name in ("joint_position", "joint_velocity", "measured_motor_torque"):
        together = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(together, getattr(one, name))


def test_presliding_rises_by_the_exponential_of_dahl_and_holds_at_rest(profile):
    config = RigConfig.plain().having("presliding")
    friction = PlantFriction(profile, config, DT)
    speed = np.zeros((50, 2))
    speed[:30] = 5.0
    torque = friction.torque(speed, np.zeros((50, 2)), np.full(2, 60.0))
    angle = 5.0 * DT * np.arange(1, 31)
    viscous = friction.viscous(np.full(2, 60.0)) * 5.0
    expected = profile.coulomb * (1 - np.exp(-angle / 0.3))[:, None] + viscous
    np.testing.assert_allclose(torque[:30], expected, rtol=1e-12)
    np.testing.assert_allclose(torque[30:], expected[-1:] - viscous + np.zeros((20, 1)), rtol=1e-9)


def test_presliding_never_makes_energy(profile):
    friction = PlantFriction(profile, RigConfig.plain().having("presliding"), DT)
    time = np.arange(5000) * DT
    speed = np.stack([3.0 * np.sin(7 * time), 20 * np.sin(2 * time)], axis=1)
    torque = friction.torque(speed, np.zeros_like(speed), np.full(2, 60.0))
    work = np.cumsum(torque * speed, axis=0) * DT
    assert (work > -1e-9).all()


def test_the_bent_viscous_friction_and_the_falling_coulomb_friction(profile):
    config = RigConfig.plain().having("viscous_exponent", "coulomb_temperature")
    friction = PlantFriction(profile, config, DT)
    speed = np.array([[150.0, -150.0], [75.0, -300.0]])
    torque = friction.torque(speed, np.zeros((2, 2)), np.full(2, 60.0))
    viscous = friction.viscous(np.full(2, 60.0))
    dry = profile.coulomb * (1 - 0.003 * 20)
    np.testing.assert_allclose(torque[0], [1, -1] * (dry + viscous * 150.0))
    bent = 150.0 * np.array([0.5**0.8, 2.0**0.8])
    np.testing.assert_allclose(torque[1], [1, -1] * (dry + viscous * bent))
    hot = friction.torque(np.full((1, 2), 1e-9), np.zeros((1, 2)), np.full(2, 500.0))
    np.testing.assert_allclose(hot[0], profile.coulomb * 0.4, rtol=1e-3)


def test_a_held_elastic_joint_winds_up_by_its_load(tmp_path):
    plant = replace(random_profile("kr16", 1), hard=HardEffects(elastic_deflection=2e-3))
    robot, _ = plant.mechanics()
    pose = np.array([0.0, -0.5, 0.7, 0.1, 0.4, 0.0])

    class Pose:
        n_joints = 6

        def sample(self, time):
            still = np.zeros((len(time), 6))
            return Trajectory(np.tile(pose, (len(time), 1)), still, still)

    rig = VirtualRig(plant, Pose(), RigConfig.plain().having("elastic_joints"))
    seen = rig.step(10).joints
    load_torque = robot.joint_torque(pose[None], np.zeros((1, 6)), np.zeros((1, 6)))[0]
    expected = pose + load_torque * 2e-3 / robot.limits.effort
    np.testing.assert_allclose(seen.joint_position[5], expected, atol=1e-12)
    np.testing.assert_allclose(seen.joint_velocity, 0.0, atol=1e-9)


def test_springs_of_elastic_joints_give_back_what_they_took():
    plant = replace(random_profile("kr16", 1), hard=HardEffects(elastic_deflection=3e-3))
    robot, _ = plant.mechanics()
    program = random_program(plant.motion_limits(robot), 2, dwell=0.5)
    energies = []
    for config in (RigConfig.plain(), RigConfig.plain().having("elastic_joints")):
        truth = VirtualRig(plant, program, config, rate_hz=1000.0).step(20_000).truth
        energies.append(np.cumsum(sum_over_joints(truth.rigid_power)) * 1e-3)
    rigid, elastic = energies
    assert np.abs(elastic - rigid).max() > 1.0
    resting = np.flatnonzero(np.abs(truth.joint_velocity).max(axis=1) == 0)
    # Held, the springs differ by their static wind-up alone: half torque times deflection.
    held = robot.joint_torque(
        truth.joint_position[resting], *(np.zeros((len(resting), 6)) for _ in range(2))
    )
    stored = 0.5 * (held**2 / robot.limits.effort * 3e-3).sum(axis=1)
    difference = (elastic - rigid)[resting] - stored
    assert np.ptp(difference) < 0.02 * np.abs(elastic - rigid).max()


def test_elastic_joints_need_effort_limits(profile):
    with pytest.raises(RigError) as caught:
        VirtualRig(profile, PROGRAM, RigConfig.plain().having("elastic_joints"))
    assert "effort limit" in str(caught.value)


def test_the_low_pass_follows_a_step_by_its_time_constant():
    filtered = LowPass(0.1, 0.01)
    assert filtered.step(np.zeros(3)).tolist() == [0.0, 0.0, 0.0]
    step = np.concatenate([filtered.step(np.ones(4)), filtered.step(np.ones(6))])
    np.testing.assert_allclose(step, 1 - np.exp(-0.1 * np.arange(1, 11)))


def test_a_filtered_meter_and_velocity_lag(profile):
    plain = VirtualRig(profile, PROGRAM, RigConfig.plain()).step(2500)
    config = RigConfig.plain().having("velocity_filter", "meter_filter")
    slow = VirtualRig(profile, PROGRAM, config).step(2500)
    speed = plain.joints.joint_velocity[:, 0]

    def error(lag):
        return np.abs(slow.joints.joint_velocity[20:, 0] - np.roll(speed, lag)[20:]).mean()

    assert min(range(8), key=error) in (2, 3)  # 10 ms at 250 Hz
    assert plain.meter is not None
    assert slow.meter is not None
    assert np.ptp(slow.meter.power) < 0.9 * np.ptp(plain.meter.power)
    np.testing.assert_allclose(slow.meter.power.mean(), plain.meter.power.mean(), rtol=0.1)


def test_temperature_sensors_keep_their_offsets(profile):
    config = RigConfig.plain().having("temperature_error")
    seen = []
    for seed in (1, 2):
        rig = VirtualRig(profile, PROGRAM, config, seed, start_temperature_degc=30.0)
        block = rig.step(2500).temperatures
        assert block is not None
        offset = block.motor_temperature_degc - 30.0
        np.testing.assert_allclose(offset, np.tile(offset[0], (len(offset), 1)), atol=1e-9)
        seen.append(offset[0])
    assert np.abs(seen[0] - seen[1]).min() > 1e-3
    none = replace(config, sensors=Sensors(temperature_offset=0.0))
    block = VirtualRig(profile, PROGRAM, none, 1, 30.0).step(500).temperatures
    assert block is not None
    np.testing.assert_allclose(block.motor_temperature_degc, 30.0)


def test_the_fan_switches_with_hysteresis():
    fan = Fan(HardEffects(fan_power=25.0, fan_on_degc=45.0, fan_off_degc=40.0))
    course = [30.0, 44.0, 46.0, 42.0, 39.0, 43.0]
    assert [fan.power(np.array([20.0, degc])) for degc in course] == [0, 0, 25, 25, 0, 0]


@pytest.mark.parametrize(
    "wrong",
    [
        {"presliding_angle": 0.0},
        {"elastic_deflection": -1.0},
        {"viscous_exponent": 1.5},
        {"viscous_speed": 0.0},
        {"coulomb_fall": -0.1},
        {"fan_on_degc": 30.0},
    ],
)
def test_figures_that_make_no_sense_are_refused(wrong):
    with pytest.raises(RigError):
        HardEffects(**wrong)


FIGURES = [
    name for name, value in vars(load_profile("kr16")).items() if isinstance(value, np.ndarray)
]


def test_one_seed_gives_one_plant_and_another_seed_another():
    one, same, other = (random_profile("kr16", seed) for seed in (7, 7, 8))
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
    assert one.supply == same.supply != other.supply
    assert one.hard == same.hard != other.hard
    assert (one.coulomb != other.coulomb).all()


def times(figure, factor):
    return figure.model_copy(update={"value": figure.value * factor})


def test_a_drawn_plant_does_not_depend_on_the_models_friction_or_losses(tmp_path):
    model = load("kr16")
    joints = [
        joint.model_copy(
            update={
                "friction": joint.friction.model_copy(
                    update={"coulomb": times(joint.friction.coulomb, 3.0)}
                )
            }
        )
        for joint in model.joints
    ]
    cabinet = model.cabinet.model_copy(update={"loss_grid": times(model.cabinet.loss_grid, 2.0)})
    changed = model.model_copy(update={"joints": joints, "cabinet": cabinet})
    save(changed, tmp_path / "changed.yaml")
    one, other = random_profile("kr16", 4), random_profile(str(tmp_path / "changed.yaml"), 4)
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.supply == other.supply


def test_drawn_plants_spread_about_the_class():
    drawn = np.array([random_profile("kr16", seed).coulomb for seed in range(40)])
    shipped = load_profile("kr16").coulomb
    ratio = drawn / shipped
    assert np.quantile(np.log(ratio), 0.9) - np.quantile(np.log(ratio), 0.1) > np.log(2.0)


@pytest.mark.parametrize("name", ["kr16", "ur5e", "ur3e", "irb4600", "mantis", "testbed"])
def test_every_shipped_body_has_drawn_plants_that_run(name):
    plant = random_profile(name, 11)
    robot, _ = plant.mechanics()
    program = random_program(plant.motion_limits(robot), 1)
    truth = VirtualRig(plant, program, RigConfig.hard()).step(500).truth
    assert np.isfinite(truth.grid_power).all()
    assert (truth.grid_power > 0).all()


def test_what_cannot_be_drawn_is_refused(profile):
    with pytest.raises(RigError):
        random_profile("kr16", -1)
    with pytest.raises(RigError):
        random_profile(profile.body, 0)


def test_the_lag_of_thermometers_runs_as_fast_as_the_temperatures(profile):
    """At 100 times nature's speed a lag of 60 s is one of 0.6 s."""
    warming = replace(
        RigConfig.plain().having("warming"),
        thermal_speedup=100.0,
        sensors=Sensors(temperature_offset=0.0, temperature_lag=60.0),
    )
    rises = []
    for config in (warming, warming.having("temperature_error")):
        readings = VirtualRig(profile, PROGRAM, config).step(2500).temperatures
        assert readings is not None
        rises.append(np.ptp(readings.motor_temperature_degc, axis=0))
    assert (rises[0] > 0.5).all()
    assert (rises[1] > 0.7 * rises[0]).all()
