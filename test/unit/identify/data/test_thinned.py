"""Recordings of any length in bounded memory, and seen with another model."""

from dataclasses import fields, replace

import numpy as np
import pytest

from places import ROOT
from robot_energy.model import load
from robot_energy.model.drive_models import LossDrive
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.joint import JointGear, JointThermal
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import EffortMeaning, Quality
from robot_energy_identify.data.bags import Bag, Kept, folds_of
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.data.thinned import LONGEST_STEP, Thinned
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.total_sums import sums

BAG, MODEL = ROOT / "bags/kr16_cold", load("kr16")
TORQUE = EffortMeaning.MOTOR_TORQUE
MOST = 3000


def test_what_is_held_does_not_grow_with_the_length_of_a_recording():
    outputs: list[Output] = []
    replay(BAG, MODEL, ReplaySetup(settings=Settings(power_period=None)), on_output=outputs.append)
    length = 45_000_000_000
    held, samples, thinned = list[int](), 0, Thinned(MOST)
    for number in range(2):
        for output in outputs:
            later = {
                name: replace(block, stamp_ns=block.stamp_ns + number * length)
                for name in ("torque", "power", "meter", "temperatures")
                if (block := getattr(output, name)) is not None
            }
            thinned.take(Output(**later))
            samples += len(later.get("torque", ()))
        held.append(thinned.held)
    assert samples > 5 * MOST
    assert max(held) <= MOST
    torque, power, _, degc = thinned.blocks()
    assert torque is not None
    assert power is not None
    assert degc is not None
    assert samples / thinned.every == pytest.approx(len(torque), abs=1)
    np.testing.assert_array_equal(torque.stamp_ns, power.stamp_ns)
    assert np.asarray(power.deviation).size == 0
    assert len(degc) <= 2 * length * 1e-9
    arrays = [getattr(torque, one.name) for one in fields(torque)]
    assert all(one.base is None or one.base.nbytes <= one.nbytes for one in arrays)


def test_samples_stay_close_enough_for_friction():
    recording = read_recording(BAG, MODEL, TORQUE, most=10)
    assert recording.every > 1
    step = float(np.median(np.diff(recording.torque.stamp_ns))) * 1e-9
    assert 0.5 * LONGEST_STEP < step <= LONGEST_STEP
    whole = read_recording(BAG, MODEL, TORQUE)
    kept = whole.torque[np.arange(0, len(whole), recording.every)]
    np.testing.assert_array_equal(recording.torque.motor_torque_rigid, kept.motor_torque_rigid)
    energies = [sum(part.drawn.sum() for part in one.compared) for one in (recording, whole)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-3)


def test_another_model_sees_a_recording_as_if_the_bag_were_read_again():
    coulomb = [
        joint.model_copy(
            update={
                "friction": joint.friction.model_copy(
                    update={
                        "coulomb": joint.friction.coulomb.model_copy(
                            update={"value": 1.5 * joint.friction.coulomb.value}
                        )
                    }
                )
            }
        )
        for joint in MODEL.joints
    ]
    other = MODEL.changed(joints=coulomb)
    expected = read_recording(BAG, other, TORQUE)
    found = read_recording(BAG, MODEL, TORQUE).with_model(other)
    assert found.model is other
    for name in ("motor_torque", "grid_power", "motor_temperature_degc", "quality", "phase"):
        np.testing.assert_array_equal(getattr(found.power, name), getattr(expected.power, name))
    np.testing.assert_array_equal(found.compared[0].drawn, expected.compared[0].drawn)


def figures_of(**figures):
    return {key: PositiveFigure(value=value, tag="assumed") for key, value in figures.items()}


def geared():
    gear = JointGear(**figures_of(capacity=4000.0, motor_conductance=3.0, ambient_conductance=3.0))
    return MODEL.changed(joints=[joint.model_copy(update={"gear": gear}) for joint in MODEL.joints])


@pytest.mark.parametrize(("model", "effort"), [(MODEL, TORQUE), (geared(), EffortMeaning.NONE)])
def test_other_drives_and_another_cabinet_leave_torque_and_friction_as_they_are(model, effort):
    losses = LossDrive(**figures_of(constant=3.0, copper=0.7, linear=0.02, quadratic=1e-4))
    joints = [joint.model_copy(update={"losses": losses}) for joint in model.joints]
    loss = MODEL.cabinet.loss_dc.model_copy(update={"value": 80.0})
    cabinet = MODEL.cabinet.model_copy(update={"loss_dc": loss})
    other = model.changed(joints=joints, cabinet=cabinet, drive="loss_model")
    recording = read_recording(BAG, model, effort)
    found, expected = recording.with_model(other), read_recording(BAG, other, effort)
    assert found.power.friction_power is recording.power.friction_power
    assert not np.array_equal(found.power.grid_power, recording.power.grid_power)
    for one in fields(expected.power):
        if one.name == "deviation":
            continue
        np.testing.assert_array_equal(
            np.asarray(getattr(found.power, one.name)),
            np.asarray(getattr(expected.power, one.name)),
            err_msg=one.name,
        )


