"""Whole programs made cheaper: limits, write-back, states at rest, and what is not claimed."""

import json

import numpy as np
import pytest
import yaml

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import MotionError, ParameterError
from robot_energy.model import load
from robot_energy.model.figure import PositiveFigure
from robot_energy.physics.rigid_body import Robot
from robot_energy_cli.main import main
from robot_energy_plan.motion.joint_trajectory import read_csv_trajectory, write_csv
from robot_energy_plan.motion.load_motion import load_motion
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp_file import program_for, read_program
from robot_energy_plan.optimization.rest_states import RestState, break_even, rest_cost
from robot_energy_plan.results.optimization import NOT_CLAIMED

MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"
MODEL = load("kr16")
STATE = RestState(name="sleep", power=0.2, wake_time=10.0, wake_power=2.0)


def with_standby(watt):
    figure = PositiveFigure(value=watt, tag="identified", std=0.02 * watt)
    none = PositiveFigure(value=0.0, tag="identified", std=0.0)
    losses = {"loss_grid": figure, "loss_dc": none}
    return MODEL.changed(cabinet=MODEL.cabinet.model_copy(update=losses))


@pytest.fixture
def wide(tmp_path):
    """Large moves that reach the speed limits."""
    data = yaml.safe_load(MOVES.read_text())
    for via, sign in zip(data["via"], (1, -1, 1, -1), strict=True):
        via |= {"joint_a1": 120.0 * sign, "joint_a4": 100.0 * sign}
    del data["acceleration"]
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(data))
    return tmp_path / "wide.yaml"


def test_with_much_standby_the_fast_program_is_the_cheap_one_and_with_little_the_slow_one():
    much, little = (re.optimize(MOVES, with_standby(watt), 40.0).report for watt in (2000.0, 0.0))
    assert much.after.duration < 0.8 * much.before.duration
    assert much.saving.claimed
    assert little.after.duration > 0.95 * little.before.duration


def test_a_cold_robot_wants_other_speeds_than_a_warm_one(wide):
    cold, warm = (re.optimize(wide, MODEL, degc).report for degc in (5.0, 70.0))
    assert cold.after.duration > 1.05 * warm.after.duration
    both = re.optimize(wide, MODEL, (5.0, 70.0)).report
    times = [one.best_duration for one in both.temperatures]
    assert times == sorted(times, reverse=True)
    for one in both.temperatures:
        assert one.best_energy <= one.energy * (1 + 1e-6)


def test_the_chosen_program_keeps_every_limit_and_the_cycle_time(tmp_path):
    found = re.optimize(MOVES, MODEL, 30.0, cycle_time=9.0, peak_limit=900.0)
    found.write(tmp_path / "cheap.yaml")
    robot = Robot.from_model(MODEL)
    limits = robot.limits
    made = program_for(read_program(tmp_path / "cheap.yaml"), limits).program
    assert made.period == pytest.approx(9.0, abs=1e-4)
    path = made.sample(np.arange(0.0, made.period, 1e-3))
    given = program_for(read_program(MOVES), limits).program
    assert (np.abs(path.joint_velocity) <= limits.velocity * (1 + 1e-9)).all()
    most = np.full(6, np.deg2rad(300.0))
    assert (np.abs(path.joint_acceleration) <= most * (1 + 1e-9)).all()
    assert made.via == pytest.approx(given.via)
    assert (made.dwell >= given.dwell - 1e-6).all()
    again = re.predict(tmp_path / "cheap.yaml", MODEL, 30.0, repeat=1)
    assert again.energy.net == pytest.approx(found.report.after.energy, rel=2e-3)
    assert again.report.power.predicted_peak_grid_power <= 900.0 * 1.005
    assert again.problems == ()
    assert found.report.checked_energy == pytest.approx(again.energy.net, rel=1e-6)


def test_the_program_as_it_is_claims_nothing(tmp_path):
    """What was chosen, made cheaper once more: there is nothing left to claim."""
    re.optimize(MOVES, MODEL, 30.0).write(tmp_path / "cheap.yaml")
    again = re.optimize(tmp_path / "cheap.yaml", MODEL, 30.0).report
    assert not again.saving.claimed
    assert abs(again.saving.relative) < 0.01


