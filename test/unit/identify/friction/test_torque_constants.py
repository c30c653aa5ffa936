"""Torque constants that fall, recovered from torque in a warm-up, and refused without one."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.drive_models import LossDrive
from robot_energy.physics.friction import viscous_law
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, PowerBlock, TorqueBlock
from robot_energy_identify.bounds import identified
from robot_energy_identify.cabinet.link_readings import _change_of_drives, _Error
from robot_energy_identify.check.evidence import Remarks, evidence_of
from robot_energy_identify.data.bags import EVER, Fold
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.drive_data import DriveData, shaft_torque, winding_torque
from robot_energy_identify.drives.drives import AxisSamples
from robot_energy_identify.drives.losses import TERMS, fit_loss_map
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.friction.torque_constants import (
    BY_CURRENT,
    FallingConstant,
    at_shaft,
    find_falls,
    fit_fall,
    with_falls,
)
from robot_energy_identify.friction_and_thermal import find_friction
from robot_energy_identify.run_all import FullIdentification
from robot_energy_identify.stats.held_out_energy import _shaft, held_out_energy
from robot_energy_identify.stats.systematic import TORQUE
from robot_energy_identify.steps import Step
from robots import figure
from warm_wheel import COULOMB, readings, turning, viscous, wheel

FALL = 0.001  # 1/K
PERIOD = 0.04  # s


def recorded(seconds, degc, seed, fall=FALL, load=2.0, run=0, given=None):
    """One axis that lifts and turns while its motor warms between two temperatures.

    Args:
        load: Size of the torque of its bodies; the model is ``given`` another one.
    """
    rng = np.random.default_rng(seed)
    count = round(seconds / PERIOD)
    time = PERIOD * np.arange(count)
    speed = np.repeat(rng.uniform(20.0, 100.0, -(-count // 25)), 25)[:count]
    speed *= np.where((time // 2.0) % 2 == 0, 1.0, -1.0)
    rigid = np.repeat(rng.standard_normal(-(-count // 25)), 25)[:count]
    motor = np.linspace(*degc, count)
    viscous = 0.002 + 0.02 * np.exp(-motor / 25.0)
    friction = 0.3 * np.sign(speed) + viscous * speed + 0.05 * np.sign(speed) * np.abs(load * rigid)
    read = (load * rigid + friction) / (1.0 - fall * (motor - 20.0))
    known = (load if given is None else given) * rigid
    torque = read - known + 0.05 * rng.standard_normal(count)
    return FrictionData(
        "axle", speed, torque, motor, 10_000 * run + np.arange(count) // 125,
        np.full(count, run), np.empty((count, 0)), rigid=known,
    )  # fmt: skip


def test_a_fall_is_found_in_a_warm_up():
    fall = fit_fall(recorded(1200.0, (20.0, 70.0), 1), "here").fall
    assert fall.value == pytest.approx(FALL, rel=0.03)
    assert 0.0 < fall.std < 0.02 * FALL
    assert (fall.tag, fall.source) == ("identified", "here")


def test_bodies_of_another_mass_do_not_look_like_magnets():
    found = fit_fall(recorded(1200.0, (20.0, 70.0), 2, given=1.6))
    assert found.fall.value == pytest.approx(FALL, rel=0.05)
    with pytest.raises(NotIdentifiableError, match="grows by"):
        fit_fall(recorded(1200.0, (20.0, 70.0), 2, fall=0.0, given=1.6))


def test_a_payload_of_the_warm_recording_does_not_look_like_magnets():
    parts = [
        recorded(600.0, (20.0, 32.0), 3, fall=0.0),
        recorded(600.0, (50.0, 62.0), 4, fall=0.0, load=2.1, given=2.0, run=1),
    ]
    with pytest.raises(NotIdentifiableError, match="grows by"):
        fit_fall(FrictionData.concatenate(parts))


def test_soaked_recordings_do_not_show_it():
    parts = [
        recorded(60.0, (degc, degc + 2.0), run, run=run)
        for run, degc in enumerate((20.0, 40.0, 60.0))
    ]
    with pytest.raises(NotIdentifiableError, match="warms by 2 K"):
        fit_fall(FrictionData.concatenate(parts))


def test_a_fall_that_no_magnet_has_is_refused():
    with pytest.raises(NotIdentifiableError, match="grows by"):
        fit_fall(recorded(1200.0, (20.0, 70.0), 5, fall=0.008))


def effort(meaning):
    return SimpleNamespace(replay=SimpleNamespace(effort=meaning))


def test_a_torque_sensor_shows_no_magnets():
    axes = [recorded(1200.0, (20.0, 70.0), 1)]
    assert not find_falls([effort(EffortMeaning.JOINT_TORQUE)], axes, "")
    (found,) = find_falls([effort(EffortMeaning.MOTOR_CURRENT)], axes, "")
    assert found.name == "axle"
    (joint,) = with_falls(wheel(), [found]).joints
    assert joint.torque_constant_fall == found.fall
    assert with_falls(wheel(), []).joints[0].torque_constant_fall is None


def recording_of(model, degc, moving=True, swings=False):
    """Seven newton metres by the current, for three seconds, or swings of a minute."""
    pipeline = EnergyPipeline(model, Settings(effort=EffortMeaning.MOTOR_TORQUE))
    block = turning(3.0, effort=np.full(6, 7.0))
    if swings:
        block = turning(60.0, period=0.02, effort=np.zeros(3000))
        turn = 2.0 * (np.arange(3000) * 0.02)[:, None]
        block = replace(block, joint_position=2.0 * np.sin(turn), joint_velocity=4.0 * np.cos(turn))
    if not moving:
        still = np.zeros_like(block.joint_velocity)
        block = replace(block, joint_position=still, joint_velocity=still)
    outputs = pipeline.step(block, readings(60, degc)), pipeline.flush()
    torque, power = (
        kind.concatenate([part for one in outputs if (part := getattr(one, name)) is not None])
        for kind, name in ((TorqueBlock, "torque"), (PowerBlock, "power"))
    )
    found = Recording(Path(), model, torque, power, None, "", ())
    return replace(found, **vars(effort(EffortMeaning.MOTOR_TORQUE)))


def falling(fall):
    return with_falls(wheel(), [FallingConstant("axle", identified(fall, None, ""))])


def test_recordings_at_the_shaft():
    recording = recording_of(wheel(), 70.0)
    (found,) = at_shaft([recording], falling(0.002))
    np.testing.assert_allclose(found.torque.motor_torque_measured, 0.9 * 7.0, rtol=1e-15)
    assert at_shaft([recording], wheel()) == [recording]


@pytest.mark.parametrize("meaning", [EffortMeaning.MOTOR_TORQUE, EffortMeaning.JOINT_TORQUE])
def test_friction_is_that_of_the_shaft_where_the_model_keeps_a_fall_that_no_warm_up_shows(meaning):
    """Soaked at 20 to 70 degC, 0.2 % per kelvin: read by current, 70 degC show 1.11 of it."""
    fall = 0.002 if meaning is EffortMeaning.MOTOR_TORQUE else 0.0
    parts = [swung(falling(0.002), degc, fall, meaning) for degc in (20.0, 45.0, 70.0)]
    found = find_friction(parts, parts[0].model, "bags")
    assert not found.falls
    (fit,) = found.axes
    for degc in (20.0, 45.0, 70.0):
        assert viscous_law(fit.law).viscous(degc) == pytest.approx(viscous(degc), rel=0.01)
    assert fit.coulomb == pytest.approx(COULOMB, rel=0.01)
    (joint,) = found.write(parts[0].model, "bags").joints
    assert joint.torque_constant_fall.value == 0.002


def test_a_warm_up_shows_the_whole_fall_whatever_the_model_has():
    warm_up = swung(falling(0.002), np.linspace(20.0, 70.0, 60)[:, None], 0.001, BY_CURRENT[0])
    (found,) = find_friction([warm_up], warm_up.model, "bags").falls
    assert found.fall.value == pytest.approx(0.001, rel=0.02)


def swung(model, degc, fall, meaning):
    """Swings of a minute with the friction of the wheel, read by a current if it falls."""
    recording = recording_of(model, degc, swings=True)
    torque, speed = recording.torque, recording.torque.motor_velocity
    motor = recording.power.motor_temperature_degc
    friction = COULOMB * np.sign(speed) + viscous(motor) * speed
    read = (torque.motor_torque_rigid + friction) / (1.0 - fall * (motor - 20.0))
    torque = replace(torque, motor_torque_measured=read)
    return replace(recording, torque=torque, **vars(effort(meaning)))


def test_windings_at_rest_are_heated_by_the_current_that_was_read():
    recording = recording_of(falling(0.005), 120.0, moving=False)
    np.testing.assert_allclose(shaft_torque(recording), 3.5, rtol=1e-15)
    np.testing.assert_allclose(winding_torque(recording, shaft_torque(recording)), 7.0, rtol=1e-15)
    plain = recording_of(wheel(), 120.0, moving=False)
    torque = shaft_torque(plain)
    assert winding_torque(plain, torque) is torque


def test_drives_are_identified_with_the_current_of_warm_motors():
    hot, none = np.full((4, 1), 120.0), np.zeros((4, 1))
    constants = TorqueConstants(np.array([0.005]), 20.0)  # half is left
    torque = np.array([[1.0], [2.0], [-1.0], [0.0]])
    data = DriveData(
        ("axle",), np.arange(4), np.zeros(4, int), np.zeros(4, int), none, torque, hot, none,
        (None,), (MeterLimits(),), np.zeros(4, bool), none, constants=constants,
    )  # fmt: skip
    heat = data.loss_columns()[:, 0, TERMS.index("copper")]
    np.testing.assert_allclose(heat, 1.39 * 4.0 * torque[:, 0] ** 2, rtol=1e-14)
    np.testing.assert_array_equal(data.shaft_power, none)


def test_a_loss_map_has_knots_of_that_current():
    rng = np.random.default_rng(1)
    speed, torque = rng.uniform(-100.0, 100.0, 2000), rng.uniform(-3.0, 3.0, 2000)
    power = torque * speed + 5.0 * np.abs(2.0 * torque)
    given = speed, torque, np.full(2000, 120.0), power, np.arange(2000) // 5
    cold, warm = (
        fit_loss_map(AxisSamples(*given, constants=one))
        for one in (None, TorqueConstants(np.array([0.005]), 20.0))
    )
    np.testing.assert_allclose(warm.motor_torque, 2.0 * np.array(cold.motor_torque), rtol=1e-4)
    np.testing.assert_allclose(warm.loss, cold.loss, atol=1e-3)


def test_shaft_energy_is_that_between_samples():
    """Of half a second at 40 rad/s, from 1 N m to -1 N m: given and taken back."""
    found = recording_of(wheel(), 120.0)
    turned = (-1.0) ** np.arange(len(found.torque))[:, None]
    assert _shaft(found, turned, EVER) == pytest.approx((0.0, 20.0))


def test_held_out_torque_is_compared_at_the_shaft():
    """Half is left: 3.5 N m at 40 rad/s for half a second, both ends with a full window."""
    bag = SimpleNamespace(name="soaked", spans=(EVER,))
    bag.whole = lambda model: recording_of(model, 120.0)
    bag.read = lambda model: [bag.whole(model)]
    bag.with_meter_undone = lambda *undone: bag
    fitted = FullIdentification(wheel(), (Step("friction", None, "", falling(0.005)),))
    (entry,) = held_out_energy("test", [Fold((bag,), (bag,))], fitted).tested
    np.testing.assert_allclose(entry.motor_torque, 3.5, rtol=1e-15)
    assert entry.shaft == pytest.approx(3.5 * 40.0 * 0.5) == pytest.approx(entry.shaft_either_way)
    friction = COULOMB + viscous(120.0) * 40.0
    for stage, read in (("given", 7.0), ("friction", 3.5)):
        expected = (read - friction) / read
        assert entry.predictions[stage].torque_error == pytest.approx(expected, rel=0.01)


def test_check_sees_the_torque_of_the_shaft():
    recording = recording_of(falling(0.005), 120.0)
    blocks = recording.torque, recording.power[slice(2, None)], None
    seen, unknown = (
        evidence_of(recording.model, meaning, *blocks, Remarks()).motor_torque[:, 0]
        for meaning in (EffortMeaning.MOTOR_TORQUE, EffortMeaning.NONE)
    )
    np.testing.assert_allclose(seen, [7.0, 7.0, *4 * [3.5]], rtol=1e-15)
    assert np.isnan(unknown).all()


def test_errors_of_torque_constants_move_the_losses_of_the_current():
    """Half is left: windings are heated by 4 times the square of the torque at the shaft."""
    cold, warm = (recording_of(lossy(model), 120.0) for model in (wheel(), falling(0.005)))
    change = [_change_of_drives(part, _Error(TORQUE, 0, np.zeros((3, 1)))) for part in (cold, warm)]
    heat = 0.1 * 1.39 * warm.power.motor_torque[:, 0] ** 2
    expected = cold.sensors.std.torque * 2.0 * (4.0 - 1.0) * heat
    np.testing.assert_allclose(change[1] - change[0], expected, rtol=1e-9)


def lossy(model):
    names = "constant", "linear", "quadratic", "copper", "copper_temperature_coefficient"
    values = 0.0, 0.0, 0.0, 0.1, 0.0039
    losses = {name: figure(value) for name, value in zip(names, values, strict=True)}
    return model.with_joints("losses", {"axle": LossDrive.model_validate(losses)})
