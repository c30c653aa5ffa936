"""What motors hold at rest, by hand and in the pipeline."""

import numpy as np
import pytest

import robots
from robot_energy.certainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.foundation.errors import ModelFileError
from robot_energy.model import validate
from robot_energy.physics.hold_torque import UNKNOWN, HoldTorque, LastMotion
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, PowerBlock
from robots import figure

RATE = 0.01  # s between samples


def arm(kept=0.0, carried=0.0, std=0.0, constant=None, copper=0.5, static=None, load=None):
    """The two-link arm with copper losses."""
    data = robots.two_link_data()
    data["drive"] = "loss_model"
    for joint in data["joints"]:
        joint["friction"]["coulomb"] = figure(0.2)
        if load is not None:
            joint["friction"] |= {"load_coulomb": figure(load), "load_saturation": figure(6.0)}
        joint["losses"] = {name: figure(0.0) for name in ("constant", "linear", "quadratic")}
        joint["losses"]["copper"] = figure(copper)
        joint["losses"]["copper_temperature_coefficient"] = figure(0.0)
        if constant:
            joint["torque_constant"] = {**figure(1.0), "tag": constant}
    if std is not None:
        data["hold"] = {"kept": figure(kept), "carried": figure(carried), "std": std}
        if static is not None:
            data["hold"]["static"] = static
    return validate(data, "test").with_urdf(robots.TWO_LINK_URDF, "test")


def moved_and_stopped(direction=1.0, effort=None):
    """One second of motion of both joints, then one of rest at the same place."""
    time = np.arange(0.0, 2.0, RATE)
    left = np.minimum(time - 1.0, 0.0)
    position = 0.8 + direction * np.repeat((left**3)[:, None], 2, axis=1)
    velocity = direction * np.repeat((3.0 * left**2)[:, None], 2, axis=1)
    velocity[time >= 1.0] = 0.0
    block = robots.joint_block(100.0 + time, position, velocity)
    if effort is not None:
        block.joint_effort[:] = effort
    return block


def power_of(model, block, cut=None, effort=EffortMeaning.NONE):
    pipeline = EnergyPipeline(model, Settings(temperature_wait=0.0, effort=effort))
    size = cut or len(block)
    parts = [pipeline.step(block[slice(at, at + size)]) for at in range(0, len(block), size)]
    parts.append(pipeline.flush())
    return PowerBlock.concatenate([part.power for part in parts if part.power is not None])


def test_by_hand():
    hold = HoldTorque(arm(kept=0.5, carried=0.25, std=0.1))
    rigid = np.array([[10.0, -0.1]])
    # 10 - 0.25 * 0.2 + 0.5 * 0.2; of a load below the Coulomb torque a share is carried
    assert hold.torque(rigid, np.array([[1.0, -1.0]])) == pytest.approx(np.array([[10.05, -0.175]]))
    assert hold.typical(rigid) == pytest.approx(np.hypot([[9.95, -0.075]], 0.1))
    assert hold.std(rigid) == pytest.approx([0.02, 0.02])
    assert HoldTorque(arm(std=None)).std(rigid) == pytest.approx([UNKNOWN * 0.2] * 2)


def test_static_friction_grows_with_the_load_and_differs_between_joints():
    hold = HoldTorque(arm(kept=0.5, carried=0.25, std=0.1, static=(1.5, 0.5), load=0.05))
    rigid = np.array([[10.0, -2.0]])
    static = np.array([[1.5 * (0.2 + 0.05 * 6.0), 0.5 * (0.2 + 0.05 * 2.0)]])
    assert hold.static(rigid) == pytest.approx(static)
    torque = hold.torque(rigid, np.array([[-1.0, 1.0]]))
    assert torque == pytest.approx(rigid + static * [[-0.25 - 0.5, 0.25 + 0.5]])
    assert hold.std(rigid) == pytest.approx(0.1 * static / [[1.5, 0.5]])
    with pytest.raises(ModelFileError, match="static"):
        arm(static=(1.0,))