def test_a_trajectory_comes_back_as_a_trajectory(tmp_path):
    robot = Robot.from_model(MODEL)
    made = program_for(read_program(MOVES), robot.limits).program
    time = np.arange(0.0, made.period, 0.02)
    write_csv(tmp_path / "moves.csv", MODEL.joint_names, time, made.sample(time))
    found = re.optimize(tmp_path / "moves.csv", MODEL, 30.0, cycle_time=10.0)
    assert len(found.report.moves) == 4
    assert found.report.problems == ()
    found.write(tmp_path / "cheap.csv")
    cheap = read_csv_trajectory(tmp_path / "cheap.csv")
    assert cheap.duration == pytest.approx(10.0, abs=0.05)
    fine = cheap.sample(np.linspace(0.0, cheap.duration, 5000))
    given = read_csv_trajectory(tmp_path / "moves.csv")
    before = given.sample(np.linspace(0.0, given.duration, 5000))
    assert (np.abs(fine.joint_velocity) <= robot.limits.velocity * (1 + 1e-6)).all()
    most = np.abs(before.joint_acceleration).max(axis=0) * 1.02
    assert (np.abs(fine.joint_acceleration).max(axis=0) <= most).all()
    re.optimize(tmp_path / "moves.csv", MODEL, 30.0, free_rests=True).write(tmp_path / "free.csv")
    assert read_csv_trajectory(tmp_path / "free.csv").notes == ()  # no point twice
    again = re.predict(tmp_path / "cheap.csv", MODEL, 30.0)
    assert again.energy.net == pytest.approx(found.report.after.energy, rel=5e-3)


def test_a_state_pays_from_its_break_even_on():
    """0.2 P (t - 10) + 2 P 10 = P t gives t = 22.5 s."""
    assert break_even(STATE, 1.0) == pytest.approx(22.5)
    assert rest_cost(STATE, 22.5).held == pytest.approx(22.5)
    assert rest_cost(STATE, 9.0) is None
    assert break_even(STATE, 0.1) == np.inf


@pytest.mark.parametrize(("cycle_time", "state"), [(25.0, None), (60.0, "sleep")])
def test_a_long_wait_is_spent_asleep(cycle_time, state):
    found = re.optimize(MOVES, MODEL, 30.0, cycle_time=cycle_time, rest_states=[STATE])
    names = {one.state for one in found.report.rests}
    assert (state in names) == (state is not None)
    assert found.report.after.duration == pytest.approx(cycle_time)
    row = next(one for one in found.report.measures if one.name == "rest_state")
    assert (row.saving.energy > 0) == (state is not None)


def test_what_is_smaller_than_its_band_is_not_claimed():
    found = re.optimize(MOVES, MODEL, 30.0, cycle_time=8.0, regenerative=True).report
    for one in found.measures:
        if one.saving is not None and 1e-6 < one.saving.relative and not one.saving.claimed:
            assert one.verdict == NOT_CLAIMED
            assert one.saving.half >= one.saving.energy
    assert any(one.verdict == NOT_CLAIMED for one in found.measures)


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"cycle_time": 1.0}, MotionError, "the cycle time is 1 s but the program needs"),
        ({"peak_limit": 300.0}, MotionError, "cannot be made within the limits"),
        ({"temperature": (60.0, 20.0)}, MotionError, "two that rise"),
        (
            {"cycle_time": 0.0},
            ParameterError,
            "'cycle_time' of optimize is 0.0; expected a number from 1e-06",
        ),
        ({"peak_limit": -1.0}, ParameterError, "'peak_limit' of optimize is -1"),
        ({"cycles_per_year": 0.0}, ParameterError, "'cycles_per_year' of optimize is 0"),
    ],
)
def test_impossible_wishes_are_refused(options, error, text):
    with pytest.raises(error, match=text):
        re.optimize(MOVES, MODEL, **{"temperature": 30.0, **options})


def test_the_command_writes_program_json_page_and_picture(tmp_path, capsys):
    outputs = {name: tmp_path / f"o.{name}" for name in ("yaml", "json", "html", "svg")}
    states = tmp_path / "states.yaml"
    states.write_text(yaml.safe_dump({"rest_states": [STATE.model_dump()]}))
    options = ("--out", "--json", "--report", "--plot")
    files = [str(x) for pair in zip(options, outputs.values(), strict=True) for x in pair]
    assert main(["optimize", str(MOVES), "--model", "kr16", "--temperature", "20..60",
                 "--cycle-time", "40", "--rest-states", str(states), "--regenerative",
                 "--cycles-per-year", "1000000", *files]) == 0  # fmt: skip
    out = capsys.readouterr().out
    for text in ("Each measure alone", "Move by move", "From which rest on a state pays", "sleep"):
        assert text in out
    data = json.loads(outputs["json"].read_text())
    assert data["result"] == "optimization"
    saved, half = (1e6 * data["saving"][name] / 3.6e6 for name in ("energy", "half"))
    year = f"In a year of 1000000 cycles, as given: {saved:.4g} kWh +- {half:.4g} kWh less"
    assert year in " ".join(out.split())
    assert outputs["html"].read_text().count("<figure>") == 1
    assert main(["predict", str(outputs["yaml"]), "--model", "kr16", "--temperature", "30"]) == 0
    motion = load_motion(outputs["yaml"], Robot.from_model(MODEL)).motion
    assert isinstance(motion, SampledMotion)
    assert motion.duration == pytest.approx(40.0, abs=1e-4)
    assert main(["optimize", str(MOVES), "--model", "kr16", "--temperature", "hot"]) == 2
