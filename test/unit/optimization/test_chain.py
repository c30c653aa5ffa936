"""Costs of many candidates: against the prediction of live operation, and figure by figure."""

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.model import load
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.schema import CabinetFan, Capacitor
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion import random_program
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.optimization.chain import Candidates, PowerChain, PtpMoves, grid
from robot_energy_plan.optimization.search import CostTable, CyclePlan, saving
from robot_energy_plan.prediction import predict

MODEL = load("kr16")
LIMITS = MotionLimits.of_robot(
    Robot.from_model(MODEL), Robot.from_model(MODEL).limits.velocity / 0.5
)


def with_capacitor(model):
    volt = {"nominal_voltage": 560.0, "chopper_voltage": 700.0, "capacitance": 2e-3}
    entries = {name: PositiveFigure(value=v, tag="assumed") for name, v in volt.items()}
    return model.changed(
        cabinet=model.cabinet.model_copy(update={"capacitor": Capacitor(**entries)})
    )


def with_figure(model, joint, **figures):
    joints = list(model.joints)
    friction = joints[joint].friction.model_copy(update=figures)
    joints[joint] = joints[joint].model_copy(update={"friction": friction})
    return model.changed(joints=joints)


def program(moves=6, override=0.6, seed=3):
    return random_program(LIMITS, seed, moves, dwell=0.3, override=override)


def cost_of(model, made, degc=30.0):
    """Energy of a cycle by the table, from the program's own shares."""
    chain = PowerChain(model, np.full((1, 6), degc))
    moves = PtpMoves.of_program(made, LIMITS)
    base = Candidates(
        np.arange(made.moves), made.override * made.speed_share,
        made.override**2 * made.acceleration_share,
    )  # fmt: skip
    use = chain.moves(moves, base, samples=100_000)
    table = CostTable(base, use, chain.rests(made.via), chain.rests(made.via, holding=False))
    return table.cost(CyclePlan(np.arange(made.moves), made.dwell, (None,) * made.moves))


def with_fan(model, on_above_degc):
    """Thermometers that are off change nothing at a temperature that is given."""
    power = PositiveFigure(value=80.0, tag="assumed", std=8.0)
    on, off = Figure(value=on_above_degc, tag="assumed"), (-9.0, 9.0, 0.0, 0.0, 0.0, 0.0)
    fan = CabinetFan(power=power, on_above_degc=on, thermometers=off)
    return model.changed(cabinet=model.cabinet.model_copy(update={"fan": fan}))


@pytest.mark.parametrize(
    "model",
    [MODEL, with_capacitor(MODEL), with_fan(MODEL, 29.0)],
    ids=["resistor", "capacitor", "fan"],
)
def test_a_cycle_costs_what_the_prediction_of_live_operation_says(model):
    made = program()
    motion = SampledMotion(
        made, model.joint_names, made.period, step=4e-3, instants=made.instants.tolist()
    )
    found = predict(model, motion, 30.0)
    registers, cost = found.account.registers, cost_of(model, made)
    assert cost.energy == pytest.approx(registers.cabinet("grid_import"), rel=2e-3)
    assert cost.duration == pytest.approx(made.period, rel=1e-9)
    assert cost.peak == pytest.approx(found.account.counts.peak_power, rel=5e-3)


def test_a_column_is_the_change_of_energy_with_its_figure():
    """Coulomb friction of joint 2, one standard deviation more, computed again."""
    made, std = program(), 0.05
    figure = PositiveFigure(value=MODEL.joints[1].friction.coulomb.value, tag="identified", std=std)
    sure = PositiveFigure(value=figure.value + std, tag="identified", std=std)
    before, after = (cost_of(with_figure(MODEL, 1, coulomb=f), made) for f in (figure, sure))
    expected = after.energy - before.energy
    nearest = np.abs(before.columns - expected).min()
    assert expected > 20.0
    assert nearest < 0.05 * expected  # the brake makes it a little nonlinear


def test_waiting_costs_the_fan_that_runs_meanwhile():
    """80 W and its deviation of 8 W for each second, at rest and in the table of a cycle."""
    rests = [
        PowerChain(model, np.full((1, 6), 30.0)).rests(np.zeros((1, 6)))
        for model in (with_fan(MODEL, 31.0), with_fan(MODEL, 29.0))
    ]
    assert rests[1].energy[0] - rests[0].energy[0] == pytest.approx(80.0)
    squares = [float(np.square(one.columns).sum()) for one in rests]
    assert squares[1] - squares[0] == pytest.approx(64.0, rel=1e-6)


def test_what_two_programs_share_cancels():
    made = program()
    cost = cost_of(MODEL, made)
    slower = cost_of(MODEL, replace_override(made, 0.58))
    assert saving(cost, cost).half == 0.0
    assert not saving(cost, cost).claimed
    assert saving(cost, slower).half < 0.1 * cost.half


def replace_override(made, override):
    return type(made)(made.via, LIMITS, made.dwell, override)


def test_candidates_keep_the_limits_and_the_ends():
    moves = PtpMoves(np.zeros((1, 6)), np.full((1, 6), 0.8), LIMITS)
    for one in range(len(ways := grid(moves))):
        part = ways[np.array([one])]
        time = np.linspace(0.0, float(moves.duration(part)[0]), 400)
        path = moves.sample(part, np.zeros(400, dtype=np.int64), time)
        assert (np.abs(path.joint_velocity) <= LIMITS.velocity * part.speed * (1 + 1e-9)).all()
        most = LIMITS.acceleration * part.acceleration * (1 + 1e-9)
        assert (np.abs(path.joint_acceleration) <= most).all()
        assert path.joint_position[[0, -1]] == pytest.approx(np.array([[0.0] * 6, [0.8] * 6]))


def test_brakes_take_the_holding_losses():
    robot = load("ur5e")
    chain = PowerChain(robot, np.full((1, 6), 30.0))
    stretched = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, -np.pi / 2, 0.0, 0.0, 0.0, 0.0]])
    held, braked = chain.rests(stretched), chain.rests(stretched, holding=False)
    assert (held.energy >= braked.energy).all()
    assert braked.energy[0] == pytest.approx(braked.energy[1], rel=1e-12)
    assert replace(held).energy.shape == (2,)
