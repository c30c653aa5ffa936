"""Time laws along given paths: a case with a known answer, limits, and a trajectory written."""

from types import SimpleNamespace

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.model import load
from robot_energy.model.joint import ViscousExponent
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion.joint_trajectory import read_csv_trajectory
from robot_energy_plan.motion.ptp import MotionLimits, Trajectory
from robot_energy_plan.optimization.chain import (
    TORQUE_SHARE,
    Candidates,
    PowerChain,
    PtpMoves,
    grid,
)
from robot_energy_plan.optimization.program_form import MIN_REST, PtpForm
from robot_energy_plan.optimization.search import CyclePlan
from robot_energy_plan.optimization.time_law import LawLimits, PathPower, path_power, time_law
from robot_energy_plan.optimization.timed_moves import law_limits, timed_form, timed_moves
from robots import figure

MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"
PARTS = 20


def flat(viscous, copper=0.0, torque=0.0):
    """One axis that turns at 10 rad/s per path second, without inertia."""
    ones = np.ones((2 * PARTS + 1, 1))
    none = 0.0 * ones
    return PathPower(
        velocity=ones, acceleration=none, speed=10.0 * ones, still=torque * ones, squared=none,
        rising=none, viscous=10.0 * viscous * ones, gravity=none,
        friction=(none[:, 0], 100.0 * viscous * ones[:, 0]), constant=0.0,
        loss=(none[:, 0], none[:, 0]), copper=np.array([copper]),
    )  # fmt: skip


def free(velocity=1e3):
    much = np.array([1e6])
    return LawLimits(np.array([velocity]), much, much, np.array([np.inf]))


@pytest.mark.parametrize("standing", [25.0, 100.0, 400.0])
def test_viscous_friction_against_standby_has_a_known_answer(standing):
    """Least of ``fv w0^2 y + P / y``: ``y = sqrt(P / (fv w0^2))``, here sqrt(P / 100)."""
    law = time_law(flat(viscous=1.0), 0.05, free(), 0.0, standing)
    assert law == pytest.approx(np.full(PARTS + 1, np.sqrt(standing / 100.0)), rel=2e-2)


def test_friction_along_a_path_is_that_of_the_model_by_a_power_of_the_speed():
    """At the speed of the path itself: ``fc sgn(w) + fv wq sgn(w) (|w| / wq)^q`` by hand."""
    model = load("kr16")
    bent = ViscousExponent.model_validate({"exponent": figure(0.7), "velocity": figure(30.0)})
    joints = [
        joint.model_copy(
            update={"friction": joint.friction.model_copy(update={"viscous_exponent": bent})}
        )
        for joint in model.joints
    ]
    chain = PowerChain(model.changed(joints=joints), np.full((1, 6), 40.0))
    still = np.zeros((3, 6))
    speed = np.array([[1.0], [-0.1], [0.0]]) * np.ones(6)
    found = path_power(chain, Trajectory(still, speed, still))
    w, fv = found.speed, chain.friction.viscous(np.full(6, 40.0))
    along = fv * 30.0 * np.sign(w) * (np.abs(w) / 30.0) ** 0.7
    np.testing.assert_allclose(found.viscous, along)
    np.testing.assert_allclose(found.friction[1], (along * w).sum(axis=1))


def test_copper_loss_counts_with_the_time_it_flows():
    """Least of ``(P + k tau^2) / y + fv w0^2 y`` with a torque that does not depend on y."""
    places = flat(viscous=1.0, copper=3.0, torque=5.0)
    places = PathPower(**{**places.__dict__, "viscous": 0.0 * places.viscous})
    law = time_law(places, 0.05, free(), 0.0, 25.0)
    assert law == pytest.approx(np.full(PARTS + 1, 1.0), rel=2e-2)


def test_the_speed_limit_holds():
    law = time_law(flat(viscous=0.01), 0.05, free(velocity=1.5), 0.0, 400.0)
    assert law == pytest.approx(np.full(PARTS + 1, 1.5), rel=1e-3)


