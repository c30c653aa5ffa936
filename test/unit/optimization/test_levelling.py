"""Starts of robots on one supply: pulses that fit between each other, and every combination."""

from itertools import product

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import MotionError
from robot_energy_plan.shared_bus import level_starts

MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"


def pulse(size, width, watt):
    return np.where(np.arange(size) < width, watt, 100.0)


def test_two_pulses_are_put_after_each_other():
    found = level_starts([pulse(100, 40, 900.0), pulse(100, 50, 700.0)], 10.0)
    assert found.together == 1600.0
    assert found.least == 1000.0
    assert 4.0 <= found.start[1] <= 5.0
    assert found.mean == pytest.approx(420.0 + 400.0)


def test_three_robots_against_every_combination():
    random = np.random.default_rng(3)
    curves = [random.uniform(0.0, 1000.0, 16) for _ in range(3)]
    best = min(
        (curves[0] + np.roll(curves[1], a) + np.roll(curves[2], b)).max()
        for a, b in product(range(16), repeat=2)
    )
    found = level_starts(curves, 16.0)
    shifts = np.rint(found.start).astype(int)
    total = sum(np.roll(one, shift) for one, shift in zip(curves, shifts, strict=True))
    assert total.max() == pytest.approx(found.least)
    assert best <= found.least <= 1.03 * best


def test_robots_of_one_cell_do_not_start_together():
    found = re.optimize(MOVES, "kr16", 40.0, cycle_time=9.0, level=[MOVES, MOVES]).report
    starts = [one.start for one in found.starts]
    assert starts[0] == 0.0
    assert len(set(starts)) == 3
    supply = found.supply
    assert supply.peak_power < 0.9 * supply.peak_power_together
    assert supply.mean_power < supply.peak_power


def test_levelling_needs_a_common_cycle():
    with pytest.raises(MotionError, match="no cycle time"):
        re.optimize(MOVES, "kr16", 40.0, level=[MOVES])
