"""Sensitivity to open figures: functions solved by hand, and entries of the studies."""

from __future__ import annotations

import pytest

from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy_papers.calibration import HOLDING_DEGC, Holding, holding_power, random_poses
from robot_energy_papers.machines import layer, predicted
from robot_energy_papers.paper_a import HOLD, RISE, holding_table, rise_table
from robot_energy_papers.sensitivity import TOGETHER, OpenFigure, sensitivity
from robot_energy_papers.wall import Wall
from robot_energy_papers.wall_sensitivity import GANTRY
from robot_energy_rig import load_profile


def figure(key, low, nominal, high, switch=False):
    return OpenFigure(key, key, "", low, nominal, high, "a reason", switch)


def test_one_figure_that_reproduces():
    """y = 3 a^2 + b: at a = 2, b = 4 it is 16; slope over 1..4 is 15, times 2 / 16."""
    found = sensitivity(
        lambda x: {"y": 3 * x["a"] ** 2 + x["b"]},
        [figure("a", 1, 2, 4), figure("b", 0, 4, 5)],
        {"y": 31.0},
    )["y"]
    first, second = found.rows
    assert (found.nominal, first.at_low, first.at_high) == (16, 7, 52)
    assert first.elasticity == pytest.approx(15 * 2 / 16)
    assert second.elasticity == pytest.approx(4 / 16)
    assert first.reproduces == pytest.approx(3.0, rel=2e-3)
    assert second.reproduces is None
    assert found.spread is None
    assert found.alone == [first]


def test_all_figures_are_drawn_at_once_from_their_ranges():
    """y = a + b: a below 1 in half of the draws, b uniform from its end, s on in half of them."""
    seen = []

    def total(x):
        seen.append(x)
        return {"y": x["a"] + x["b"]}

    figures = [figure("a", 0, 1, 4), figure("b", 0, 0, 1), figure("s", 0, 0, 1, switch=True)]
    found = sensitivity(total, figures, {"y": 4.0}, draws=2000, seed=7, slow=["b"])["y"]
    drawn = seen[-2000:]
    a, b, s = ([x[key] for x in drawn] for key in "abs")
    assert sum(value < 1 for value in a) / 2000 == pytest.approx(0.5, abs=0.04)
    assert sum(value > 2.5 for value in a) / 2000 == pytest.approx(0.25, abs=0.03)
    assert len(set(b)) == 2000 / TOGETHER
    assert sum(value > 0.5 for value in b) / 2000 == pytest.approx(0.5, abs=0.15)
    assert sum(s) / 2000 == pytest.approx(0.5, abs=0.04)
    spread = found.spread
    assert (spread.draws, spread.seed) == (2000, 7)
    assert list(spread.quantiles) == sorted(spread.quantiles)
    assert spread.quantiles[3] == pytest.approx(1.5, abs=0.15)
    # P(a + b >= 4): over b, half times (a above 4 - b of the three units above 1), mean b / 6
    assert spread.reaching == pytest.approx(0.5 / 6.0, abs=0.03)


def test_draws_without_a_possible_motion_are_left_out():
    """y = a, refused above 1: half of the draws are left."""

    def total(x):
        if x["a"] > 1.0 and x["b"] > 0.0:
            raise MotionError("the wall is out of reach")
        return {"y": x["a"]}

    figures = [figure("a", 0, 1, 2), figure("b", 0, 0, 1)]
    found = sensitivity(total, figures, {"y": 3.0}, draws=1000)["y"]
    assert found.spread.draws == pytest.approx(500, abs=60)
    assert found.spread.quantiles[-1] <= 1.0


def test_none_reproduces_and_switches_have_nothing_between():
    figures = [figure("a", 0, 1, 2), figure("s", 0, 0, 1, switch=True)]
    found = sensitivity(lambda x: {"y": x["a"] + 3 * x["s"]}, figures, {"y": 9.0})["y"]
    assert found.alone == []
    assert found.rows[1].elasticity is None  # of a nominal figure of 0
    found = sensitivity(lambda x: {"y": x["a"] + 3 * x["s"]}, figures, {"y": 3.5})["y"]
    assert found.rows[1].reproduces == 1.0


