"""Looping programs of motions."""

import numpy as np
import pytest

from moves import PointToPoint
from refusals import refused
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion import MotionLimits, Program, random_program, tool_above

LIMITS = MotionLimits(
    np.array([-3.0, -2.0]), np.array([3.0, 2.0]), np.array([2.0, 1.0]), np.array([8.0, 5.0])
)
VIA = np.array([[0.0, 0.0], [1.0, -1.0], [-2.0, 0.5]])
PROGRAM = Program(VIA, LIMITS, dwell=[0.3, 0.0, 0.5])


def test_period_is_the_sum_of_motions_and_dwells():
    way = [PointToPoint(VIA[i], VIA[(i + 1) % 3], LIMITS).duration for i in range(3)]
    assert PROGRAM.period == pytest.approx(sum(way) + 0.8, rel=1e-14)
    assert PROGRAM.moves == 3


def test_visits_every_via_and_rests_there():
    way = [PointToPoint(VIA[i], VIA[(i + 1) % 3], LIMITS).duration for i in range(3)]
    arrival = np.array([0.0, 0.3 + way[0], 0.3 + way[0] + way[1]])
    path = PROGRAM.sample(np.concatenate([arrival + 1e-9, arrival[[0, 2]] + [0.3, 0.5]]))
    np.testing.assert_allclose(path.joint_position, VIA[[0, 1, 2, 0, 2]], atol=1e-9)
    assert np.abs(path.joint_velocity).max() < 1e-9


def test_equals_the_single_motion_inside_it():
    motion = PointToPoint(VIA[0], VIA[1], LIMITS)
    time = np.linspace(0.01, motion.duration - 0.01, 20)
    single, inside = motion.sample(time), PROGRAM.sample(0.3 + time)
    np.testing.assert_allclose(inside.joint_position, single.joint_position, atol=1e-12)
    np.testing.assert_allclose(inside.joint_acceleration, single.joint_acceleration, atol=1e-9)


def test_repeats_and_rests_before_its_start():
    time = np.linspace(0.0, PROGRAM.period, 100, endpoint=False)
    one, later = PROGRAM.sample(time), PROGRAM.sample(time + 7 * PROGRAM.period)
    np.testing.assert_allclose(later.joint_position, one.joint_position, atol=1e-10)
    np.testing.assert_array_equal(PROGRAM.sample(np.array([-5.0])).joint_position, VIA[:1])


def test_is_continuous_over_the_loop():
    step = 1e-4
    path = PROGRAM.sample(np.arange(0.0, 2 * PROGRAM.period, step))
    assert np.abs(np.diff(path.joint_position, axis=0)).max() <= 2.0 * step * (1 + 1e-9)
    assert np.abs(np.diff(path.joint_velocity, axis=0)).max() <= 8.0 * step * (1 + 1e-9)


def test_one_via_holds_still():
    hold = Program(VIA[:1], LIMITS, dwell=1.0)
    assert hold.period == 1.0
    assert not hold.sample(np.array([0.2, 5.7])).joint_velocity.any()


@pytest.mark.parametrize(
    ("via", "dwell", "text"),
    [
        (VIA * 2, 0.1, "via 3 puts joint 1 at -4; expected -3 to 3"),
        (VIA, -0.1, "dwell times are -0.1"),
        (VIA[:1], 0.0, "neither moves nor rests"),
    ],
)
def test_impossible_programs_are_refused(via, dwell, text):
    with pytest.raises(MotionError, match=text):
        Program(via, LIMITS, dwell)


def test_random_program_is_the_same_for_the_same_seed():
    one, again, other = (random_program(LIMITS, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.via, again.via)
    assert (one.via != other.via).any()
    assert one.moves == 20


def test_random_program_stays_in_its_zone():
    program = random_program(LIMITS, 0, moves=300, zone=[0.5, 0.1])
    assert (np.abs(program.via) <= [1.5, 0.2]).all()
    assert (np.abs(program.via).max(axis=0) > [1.4, 0.18]).all()


def test_random_program_keeps_the_tool_above_the_floor():
    robot = Robot.from_model(load("kr16"))
    limits = MotionLimits.of_robot(robot, np.full(6, 10.0))
    program = random_program(limits, 0, moves=5, accept=tool_above(robot, "flange", 0.3))
    time = np.linspace(0, program.period, 200)
    height = [robot.link_position(q, "flange")[2] for q in program.sample(time).joint_position]
    assert min(height) > 0.25  # checked at points along each motion, not everywhere


def test_random_program_needs_motions_that_are_allowed():
    with refused(MotionError, found="only 0 of 20 allowed motions"):
        random_program(LIMITS, 0, accept=lambda q: False)


def test_random_programs_can_share_their_first_via():
    start = np.array([0.5, -0.5])
    one, two = (random_program(LIMITS, seed, moves=5, start=start) for seed in (1, 2))
    for program in (one, two):
        np.testing.assert_array_equal(program.via[0], start)
        assert program.moves == 5
    assert not np.allclose(one.via[1:], two.via[1:])