@pytest.fixture(scope="module")
def found():
    model = load("kr16")
    chain = PowerChain(model, np.full((1, 6), 30.0))
    limits = MotionLimits.of_robot(chain.robot, chain.robot.limits.velocity / 0.5)
    via = 0.4 * np.array([[1.0, -1.0, 1.0, 1.0, 0.5, 0.0], [-1.0, -0.2, 0.5, -1.0, 1.0, 1.0]])
    moves = PtpMoves(via, via[::-1], limits)
    base = Candidates(np.arange(2), np.full(2, 0.5), np.full(2, 0.25))
    jerk = 2.0 * limits.acceleration / limits.jerk_time
    bounds = law_limits(chain, limits.acceleration, jerk)
    return chain, limits, moves, timed_moves(chain, moves, base, bounds), via


def test_laws_keep_speed_acceleration_torque_and_ends(found):
    chain, limits, _, timed, via = found
    every = timed.laws
    assert len(every) >= 8
    assert (chain.moves(timed, every).torque_use <= TORQUE_SHARE).all()
    for one in range(len(every)):
        law = every[np.array([one])]
        time = np.linspace(0.0, float(timed.duration(law)[0]), 3001)
        path = timed.sample(law, np.zeros(3001, dtype=np.int64), time)
        assert (np.abs(path.joint_velocity) <= limits.velocity * (1 + 1e-6)).all()
        assert (np.abs(path.joint_acceleration) <= limits.acceleration).all()
        move = int(law.move[0])
        assert path.joint_position[0] == pytest.approx(via[move], abs=1e-9)
        assert path.joint_position[-1] == pytest.approx(via[1 - move], abs=1e-6)
        slope = np.gradient(path.joint_position, time, axis=0)[2:-2]
        assert slope == pytest.approx(path.joint_velocity[2:-2], abs=0.02)


def test_a_law_needs_less_than_any_trapezoid_that_is_not_slower(found):
    chain, _, moves, timed, _ = found
    ways = grid(moves)
    plain, laws = chain.moves(moves, ways), chain.moves(timed, timed.laws)
    for move in range(2):
        mine = np.flatnonzero(timed.laws.move == move)
        best = mine[np.argmin(laws.energy[mine])]
        others = (ways.move == move) & (plain.duration <= laws.duration[best] * 1.001)
        assert laws.energy[best] < 0.995 * plain.energy[others].min()


@pytest.mark.parametrize(("first", "waits"), [(0.0, 0.0), (0.5 * MIN_REST, 0.0), (0.5, 0.5)])
def test_a_written_trajectory_begins_at_zero(tmp_path, first, waits):
    """Also where the rest before its first move is rounding."""
    robot = Robot.from_model(load("kr16"))
    form = PtpForm(MOVES, robot)
    rest = np.where(np.arange(form.moves.count) == 0, first, 0.25)
    plan = CyclePlan(form.base.move, rest, (None,) * len(rest))
    task = SimpleNamespace(table=SimpleNamespace(candidates=form.base))
    timed_form(form, form.moves).write(tmp_path / "law.csv", task, plan)
    time = np.loadtxt(tmp_path / "law.csv", delimiter=",", skiprows=1)[:, 0]
    assert time[0] == 0.0
    ends = waits + rest[1:].sum() + form.moves.duration(form.base).sum()
    assert time[-1] == pytest.approx(ends, abs=1e-6)


def test_a_program_with_laws_is_written_as_a_trajectory(tmp_path):
    found = re.optimize(MOVES, "kr16", 40.0, cycle_time=8.0, time_law=True)
    plain = re.optimize(MOVES, "kr16", 40.0, cycle_time=8.0)
    assert found.report.after.energy <= plain.report.after.energy * (1 + 1e-6)
    assert found.report.problems == ()
    found.write(tmp_path / "law.csv")
    assert read_csv_trajectory(tmp_path / "law.csv").duration == pytest.approx(8.0, abs=1e-3)
    again = re.predict(tmp_path / "law.csv", "kr16", 40.0)
    assert again.energy.net == pytest.approx(found.report.after.energy, rel=5e-3)
    assert any(one.speed is None for one in found.report.moves)