def test_temperatures_that_follow_losses_are_computed_again():
    cold = MODEL.cabinet.loss_dc.model_copy(update={"value": 80.0})

    def cabinet(model):
        return model.changed(cabinet=model.cabinet.model_copy(update={"loss_dc": cold}))

    recording = read_recording(BAG, MODEL, TORQUE)
    assert recording.differs_in_supply(cabinet(MODEL))
    power = recording.power
    guessed = replace(power, quality=power.quality | np.uint32(Quality.TEMPERATURE_ESTIMATED))
    assert not replace(recording, power=guessed).differs_in_supply(cabinet(MODEL))
    gears = geared()
    assert not recording.differs_in_supply(gears)
    assert replace(recording, model=gears).differs_in_supply(cabinet(gears))
    network = JointThermal(**figures_of(capacity=4000.0, conductance=6.0))
    joints = [joint.model_copy(update={"thermal": network}) for joint in gears.joints]
    estimated = gears.changed(joints=joints)
    assert not replace(recording, model=estimated).differs_in_supply(cabinet(estimated))


def test_a_kept_bag_goes_back_to_any_model():
    kept = Kept(read_recording(BAG, MODEL, TORQUE))
    friction = MODEL.joints[0].friction
    more = friction.coulomb.model_copy(update={"value": 2.0 * friction.coulomb.value})
    first = MODEL.joints[0].model_copy(
        update={"friction": friction.model_copy(update={"coulomb": more})}
    )
    rough = MODEL.changed(joints=[first, *MODEL.joints[1:]])
    loss = MODEL.cabinet.loss_dc.model_copy(update={"value": 80.0})
    hungry = MODEL.changed(cabinet=MODEL.cabinet.model_copy(update={"loss_dc": loss}))
    torques = [kept.with_model(model).power.motor_torque for model in (rough, hungry, MODEL)]
    assert not np.array_equal(torques[0], torques[1])
    assert torques[1] is torques[2] is kept.recording.power.motor_torque
    np.testing.assert_array_equal(kept.with_model(rough).power.motor_torque, torques[0])


def test_the_motion_of_a_thinned_bag_has_every_sample():
    bag = Bag(BAG, TORQUE, most=1000)
    bag = replace(bag, kept=Kept(bag.whole(MODEL)))
    (piece,) = bag.motion(MODEL, 5.0)
    (expected,) = Bag(BAG, TORQUE).motion(MODEL, 5.0)
    assert bag.whole(MODEL).every > 1
    assert len(expected) > 5.0 * 240
    for name, values in expected.__dict__.items():
        np.testing.assert_array_equal(getattr(piece, name), values)


def test_every_fold_has_the_pieces_of_motion_of_the_other_blocks():
    bag = Bag(BAG, TORQUE)
    bag = replace(bag, kept=Kept(bag.whole(MODEL)))
    begins = [part.stamp_ns[0] for part in bag.motion(MODEL, 100.0)]
    assert len(begins) == 5
    for number, fold in enumerate(folds_of([bag], [], [bag.whole(MODEL).span_ns])[1]):
        found = [part.stamp_ns[0] for part in fold.train[0].motion(MODEL, 100.0)]
        assert found == begins[:number] + begins[number + 1 :]


def test_minutes_are_spread_over_a_recording():
    recording = read_recording(BAG, MODEL, TORQUE)
    assert recording.spread(100.0) is recording
    long = replace(
        recording,
        torque=replace(recording.torque, stamp_ns=recording.torque.stamp_ns * 10),
        power=replace(recording.power, stamp_ns=recording.power.stamp_ns * 10),
    )
    some = long.spread(200.0)
    minutes = np.unique((some.power.stamp_ns - long.power.stamp_ns[0]) // 60_000_000_000)
    assert minutes.tolist() == [0, 2, 4]
    assert len(np.unique(some.power.segment)) == 3
    np.testing.assert_array_equal(some.torque.segment, some.power.segment)


def test_a_spread_recording_keeps_the_readings_that_its_minutes_need():
    recording = read_recording(BAG, MODEL, TORQUE)
    begin, meter = int(recording.torque.stamp_ns[0]), recording.meter

    def slowed(block):
        return replace(block, stamp_ns=begin + 10 * (block.stamp_ns - begin))

    long = replace(
        recording,
        torque=slowed(recording.torque),
        power=slowed(recording.power),
        meter=slowed(meter),
    )
    some = long.spread(200.0)
    assert len(meter) / 3 < len(some.meter) < 0.7 * len(meter)
    for delay in (-0.4, 0.0, 0.4):
        found = [
            sums(drive_data([part.with_meter_earlier(delay)], [None], True), MODEL)
            for part in (some, replace(some, meter=long.meter))
        ]
        np.testing.assert_array_equal(found[0].measured, found[1].measured)
        np.testing.assert_allclose(found[0].shaft, found[1].shaft, rtol=1e-12)
