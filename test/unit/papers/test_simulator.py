"""The second simulator: hand-solved cases, another engine, and its own balance of energy."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robot_energy.bag import BagReader
from robot_energy.foundation.errors import MissingExtraError, RigError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_cli import main
from robot_energy_identify.data.recordings import read_recording
from robot_energy_papers.pages import document, print_template
from robot_energy_plan.motion import MotionLimits, random_program
from robot_energy_report.document import Document
from robot_energy_report.html import write_page
from robot_energy_studies import independent, simulator
from robot_energy_studies.independent import (
    Independent,
    IndependentRow,
    context,
    figures,
    pieces,
    published,
    warmed,
)
from robot_energy_studies.simulator.arm import GRAVITY, Body, ElasticArm, read_urdf
from robot_energy_studies.simulator.cabinet import DcLink
from robot_energy_studies.simulator.drawn import (
    CARRIER,
    FLANGE,
    LOAD_CENTRE,
    LOAD_INERTIA,
    LOAD_MASS,
    drawn_robot,
    urdf_path,
)
from robot_energy_studies.simulator.gear_friction import GearFriction, SlidingGears
from robot_energy_studies.simulator.heat import CASTING, HOUSING, WINDING
from robot_energy_studies.simulator.recording import START_NS, drawn_sensors, record
from robot_energy_studies.simulator.robots import LOSSES, STEP, Robots, even

PACKAGE = "robot_energy_studies"
MASS, LENGTH, INERTIA, RATIO, ROTOR = 3.0, 0.4, 0.05, 10.0, 1e-3
ALLOWED = {  # of what is not its own: containers, names of topics, recordings, motions; no physics
    "robot_energy.bag",
    "robot_energy.foundation.errors",
    "robot_energy.foundation.extras",
    "robot_energy.messages.fields",
    "robot_energy.timeline.blocks",
    "robot_energy_plan.motion.ptp",
    "robot_energy_rig.config",
    "robot_energy_rig.record",
}


def test_it_shares_no_physics_with_the_model():
    for path in Path(simulator.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("robot_energy"):
                own = node.module.startswith("robot_energy_studies.simulator")
                assert own or node.module in ALLOWED, (path.name, node.module)


def pendulum():
    """A rod on a horizontal axis that hangs at rest, with its rotor."""
    inertia = np.diag([INERTIA, INERTIA, 1e-3 + INERTIA])
    body = Body(
        "q", np.zeros(3), np.array([0.0, 1.0, 0.0]), MASS, np.array([0, 0, -LENGTH]), inertia
    )
    one = np.ones(1)
    return ElasticArm((body,), RATIO * one, ROTOR * one, 1e5 * one, 20.0 * one, (-1,))


def dry(torque):
    """Gears with nothing but dry friction."""
    names = GearFriction.__dataclass_fields__
    none = {name: np.zeros(1) for name in names}
    unit = {name: np.ones(1) for name in ("film_speed", "film_shape", "teeth_exponent",
            "film_exponent", "viscosity_exponent", "rated_torque", "rated_speed")}  # fmt: skip
    oil = {"vogel_b": np.full(1, 900.0), "vogel_c": np.full(1, 110.0)}
    return GearFriction(**none | unit | oil | {"boundary": torque, "bristle": np.full(1, 1e-3)})


def swings(start, friction):
    """Turning points of the pendulum on one side, and their times."""
    model, joints, rotors = pendulum().compiled(STEP)
    data = mujoco.MjData(model)
    data.qpos[joints], data.qpos[rotors] = start, start * RATIO
    gears = SlidingGears(dry(np.array([friction])), STEP, np.full((1, 1), 40.0), np.full(1, 1e-3))
    path = []
    for _ in range(8000):
        speed = data.qvel[rotors][None]
        if friction:
            data.qfrc_applied[rotors] = -gears.torque(speed, np.zeros((1, 1)))[0]
        mujoco.mj_step(model, data)
        path.append(float(data.qpos[joints][0]))
    path = np.array(path)
    top = np.flatnonzero((path[1:-1] > path[:-2]) & (path[1:-1] >= path[2:]) & (path[1:-1] > 0)) + 1
    return path[top], top * STEP


def test_a_pendulum_swings_as_solved_by_hand():
    """``T = 2 pi sqrt((I + m l^2 + J N^2) / (m g l))`` for small angles, the rotor included."""
    inertia = INERTIA + MASS * LENGTH**2 + ROTOR * RATIO**2
    period = 2 * np.pi * np.sqrt(inertia / (MASS * GRAVITY * LENGTH))
    tops, times = swings(0.02, 0.0)
    assert np.diff(times).mean() == pytest.approx(period, rel=1e-3)
    assert tops[-1] == pytest.approx(0.02, rel=2e-3)


def test_dry_friction_takes_the_same_angle_from_every_swing():
    """Work of dry friction: each period takes ``4 N F / (m g l)`` from the amplitude."""
    friction = 2e-3
    tops, _ = swings(0.1, friction)
    loss = 4 * RATIO * friction / (MASS * GRAVITY * LENGTH)
    assert len(tops) >= 4
    assert np.diff(tops) == pytest.approx(-loss, rel=0.03)


def test_rigid_bodies_move_as_those_of_pinocchio():
    bodies, frames = read_urdf(urdf_path())
    index, place = frames[FLANGE]
    last = bodies[index].with_load(LOAD_MASS, place + LOAD_CENTRE, np.diag(LOAD_INERTIA))
    ratio = np.full(6, 100.0)
    arm = ElasticArm(
        (*bodies[:-1], last), ratio, np.full(6, 1e-12), np.ones(6), np.zeros(6), CARRIER
    )
    model, joints, rotors = arm.compiled(STEP)
    data = mujoco.MjData(model)
    random = np.random.default_rng(5)
    state = random.uniform(-1.5, 1.5, (3, 20, 6))
    expected = Robot.from_model(load("kr16")).joint_torque(*state)
    for row in range(20):
        for vector, values in zip((data.qpos, data.qvel, data.qacc), state[:, row], strict=True):
            vector[joints], vector[rotors] = values, values * ratio
        mujoco.mj_inverse(model, data)
        # Rotors of 1 g sit in the joints and turn without inertia.
        assert data.qfrc_inverse[joints] == pytest.approx(expected[row], rel=1e-3, abs=0.1)


@pytest.fixture(scope="module")
def played():
    robot = drawn_robot(3)
    arm = Robot.from_model(load("kr16"))
    program = random_program(MotionLimits.of_robot(arm, robot.acceleration), 3, 3, dwell=0.2)
    run = Robots(robot, (program, program), even(2, 30.0, 6), np.array([20.0, 30.0])).run(4.0)
    return robot, program, run


def test_the_grid_gives_work_losses_and_stores(played):
    _, _, run = played
    assert np.abs(run.imbalance).max() < 1e-3
    assert all((run.energy[name] > 0).all() for name in LOSSES if name != "brake")
    assert run.grid_power.sum(axis=0) * STEP == pytest.approx(run.energy["grid"])


def test_an_unstable_robot_is_refused(played):
    robot, program, _ = played
    stiff = replace(robot, arm=replace(robot.arm, stiffness=100 * robot.arm.stiffness))
    with pytest.raises(RigError, match="unstable"):
        Robots(stiff, (program,), even(1, 30.0, 6), np.array([20.0])).run(1.0)


def test_the_controller_follows_its_motion(played):
    robot, program, run = played
    time = np.arange(0.0, 4.0, 4 * STEP)
    wanted = program.sample(time).joint_position
    assert np.abs(run.joint_position[:, 0] - wanted).max() < 0.15
    gear = run.motor_angle[:, 0] / robot.arm.gear_ratio - run.joint_position[:, 0]
    assert 1e-4 < np.abs(gear).max() < 0.02  # gears wind up


def test_colder_robots_need_more(played):
    robot, program, _ = played
    cold, hot = even(2, 20.0, 6), even(2, 80.0, 6)
    run = Robots(robot, (program, program), np.stack([cold[0], hot[0]]), np.full(2, 20.0)).run(3.0)
    assert run.energy["friction"][0] > 1.3 * run.energy["friction"][1]
    assert run.energy["copper"][0] > 0


def test_a_recording_is_read_as_that_of_a_robot(played, tmp_path):
    robot, _, run = played
    sensors = replace(drawn_sensors(1, 6), meter_gain=1.0)
    made = record(run, 1, 3.9, robot, sensors, tmp_path / "bag")
    assert set(made.messages) == {"/joint_states", "/motor_temperatures", "/power_meter"}
    assert set(BagReader(made.path).topics) == set(made.messages)
    assert made.messages["/joint_states"] == 975
    read = read_recording(made.path, published(robot), EffortMeaning.MOTOR_TORQUE).torque
    rows = np.rint((read.stamp_ns - START_NS) / (4 * STEP * 1e9)).astype(int)
    torque = run.current[rows, 1] * robot.motors.plate_constant
    assert read.motor_torque_measured == pytest.approx(torque, abs=0.4)
    assert read.motor_velocity == pytest.approx(run.motor_velocity[rows, 1], abs=8.0)
    comparison = replay(made.path, published(robot)).account.comparison
    assert comparison.measured_energy == pytest.approx(made.energy, rel=0.15)
    assert comparison.compared_ns > 3e9


def test_the_dc_link_settles_and_stores():
    """Under load ``V0 - V = R P / V``; braking fills the capacitor as far as the chopper."""
    cabinet = replace(drawn_robot(1).cabinet, link_load=0.0)
    nothing = np.zeros((200, 1))
    flows = DcLink(cabinet, 1, STEP).run(nothing + 3000.0, nothing)
    half = 0.5 * cabinet.open_voltage
    voltage = half + np.sqrt(half**2 - cabinet.source_resistance * 3000.0)
    current = 3000.0 / voltage
    assert flows.link[-1] == pytest.approx(3000.0, rel=1e-6)
    loss = cabinet.diode_voltage * current
    loss += cabinet.real_share * cabinet.source_resistance * current**2
    assert flows.rectifier_loss[-1] == pytest.approx(loss, rel=1e-6)
    braking = DcLink(cabinet, 1, STEP).run(nothing - 1000.0, nothing)
    assert (braking.link == 0).all()
    given = braking.stored + braking.brake
    assert given == pytest.approx(1000.0, rel=1e-3)
    full = 0.5 * cabinet.capacitance * (cabinet.chopper_on**2 - cabinet.open_voltage**2)
    first = int(np.argmax(braking.brake[:, 0] > 0))
    assert first * STEP == pytest.approx(full / 1000.0, abs=2 * STEP)


def test_heat_is_kept_and_goes_through_the_winding_first():
    network = drawn_robot(2).heat
    heat = np.zeros((4, 6))
    heat[WINDING] = 20.0
    degc = network.step(np.full((4, 6), 20.0), heat, 20.0, 600_000.0)
    rise = degc[WINDING] - degc[HOUSING]
    assert rise == pytest.approx(20.0 / network.winding_housing, rel=1e-6)
    degc = np.random.default_rng(1).uniform(20.0, 80.0, (4, 6))
    kept = (network.capacity * (network.step(degc, heat, 10.0, 1.0) - degc)).sum()
    given = network.housing_hall * (degc[HOUSING] - 10.0) ** 1.25
    given += network.casting_hall * (degc[CASTING] - 10.0) ** 1.25
    assert kept == pytest.approx(heat.sum() - given.sum() / 30.0**0.25)


def test_a_warm_up_leaves_parts_that_differ():
    robot = drawn_robot(2)
    heat = np.zeros((4, 6))
    heat[WINDING] = 0.02 * robot.motors.rated_torque * robot.motors.rated_speed
    cold, half, warm = warmed(robot.heat, heat, 20.0, (0.0, 0.5, 1.0))
    assert (cold == 20.0).all()
    assert half[WINDING].mean() == pytest.approx(0.5 * (20.0 + warm[WINDING].mean()), abs=1.0)
    assert np.ptp(warm[WINDING]) > 1.0
    assert warm[WINDING].max() < independent.HOTTEST_DEGC


def test_a_seed_is_a_robot():
    one, same, other = drawn_robot(4), drawn_robot(4), drawn_robot(5)
    assert one.arm.mjcf(STEP) == same.arm.mjcf(STEP) != other.arm.mjcf(STEP)
    assert (one.friction.film == same.friction.film).all()
    model = published(one)
    ratio = [joint.gear_ratio.value for joint in model.joints]
    assert ratio == pytest.approx(one.arm.gear_ratio)
    assert all(joint.friction.coulomb.value == 0.0 for joint in model.joints)


def test_the_page_counts_errors_and_refusals(tmp_path):
    error = {"fixed_20": (0.1, 0.3), "follows": (0.05, -0.02), "full": (0.01, 0.0)}
    sound = IndependentRow(1, error, "", (30.0, 70.0), (900.0, 700.0), 1e-5)
    less = IndependentRow(
        2, {"follows": (0.04, 0.08)}, "no losses", (30.0, 60.0), (800.0, 600.0), 2e-5
    )
    result = Independent(0, independent.QUICK, [sound, less])
    found = figures(result)
    assert found["worst_by_plant"]["follows"]["median"] == pytest.approx(0.065)
    assert found["error"]["fixed_20"]["worst"] == 0.3
    assert found["refused"] == ["no losses"]
    page = context(result) | {"command": "robot-energy reproduce independent"}
    write_page(document("independent", page, pieces(result), PACKAGE), tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "MuJoCo" in text
    assert text.count("refused") >= 2
    terminal = Document()
    print_template("independent_terminal", page, terminal, PACKAGE)


def test_without_mujoco_the_extra_is_named(monkeypatch):
    monkeypatch.setattr("robot_energy.foundation.extras.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="studies"):
        pendulum().compiled(STEP)


@pytest.mark.long
def test_the_short_form_identifies_robots_it_shares_nothing_with(tmp_path):
    folder = tmp_path / "out"
    assert main(["reproduce", "independent", "--quick", "--out", str(folder)]) == 0
    found = json.loads((folder / "figures.json").read_text())
    assert found["plants"] == [1, 2]
    assert found["imbalance"] < 1e-3
    worst = {name: found["error"][name]["worst"] for name in found["error"]}
    assert max(abs(worst["full"]), abs(worst["follows"])) < abs(worst["fixed_20"])
