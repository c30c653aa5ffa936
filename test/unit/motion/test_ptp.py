"""Synchronised point-to-point motions."""

import numpy as np
import pytest

from moves import PointToPoint
from robot_energy.foundation.errors import MotionError
from robot_energy_plan.motion import MotionLimits

LIMITS = MotionLimits(
    lower=np.array([-3.0, -2.0, -1.0]),
    upper=np.array([3.0, 2.0, 1.0]),
    velocity=np.array([2.0, 1.0, 4.0]),
    acceleration=np.array([8.0, 5.0, 10.0]),
    jerk_time=0.08,
)
PLAIN = MotionLimits(
    LIMITS.lower, LIMITS.upper, LIMITS.velocity, LIMITS.acceleration, jerk_time=0.0
)
LONG = PointToPoint(np.array([-2.5, 1.5, 0.0]), np.array([2.5, -1.0, 0.5]), LIMITS)
SHORT = PointToPoint(np.zeros(3), np.array([0.01, -0.02, 0.005]), LIMITS)
MOTIONS = [pytest.param(LONG, id="long"), pytest.param(SHORT, id="short")]


def fine(motion, step=1e-4):
    return np.arange(-0.05, motion.duration + 0.05, step)


def test_trapezoid_has_the_duration_of_the_textbook():
    # Joint 2 leads: 2.5 rad at 1 rad/s; joint 1: 5 rad at 2 rad/s, the same time.
    # Ramp: rise is min(8/5, 5/2.5, 10/0.5) = 1.6 /s^2 up to 0.4 /s, 0.25 s; 2.5 + 0.25 s.
    motion = PointToPoint(np.array([-2.5, 1.5, 0.0]), np.array([2.5, -1.0, 0.5]), PLAIN)
    assert motion.duration == pytest.approx(2.75, rel=1e-14)
    assert LONG.duration == pytest.approx(2.75 + 0.08, rel=1e-14)
    middle = motion.sample(np.array([1.375]))
    np.testing.assert_allclose(middle.joint_position, [[0.0, 0.25, 0.25]], atol=1e-14)
    np.testing.assert_allclose(middle.joint_velocity, [[2.0, -1.0, 0.2]], atol=1e-14)
    ramp = motion.sample(np.array([0.1]))
    np.testing.assert_allclose(ramp.joint_acceleration, [[8.0, -4.0, 0.8]], atol=1e-14)
    np.testing.assert_allclose(ramp.joint_position[0, 0], -2.5 + 0.5 * 8.0 * 0.01, atol=1e-14)


@pytest.mark.parametrize("motion", MOTIONS)
def test_limits_are_kept_and_one_of_them_is_reached(motion):
    path = motion.sample(fine(motion))
    speed = np.abs(path.joint_velocity).max(axis=0) / LIMITS.velocity
    rise = np.abs(path.joint_acceleration).max(axis=0) / LIMITS.acceleration
    assert (speed <= 1 + 1e-12).all()
    assert (rise <= 1 + 1e-12).all()
    assert max(speed.max(), rise.max()) > (0.99 if motion is LONG else 0.3)


@pytest.mark.parametrize("motion", MOTIONS)
def test_derivatives_agree_with_finite_differences(motion):
    step = 1e-5
    time = fine(motion, 1e-3)
    ahead, now, behind = (motion.sample(time + d) for d in (step, 0.0, -step))
    np.testing.assert_allclose(
        (ahead.joint_position - behind.joint_position) / (2 * step), now.joint_velocity, atol=1e-7
    )
    # At a corner of the acceleration the difference quotient sees half the jerk times step.
    np.testing.assert_allclose(
        (ahead.joint_velocity - behind.joint_velocity) / (2 * step),
        now.joint_acceleration,
        atol=2 * step * (LIMITS.acceleration / LIMITS.jerk_time).max(),
    )


@pytest.mark.parametrize("motion", MOTIONS)
def test_acceleration_is_continuous_and_its_slope_bounded(motion):
    step = 1e-4
    rise = motion.sample(fine(motion, step)).joint_acceleration
    slope = np.abs(np.diff(rise, axis=0)) / step
    bound = (1 if motion is LONG else 2) * LIMITS.acceleration / LIMITS.jerk_time
    assert (slope <= bound * (1 + 1e-6) + 1e-6).all()


@pytest.mark.parametrize("motion", MOTIONS)
def test_rests_exactly_at_both_ends_and_beyond(motion):
    path = motion.sample(np.array([-1.0, 0.0, motion.duration, motion.duration + 1.0]))
    np.testing.assert_array_equal(path.joint_position[0], path.joint_position[1])
    np.testing.assert_array_equal(path.joint_position[2], path.joint_position[3])
    assert not path.joint_velocity.any()
    assert not path.joint_acceleration.any()


def test_reaches_the_goal_to_the_last_bit():
    np.testing.assert_array_equal(
        LONG.sample(np.array([LONG.duration])).joint_position, [[2.5, -1.0, 0.5]]
    )


def test_joints_move_in_proportion():
    path = LONG.sample(np.linspace(0.0, LONG.duration, 50))
    share = (path.joint_position - [-2.5, 1.5, 0.0]) / [5.0, -2.5, 0.5]
    np.testing.assert_allclose(share, share[:, :1] * np.ones(3), atol=1e-14)
    assert (np.diff(share[:, 0]) > 0).all()


def test_override_only_stretches_time():
    slow = PointToPoint(np.array([-2.5, 1.5, 0.0]), np.array([2.5, -1.0, 0.5]), LIMITS, 0.25)
    assert slow.duration == pytest.approx(4 * LONG.duration, rel=1e-12)
    time = np.linspace(0, LONG.duration, 40)
    fast, slowed = LONG.sample(time), slow.sample(4 * time)
    np.testing.assert_allclose(slowed.joint_position, fast.joint_position, atol=1e-12)
    np.testing.assert_allclose(slowed.joint_velocity, fast.joint_velocity / 4, atol=1e-12)
    np.testing.assert_allclose(slowed.joint_acceleration, fast.joint_acceleration / 16, atol=1e-10)


def test_no_way_takes_no_time():
    still = PointToPoint(np.ones(3), np.ones(3), LIMITS)
    assert still.duration == 0
    path = still.sample(np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_array_equal(path.joint_position, np.ones((3, 3)))
    assert not path.joint_velocity.any()


@pytest.mark.parametrize(
    ("start", "goal", "override", "text"),
    [
        ([0, 0, 0], [0, 2.5, 0], 1.0, "the goal puts joint 2 at 2.5; expected -2 to 2"),
        ([0, 0, np.nan], [0, 0, 0], 1.0, "the start puts joint 3 at nan"),
        ([0, 0, 0], [1, 0, 0], 0.0, r"the speed override is 0.0; expected a share in \(0, 1\]"),
    ],
)
def test_impossible_motions_are_refused(start, goal, override, text):
    with pytest.raises(MotionError, match=text):
        PointToPoint(np.array(start, float), np.array(goal, float), LIMITS, override)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"velocity": np.array([1.0, 0.0, 1.0])}, "velocity limits are"),
        ({"acceleration": np.array([1.0, np.inf, 1.0])}, "acceleration limits are"),
        ({"upper": np.array([3.0, -2.0, 1.0])}, "expected lower < upper"),
        ({"jerk_time": -1.0}, "jerk_time is -1.0 s"),
    ],
)
def test_limits_that_make_no_sense_are_refused(change, text):
    with pytest.raises(MotionError, match=text):
        MotionLimits(**{**LIMITS.__dict__, **change})
