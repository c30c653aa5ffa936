"""The study of savings in its short form, and its counts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_cli.main import main
from robot_energy_plan.motion import MotionLimits, Program, random_program
from robot_energy_plan.optimization.chain import TORQUE_SHARE
from robot_energy_plan.optimization.search import cheapest
from robot_energy_rig import load_profile
from robot_energy_studies.savings import _shares
from robot_energy_studies.savings_study import JudgedSaving, PlantAtWork, run_as, task_of

EXACT = 1e-6  # by which a limit may be exceeded in rounding [-]


def judged(claim, half, truth):
    return JudgedSaving(1, 40.0, "slack", 1000.0, claim, half, truth, 0.0, 0.5)


def test_claims_signs_and_bands_are_counted():
    rows = [judged(50, 20, 60), judged(50, 20, -10), judged(5, 20, -10), judged(-30, 10, -35)]
    found = _shares(rows)
    assert (found["changes"], found["claimed"]) == (4, 2)
    assert found["sign_right"] == 0.5
    assert found["inside"] == 0.75
    assert found["inside_claimed"] == 0.5
    assert found["median_claim"] == 0.05


def exceeded_limits(seed: int, count: int) -> int:
    """Return how many random programs, made cheaper, are beyond a limit.

    Limits are those of position, speed, acceleration, jerk, torque and cycle time, by differences
    of positions; from one end of an acceleration to the other takes at least the jerk time.
    """
    model = load("kr16")
    robot = Robot.from_model(model)
    limits = MotionLimits.of_robot(robot, robot.limits.velocity / 0.3)
    found = 0
    for number in range(seed, seed + count):
        random = np.random.default_rng(np.random.SeedSequence(number, spawn_key=(0x6C696D,)))
        program = random_program(
            limits, int(random.integers(1 << 30)), 3, dwell=0.2,
            override=float(random.uniform(0.2, 0.9)),
        )  # fmt: skip
        stretch = float(random.uniform(1.0, 2.0)) * program.period
        task = task_of(model, program, limits, float(random.uniform(0.0, 80.0)), stretch)
        plan = task.plan(cheapest(task.table, task.allowed, task.time, task.wait_power))
        cheap = run_as(task, plan, program, limits)
        changed = plan.row != task.base.row
        torque = task.table.use.torque_use[plan.row][changed]
        found += cheap.period > stretch * (1 + EXACT) or bool((torque > TORQUE_SHARE).any())
        found += _beyond(cheap, limits)
    return found


def _beyond(program: Program, limits: MotionLimits) -> bool:
    """Whether differences of positions exceed a limit; a mean never exceeds what it is of."""
    step = 2e-3
    position = program.sample(np.arange(0.0, program.period, step)).joint_position
    speed = np.abs(np.diff(position, axis=0)).max(axis=0) / step
    acceleration = np.abs(np.diff(position, n=2, axis=0)).max(axis=0) / step**2
    jerk = np.abs(np.diff(position, n=3, axis=0)).max(axis=0) / step**3
    outside = (position < limits.lower - EXACT) | (position > limits.upper + EXACT)
    return bool(
        outside.any()
        or (speed > limits.velocity * (1 + EXACT)).any()
        or (acceleration > limits.acceleration * (1 + EXACT)).any()
        or (jerk * limits.jerk_time > 2.0 * limits.acceleration * (1 + 1e-3)).any()
    )


def test_no_random_program_leaves_its_limits():
    assert exceeded_limits(7, 4) == 0


def test_a_program_that_is_not_changed_costs_the_same_when_it_is_read_again():
    model = load("kr16")
    robot = Robot.from_model(model)
    limits = MotionLimits.of_robot(robot, robot.limits.velocity / 0.3)
    program = random_program(limits, 3, 4, dwell=0.3, override=0.6)
    task = task_of(model, program, limits, 40.0, None)
    same = run_as(task, task.base, program, limits)
    again = task_of(model, same, limits, 40.0, None)
    before, after = (one.table.cost(one.base).energy for one in (task, again))
    assert after == pytest.approx(before, rel=1e-9)
    rig = PlantAtWork(load_profile("kr16"), 40.0)
    assert rig.energy(same) == pytest.approx(rig.energy(program), rel=1e-9)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("savings") / "out"
    assert main(["reproduce", "savings", "--quick", "--out", str(folder)]) == 0
    return json.loads((folder / "figures.json").read_text()), folder


@pytest.mark.long
def test_the_short_form_writes_figures_and_a_page(found):
    figures, folder = found
    assert figures["by_measure"]["all"]["changes"] >= 4
    page = (folder / "report.html").read_text()
    assert "virtual rig" in page
    assert page.count("<img ") == 2


@pytest.mark.long
def test_waits_are_judged_alone(tmp_path):
    folder = tmp_path / "out"
    assert main(["reproduce", "savings", "--quick", "--waits", "--out", str(folder)]) == 0
    figures = json.loads((folder / "figures.json").read_text())
    assert figures["by_measure"]["slack"]["changes"] == 1
    # nothing else became slower: the cycle lasts as long, so what is saved was waiting
    assert all(abs(row["faster"]) < 1e-6 for row in figures["savings"])
    page = (folder / "report.html").read_text()
    assert "3 to 8 s" in page
    assert "--quick --waits" in page


@pytest.mark.long
def test_faster_is_cheaper_with_much_standby_and_a_cold_robot_wants_to_be_slower(found):
    best = {(row["standing"], row["degc"]): row["best"] for row in found[0]["curves"]}
    assert best[1.0, 70.0] > best[1.0, 10.0] > best[0.1, 10.0]
    assert best[1.0, 70.0] > best[0.1, 70.0] > best[0.1, 10.0]
