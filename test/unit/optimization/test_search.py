"""The cheapest choice of speeds, against every combination."""

from itertools import product

import numpy as np
import pytest

from robot_energy.foundation.errors import MotionError
from robot_energy_plan.optimization.chain import Candidates, Use
from robot_energy_plan.optimization.search import CostTable, CyclePlan, cheapest, front, uniform

MOVES, WAYS = 4, 5


def use(duration, energy, peak):
    size = len(duration)
    return Use(
        duration, energy, peak, np.zeros(size), np.zeros((size, 1)), np.zeros(size),
        energy[:, None],
    )  # fmt: skip


@pytest.fixture
def table():
    random = np.random.default_rng(4)
    move = np.repeat(np.arange(MOVES), WAYS)
    share = np.tile(np.linspace(0.2, 1.0, WAYS), MOVES)
    length = random.uniform(0.5, 2.0, MOVES)[move]
    duration = length / share
    energy = 300.0 * duration + 200.0 * length * share + random.uniform(0.0, 40.0, len(move))
    rest = use(np.ones(MOVES), np.full(MOVES, 300.0), np.full(MOVES, 300.0))
    return CostTable(
        Candidates(move, share, np.ones(len(move))),
        use(duration, energy, 1000.0 * share),
        rest,
        rest,
    )


def every(table):
    return [np.array(pick) + WAYS * np.arange(MOVES) for pick in product(range(WAYS), repeat=MOVES)]


@pytest.mark.parametrize("wait", [0.0, 280.0, 600.0])
@pytest.mark.parametrize("slack", [1.0, 1.3, 3.0])
def test_it_is_the_best_of_all_combinations(table, wait, slack):
    time = slack * float(table.use.duration[WAYS - 1 :: WAYS].sum())
    allowed = np.ones(len(table.candidates), dtype=bool)
    found = cheapest(table, allowed, time, wait)

    def price(rows):
        return table.use.energy[rows].sum() - wait * table.use.duration[rows].sum()

    best = min(
        price(rows) for rows in every(table) if table.use.duration[rows].sum() <= time + 1e-9
    )
    assert table.use.duration[found].sum() <= time + 1e-6
    assert price(found) == pytest.approx(best, rel=1e-4)


def test_what_is_not_allowed_is_not_chosen(table):
    allowed = table.use.peak <= 600.0
    assert (table.use.peak[cheapest(table, allowed, 1e3)] <= 600.0).all()
    with pytest.raises(MotionError, match="move 1 cannot be made within the limits"):
        cheapest(table, table.use.peak <= 1.0, 1e3)
    with pytest.raises(MotionError, match="the moves need at least"):
        cheapest(table, allowed, 0.1)


def test_one_share_for_all_moves_is_the_best_such_choice(table):
    allowed = np.ones(len(table.candidates), dtype=bool)
    rows = uniform(table, allowed, 1e3)
    assert len(set(table.candidates.speed[rows])) == 1
    sums = table.use.energy.reshape(MOVES, WAYS).sum(axis=0)
    assert table.use.energy[rows].sum() == pytest.approx(sums.min())


def test_no_point_of_the_front_is_worse_in_everything(table):
    allowed = np.ones(len(table.candidates), dtype=bool)
    plan = CyclePlan(WAYS * np.arange(MOVES), np.zeros(MOVES), (None,) * MOVES)
    points = np.array([(c.energy, c.duration, c.peak) for _, c in front(table, allowed, plan)])
    for point in points:
        others = (points <= point + 1e-9).all(axis=1) & (points < point - 1e-6).any(axis=1)
        assert not others.any()
    costs = [table.cost(CyclePlan(rows, plan.rest, plan.state)) for rows in every(table)]
    assert points[:, 0].min() == pytest.approx(min(c.energy for c in costs))
    assert points[:, 1].min() == pytest.approx(min(c.duration for c in costs))
    assert points[:, 2].min() == pytest.approx(min(c.peak for c in costs))
