"""Motions one after another."""

import numpy as np
import pytest

from robot_energy_papers.experiment import MotionSequence
from robot_energy_plan.motion import MotionLimits, Program

LIMITS = MotionLimits(
    np.array([-3.0, -2.0]), np.array([3.0, 2.0]), np.array([2.0, 1.0]), np.array([8.0, 5.0])
)
HOME = np.array([0.2, -0.4])
FIRST = Program(np.array([HOME, [1.0, 1.0]]), LIMITS, dwell=0.3)
SECOND = Program(np.array([HOME, [-2.0, 0.5], [0.5, 1.5]]), LIMITS, dwell=0.1)
PARTS = [(FIRST, FIRST.period), (SECOND, 2 * SECOND.period), (FIRST, FIRST.period)]
SEQUENCE = MotionSequence(PARTS)


def test_each_part_is_played_from_its_own_start():
    np.testing.assert_allclose(
        SEQUENCE.begin, [0.0, FIRST.period, FIRST.period + 2 * SECOND.period]
    )
    assert SEQUENCE.duration == pytest.approx(2 * FIRST.period + 2 * SECOND.period)
    time = np.linspace(0.0, 2 * SECOND.period, 500, endpoint=False)
    inside = SEQUENCE.sample(FIRST.period + time)
    alone = SECOND.sample(time)
    for name in ("joint_position", "joint_velocity", "joint_acceleration"):
        np.testing.assert_allclose(getattr(inside, name), getattr(alone, name), atol=1e-9)


def test_it_is_continuous_and_samples_may_come_in_any_order():
    time = np.arange(0.0, SEQUENCE.duration, 1e-3)
    path = SEQUENCE.sample(time)
    assert np.abs(np.diff(path.joint_position, axis=0)).max() <= 2.0 * 1e-3 * (1 + 1e-9)
    order = np.random.default_rng(1).permutation(len(time))
    mixed = SEQUENCE.sample(time[order])
    np.testing.assert_array_equal(mixed.joint_position, path.joint_position[order])
