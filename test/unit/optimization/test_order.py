"""Order of independent moves: against every order."""

from itertools import permutations

import numpy as np
import pytest
import yaml

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.order import _exact, _round, _turned, best_order
from robot_energy_plan.optimization.ptp_form import PtpForm

MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"


@pytest.mark.parametrize("count", [1, 2, 3, 6, 7])
def test_the_exact_order_is_the_best_of_all(count):
    cost = np.random.default_rng(count).uniform(1.0, 2.0, (count, count))
    best = min(_round(cost, np.array([0, *rest])) for rest in permutations(range(1, count)))
    found = _exact(cost)
    assert sorted(found.tolist()) == list(range(count))
    assert found[0] == 0
    assert _round(cost, found) == pytest.approx(best)
    assert _round(cost, _turned(cost)) <= _round(cost, np.arange(count)) + 1e-12


def mixed(tmp_path, **changes):
    """Four configurations on a line, visited to and fro."""
    data = yaml.safe_load(MOVES.read_text())
    for via, angle in zip(data["via"], (0.0, 60.0, 20.0, 40.0), strict=True):
        via |= {"joint_a1": angle, "joint_a2": -80.0, "joint_a6": 0.0}
    data |= {"dwell": [0.1, 0.6, 0.2, 0.4], **changes}
    (tmp_path / "mixed.yaml").write_text(yaml.safe_dump(data))
    return tmp_path / "mixed.yaml"


def test_places_on_a_line_are_visited_on_the_way(tmp_path):
    found = re.optimize(mixed(tmp_path), "kr16", 40.0, any_order=True)
    row = next(one for one in found.report.measures if one.name == "order")
    assert row.saving.relative > 0.02
    found.write(tmp_path / "cheap.yaml")
    made = yaml.safe_load((tmp_path / "cheap.yaml").read_text())
    angles = [via["joint_a1"] for via in made["via"]]
    rest = dict(zip(angles, made["dwell"], strict=True))
    assert angles[0] == 0.0
    assert rest == {0.0: 0.1, 60.0: 0.6, 20.0: 0.2, 40.0: 0.4}  # each keeps its rest
    there = angles.index(60.0)
    assert angles[:there] == sorted(angles[:there])
    assert angles[there:] == sorted(angles[there:], reverse=True)


def test_moves_with_speeds_of_their_own_keep_their_order(tmp_path):
    path = mixed(tmp_path, speed_share=[1.0, 0.5, 1.0, 1.0])
    with pytest.raises(MotionError, match="shares of their own"):
        re.optimize(path, "kr16", 40.0, any_order=True)


class Wall:
    """No robot: moves between two configurations touch."""

    def __init__(self, first, second):
        self._pair = {first.tobytes(), second.tobytes()}

    def touching_on_the_way(self, start, goal):
        touching = {start.tobytes(), goal.tobytes()} == self._pair
        return ("hand", "wall") if touching else None


def test_a_move_in_which_the_robot_touches_itself_is_never_made(tmp_path):
    model = load("kr16")
    chain = PowerChain(model, np.full((1, 6), 40.0))
    form = PtpForm(mixed(tmp_path), chain.robot)
    free = best_order(form, chain)
    via = form.joint_position[free]
    kept = best_order(form, chain, 0.0, Wall(via[2], via[3]))
    pairs = [{int(a), int(b)} for a, b in zip(kept, np.roll(kept, -1), strict=True)]
    assert {int(free[2]), int(free[3])} not in pairs
    assert sorted(kept.tolist()) == [0, 1, 2, 3]
