"""Starts of robots on one DC bus: braking that meets acceleration, and every combination."""

from itertools import product

import numpy as np
import pytest

from robot_energy.foundation.errors import MotionError
from robot_energy_plan.optimization.levelling import level_starts


def pulse(size, width, watt):
    """It drives, then gives half of it back."""
    at = np.arange(size)
    return np.where(at < width, watt, np.where(at < 2 * width, -0.5 * watt, 0.0))


def test_braking_of_one_meets_acceleration_of_another():
    found = level_starts([pulse(100, 20, 1000.0), pulse(100, 20, 500.0)], 10.0)
    assert found.together == pytest.approx(0.2 * 1500.0)  # all at once: nothing is used
    assert found.least == pytest.approx(0.2 * 1000.0)  # all 500 W that the first gives back
    assert found.start[1] == pytest.approx(2.0)
    assert found.mean == pytest.approx(0.1 * 1500.0)


def test_three_robots_against_every_combination():
    random = np.random.default_rng(3)
    curves = [random.uniform(-500.0, 1000.0, 16) for _ in range(3)]

    def drawn(first, second):
        total = curves[0] + np.roll(curves[1], first) + np.roll(curves[2], second)
        return np.maximum(total, 0.0).mean()

    best = min(drawn(a, b) for a, b in product(range(16), repeat=2))
    found = level_starts(curves, 16.0)
    shifts = np.rint(found.start).astype(int)
    assert drawn(*shifts[1:]) == pytest.approx(found.least)
    assert best <= found.least <= 1.03 * best


def test_one_robot_alone_has_nothing_to_meet():
    with pytest.raises(MotionError, match="two robots or more"):
        level_starts([np.ones(3)], 1.0)
