"""The comparison of robots: how often it is false, what it finds, what hides nothing."""

import numpy as np
import pytest

from robot_energy_fleet.sisters import MIN_SISTERS, levels, stand_out

ROBOTS, BAGS = 20, 12


def fleet(seed, faults=(), between=0.05, inside=0.03):
    """Figures of bags that follow a temperature, of robots that differ."""
    random = np.random.default_rng(seed)
    own = between * random.standard_normal(ROBOTS)
    for robot, size in faults:
        own[robot] += size
    robot = np.repeat(np.arange(ROBOTS), BAGS)
    warm = random.uniform(0.0, 1.0, ROBOTS)[robot]  # some always run warmer
    degc = warm + 0.3 * random.uniform(-1.0, 1.0, len(robot))
    figure = own[robot] - 2.0 * degc + inside * random.standard_normal(len(robot))
    return figure, robot, degc[:, None]


def found(figure, robot, work, comparisons=1):
    own = levels(figure, robot, work, np.ones(len(robot), bool))
    return {one.robot: one for one in stand_out(own.level, own.std, comparisons)}


def test_sound_fleets_give_no_more_false_findings_than_is_said():
    false = sum(bool(found(*fleet(seed))) for seed in range(300))
    assert false <= 9  # one of a hundred is stated: 3 are expected, 9 are beyond chance


def test_temperature_is_no_fault_and_a_fault_is_found_with_its_size():
    one = found(*fleet(1, [(7, 0.5)]))
    assert set(one) == {7}
    assert one[7].size == pytest.approx(0.5, abs=3.0 * one[7].std)
    assert 0.99 < one[7].certainty <= 1.0


def test_three_faults_do_not_hide_each_other():
    faults = [(3, 0.5), (4, 0.55), (5, 0.6)]
    assert set(found(*fleet(2, faults), comparisons=10)) == {3, 4, 5}


def test_more_comparisons_need_more():
    figure, robot, work = fleet(3, [(7, 0.4)])
    few, many = found(figure, robot, work, 1), found(figure, robot, work, 100_000)
    assert set(few) == {7}
    assert not many


def test_few_robots_are_not_compared():
    figure, robot, work = fleet(4, [(0, 5.0)])
    few = robot < MIN_SISTERS - 1
    assert not found(figure[few], robot[few], work[few])


def test_a_bag_far_off_does_not_move_its_robot():
    figure, robot, work = fleet(5)
    figure[4 * BAGS] += 30.0
    assert not found(figure, robot, work)
