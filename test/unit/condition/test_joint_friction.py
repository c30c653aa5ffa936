"""Friction that is known, with a load the model does not have, collisions and bad samples."""

from dataclasses import replace

import numpy as np
import pytest

from accounts import power_block
from robot_energy.condition.joint_friction import (
    BOUNDS,
    BUCKET_SPEED,
    FrictionLearner,
    MotionReader,
)
from robot_energy.condition.record import FrictionRecord
from robot_energy.timeline.blocks import Quality

RATE = 100
READER = MotionReader(np.array([100.0, 50.0]), np.array([0.2, 0.2]), 25.0)


def second(number, velocity, factor, load=0.0, degc=30.0, torque=(0.5, 0.2)):
    """One second of both joints at a joint velocity, friction times a factor, a foreign load."""
    stamp = np.rint((number + np.arange(RATE) / RATE) * 1e9).astype(np.int64)
    motor = np.array([100.0, 50.0]) * np.asarray(velocity)
    model = np.tile(np.asarray(torque), (RATE, 1))
    speed = np.tile(motor, (RATE, 1))
    rigid = np.tile([1.0, -0.5], (RATE, 1))
    measured = rigid + load + factor * model * np.sign(speed)
    block = power_block(stamp, np.full(RATE, 100.0))
    return replace(
        block,
        motor_velocity=speed,
        rigid_power=rigid * speed,
        friction_power=model * np.abs(speed),
        motor_torque_measured=measured,
        shaft_power_measured=measured * speed,
        motor_temperature_degc=np.full((RATE, 2), degc),
    )


def taught(seconds=60, factor=1.3, load=0.0, **changes) -> FrictionLearner:
    """A learner after forward and backward motion in turns."""
    learner = FrictionLearner(2)
    for number in range(seconds):
        way = 0.5 if number % 2 else -0.5
        block = second(number, (way, way), factor, load, **changes)
        found = READER.read(block, block.friction_power)
        assert found is not None
        learner.step(found)
    return learner


def test_the_multiplier_is_found():
    learner = taught()
    np.testing.assert_allclose(learner.raw, 1.3)
    np.testing.assert_allclose(learner.filtered, 1.3)
    assert learner.valid.all()
    np.testing.assert_array_equal(learner.parts, [60, 60])
    assert learner.bucket_time[0, 3].sum() == pytest.approx(29.7, abs=0.5)  # 30 degC is a bucket


def test_a_load_that_the_model_lacks_leaves_it_alone():
    np.testing.assert_allclose(taught(load=0.4).filtered, 1.3)


def test_one_direction_alone_says_nothing():
    learner = FrictionLearner(2)
    for number in range(60):
        block = second(number, (0.5, 0.5), 1.3)
        learner.step(READER.read(block, block.friction_power))
    assert not learner.valid.any()
    assert np.isnan(learner.raw).all()
    assert (learner.table() == 1.0).all()


def test_buckets_keep_speeds_apart():
    learner, rng = FrictionLearner(2), np.random.default_rng(0)
    for number in range(400):
        slow = bool(rng.integers(2))
        speed = float(BUCKET_SPEED[1] if slow else BUCKET_SPEED[3])
        way = speed if rng.integers(2) else -speed
        block = second(number, (way, way), 1.4 if slow else 0.9)
        learner.step(READER.read(block, block.friction_power))
    np.testing.assert_allclose(learner.buckets[:, 3, [1, 3]], [[1.4, 0.9]] * 2, rtol=1e-9)
    table = learner.table()
    assert (table[:, 3, 1] > 1.3).all()
    assert (table[:, 3, 3] < 1.0).all()
    assert np.isnan(learner.buckets[:, 8]).all()
    np.testing.assert_allclose(table[:, 8], learner.filtered[:, None].repeat(4, 1), atol=1e-6)


def test_bounds_hold():
    assert taught(factor=3.0).filtered.tolist() == [BOUNDS[1]] * 2
    assert taught(factor=0.1).table().min() == BOUNDS[0]


def test_a_collision_is_refused():
    learner = taught()
    block = second(99, (0.5, 0.5), 40.0)
    learner.step(READER.read(block, block.friction_power))
    np.testing.assert_array_equal(learner.refused, [1, 1])
    np.testing.assert_allclose(learner.filtered, 1.3)


def test_standing_doubtful_and_bad_samples_are_left_out():
    block = second(0, (0.001, 0.5), 1.3)  # joint 0 creeps below five standstill velocities
    found = READER.read(block, block.friction_power)
    assert found.time[:, 0].sum() == 0.0
    block.quality[:] = Quality.AFTER_GAP
    assert READER.read(block, block.friction_power).time.sum() == 0.0
    block = second(0, (0.5, 0.5), 1.3)
    block.shaft_power_measured[::2] = np.inf
    found = READER.read(block, block.friction_power)
    np.testing.assert_allclose(found.time.sum(axis=(0, 2)), 0.495, atol=0.01)
    np.testing.assert_allclose(np.nanmax(found.ratio, axis=0), 1.3)
    block.shaft_power_measured[:] = np.nan
    assert READER.read(block, block.friction_power) is None


def test_a_missing_temperature_counts_as_that_of_the_model():
    found = READER.read(*(lambda b: (b, b.friction_power))(second(0, (0.5, 0.5), 1.3, degc=np.nan)))
    np.testing.assert_array_equal(found.degc, [25.0, 25.0])


def test_it_continues_from_its_record():
    learner, again = taught(), FrictionLearner(2)
    FrictionRecord.from_json(FrictionRecord.of(learner).to_json()).put_into(again)
    for each in (learner, again):
        block = second(99, (0.7, 0.7), 1.5)
        each.step(READER.read(block, block.friction_power))
    np.testing.assert_array_equal(again.table(), learner.table())
    np.testing.assert_array_equal(again.parts, learner.parts)