def test_a_gear_that_unwinds_after_a_stop_turns_no_direction():
    velocity = np.repeat([[20.0], [0.0], [-3.0], [0.0], [-3.0], [0.0]], 10, axis=0)
    velocity[25:30] = 0.0  # back by 3 rad/s over 0.05 s, and then over 0.1 s more
    stamp = np.arange(len(velocity)) * 10_000_000

    def directions(cut):
        motion = LastMotion(np.array([1.0]))
        return np.concatenate(
            [motion.follow(stamp[k : k + cut], velocity[k : k + cut]) for k in range(0, 60, cut)]
        )[:, 0]

    whole = directions(60)
    assert (whole[2:41] == 1.0).all()
    assert (whole[41:] == -1.0).all()  # 0.21 rad back: more than 1 rad/s makes in 0.2 s
    for cut in (1, 7, 30):
        assert np.array_equal(directions(cut), whole)


@pytest.mark.parametrize("speed", [1.25, 2.0])
def test_a_steady_speed_turns_the_direction_at_the_same_sample_however_it_is_cut(speed):
    """It reaches the least angle exactly at a sample, where a sum of floats would be rounded."""
    random = np.random.default_rng(0)
    least = np.array([0.5, 0.7])
    stamp = np.arange(400) * 4_000_000
    for _ in range(30):
        velocity = least * np.repeat(random.choice([-speed, speed, 0.0], (5, 2)), 80, axis=0)
        whole = LastMotion(least).follow(stamp, velocity)
        motion, cuts = LastMotion(least), np.sort(random.choice(np.arange(1, 400), 9, False))
        parts = [motion.follow(*part) for part in zip(
            np.split(stamp, cuts), np.split(velocity, cuts), strict=True)]  # fmt: skip
        assert np.array_equal(np.concatenate(parts), whole)


def test_the_direction_is_that_of_the_last_motion_however_it_is_cut():
    model = arm(kept=0.6)
    for direction in (1.0, -1.0):
        block = moved_and_stopped(direction)
        whole = power_of(model, block)
        load = power_of(arm(), block).motor_torque[-1]
        turned = np.sign(whole.motor_velocity[50])
        assert whole.motor_torque[-1] == pytest.approx(load + turned * 0.6 * 0.2)
        for cut in (1, 7, 100):
            assert np.array_equal(power_of(model, block, cut).drive_loss, whole.drive_loss)


def test_copper_at_rest_follows_measured_torque():
    block = moved_and_stopped(effort=1.5)
    model = arm(constant="identified")
    power = power_of(model, block, effort=EffortMeaning.MOTOR_TORQUE)
    assert power.drive_loss[-1] == pytest.approx([0.5 * 1.5**2] * 2)
    # what the model says of the torque stays next to it
    load = power_of(model, moved_and_stopped()).motor_torque[-1]
    assert power.motor_torque[-1] == pytest.approx(load)
    assert power.drive_loss[0] != pytest.approx([0.5 * 1.5**2] * 2)


def test_a_current_times_an_assumed_constant_is_no_measured_torque():
    block = moved_and_stopped(effort=1.5)
    model = arm(constant="assumed")
    by_current = power_of(model, block, effort=EffortMeaning.MOTOR_CURRENT)
    assert by_current.drive_loss[-1] == pytest.approx(
        power_of(model, moved_and_stopped()).drive_loss[-1]
    )
    by_torque = power_of(model, block, effort=EffortMeaning.MOTOR_TORQUE)
    assert by_torque.drive_loss[-1] == pytest.approx([0.5 * 1.5**2] * 2)


def test_an_unknown_torque_at_rest_widens_the_band():
    block = moved_and_stopped()
    known, unknown = power_of(arm(), block), power_of(arm(std=None), block)
    torque = np.abs(unknown.motor_torque[-1])
    off = 0.5 * ((torque + UNKNOWN * 0.2) ** 2 - torque**2)

    def last(power):
        drives = len(CABINET_DEVIATIONS) + 2 * JOINT_DEVIATIONS.index("drive")
        return power.deviation.values[power.deviation.row[-1], drives : drives + 2]

    assert last(unknown) == pytest.approx(np.hypot(last(known), off))
    assert (off > 1e-4).all()