def test_friction_of_the_long_axis_by_hand(walls):
    """Force times way: 2.4 m of every layer are along the long axis."""
    table = walls["mechanical, magnitude"]
    row = next(row for row in table.rows if row.figure.key == "force_x")
    arm = predicted(load("irb4600"), layer("irb4600"))[0].figures
    arm_energy = arm["mechanical, magnitude"]
    by_hand = (450.0 - 120.0) * 2.4 / arm_energy
    assert row.at_high - row.at_low == pytest.approx(by_hand, rel=0.02)  # corners are rounded
    assert row.elasticity == pytest.approx(300.0 * 2.4 / (arm_energy * table.nominal), rel=0.02)


def test_weight_of_the_ram_by_hand(walls):
    """Copper loss of holding goes with the square of the weight, mechanical energy not at all."""
    rows = {row.figure.key: row for row in walls["electrical, drives"].rows}
    ram, nominal = rows["ram"], walls["electrical, drives"].nominal
    gantry = predicted(load("testbed"), layer(GANTRY))[0]
    held = gantry.parts["holding"] / float(gantry.electrical.sum())
    assert ram.at_low / nominal == pytest.approx(1.0 - held, rel=1e-3)
    assert ram.at_high / nominal == pytest.approx(1.0 + (1.5**2 - 1.0) * held, rel=1e-3)
    mechanical = {row.figure.key: row for row in walls["mechanical, magnitude"].rows}
    assert mechanical["ram"].elasticity == 0.0


def test_a_share_of_all_draws_reaches_the_saving_of_the_paper(walls):
    for table in walls.values():
        assert table.published == pytest.approx(0.23)
        assert table.alone == []
        spread = table.spread
        assert 0.0 < spread.quantiles[0] < table.nominal < spread.quantiles[-1] < 1.5
        assert spread.reaching < 0.5


def test_infill_stays_inside_and_comes_back():
    corners = Wall(infill=12).corners
    assert len(corners) == 4 + 24
    assert corners[-1] == (0.0, 0.0)
    assert {y for _, y in corners} == {0.0, 0.3}
    assert max(x for x, _ in corners) == pytest.approx(1.2)
    assert Wall().corners == Wall(infill=0).corners


def test_constant_losses_at_rest_by_hand():
    """They dilute the deviation: watts over poses stay, the mean grows."""
    table = holding_table(0)[HOLD]
    row = next(row for row in table.rows if row.figure.key == "constant_loss")
    profile = load_profile("kr16")
    power = holding_power(profile, random_poses(profile, 0), HOLDING_DEGC)
    mean = Holding.of(power).mean
    more = (750.0 - 340.0) * (90.0 / 0.985 + 250.0) / 340.0
    assert row.at_high == pytest.approx(table.nominal * mean / (mean + more), rel=1e-9)
    resistance = next(row for row in table.rows if row.figure.key == "resistance")
    assert 0.10 < resistance.at_low < table.nominal
    assert 0.10 < table.spread.quantiles[3]
    assert 0.0 < table.spread.reaching < 0.5


def test_rise_of_temperature_by_hand():
    """Friction heat in the motor adds a straight line; a longer set warms as much more."""
    table = rise_table(0, quick=True)[RISE]
    rows = {row.figure.key: row for row in table.rows}
    share = rows["share"]
    slope = (share.at_high - share.at_low) / 0.5
    assert table.nominal == pytest.approx(share.at_low + 0.1 * slope, rel=0.01)
    assert rows["reading"].at_high == table.nominal + 1.0
    assert rows["length"].reproduces == pytest.approx(2.0 / table.nominal, rel=0.05)
