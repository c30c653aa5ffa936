"""Recorded joint states as a program: its rests, its energy, and the rests that are free."""

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.api.optimize import read_form
from robot_energy_plan.motion.joint_trajectory import read_csv_trajectory
from robot_energy_plan.motion.ptp import Program
from robot_energy_plan.motion.ptp_file import program_for, read_program
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.trajectory_form import recorded_motion
from sound_recordings import write_states

MODEL = load("kr16")
MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"
RATE = 250.0  # Hz
NOISE = 2e-5  # rad
BAG = ROOT / "bags/kr16_warm"


def measured(path, kept=slice(None), shares=None):
    """Noisy joint states of the program's cycle, with half a second of rest at both ends."""
    program = program_for(read_program(MOVES), Robot.from_model(MODEL).limits).program
    if shares is not None:
        program = Program(program.via, program.limits, program.dwell, 1.0, shares, shares**2)
    time = np.arange(-0.5, program.period + 0.5, 1.0 / RATE)
    motion = program.sample(np.clip(time, 0.0, program.period))
    noise = np.random.default_rng(1).normal(0.0, NOISE, motion.joint_position.shape)
    position = motion.joint_position + noise
    write_states(path, MODEL.joint_names, RATE, position, np.empty((len(time), 0)), kept)
    return program


def test_the_moves_and_rests_of_a_program_are_found_in_its_recording(tmp_path):
    program = measured(tmp_path / "bag")
    found = re.optimize(tmp_path / "bag", MODEL, 30.0).report
    given = re.optimize(MOVES, MODEL, 30.0).report
    assert len(found.moves) == len(given.moves) == 4
    made = recorded_motion(tmp_path / "bag", MODEL)
    at = np.linspace(0.0, program.period, 500)
    wanted = program.sample(at)
    shift = made.duration - program.period  # what is left of the rest before the first move
    errors = [
        np.abs(made.sample(at + lead).joint_position - wanted.joint_position).max()
        for lead in np.arange(0.0, shift + 1e-9, 0.004)
    ]
    assert min(errors) < 2e-3
    assert given.before.energy == pytest.approx(found.before.energy, rel=0.12)  # other rests


def test_the_recording_costs_what_its_replay_costs():
    """The same motion through the stages that replay bags: two computations of one energy."""
    found = re.optimize(BAG, MODEL, 40.0, start=2.0, end=20.0).report
    note = next(one for one in found.notes if "from the first to the last rest" in one)
    begin, end = (float(word) for word in note.rsplit(": ", 1)[1].removesuffix(" s").split(" to "))
    options = {"start": 2.0 + begin, "end": 2.0 + end}
    replayed = re.replay(BAG, MODEL, temperature=40.0, **options)
    assert found.before.energy == pytest.approx(replayed.energy.net, rel=0.003)
    assert found.problems == ()


def test_free_rests_are_filled_with_slower_moves_in_the_same_time(tmp_path):
    measured(tmp_path / "bag")
    kept = re.optimize(tmp_path / "bag", MODEL, 30.0)
    free = re.optimize(tmp_path / "bag", MODEL, 30.0, free_rests=True)
    assert free.report.cycle_time == pytest.approx(kept.report.before.duration, abs=1e-6)
    assert free.report.after.duration == pytest.approx(free.report.cycle_time, abs=1e-6)
    assert free.report.after.energy < kept.report.after.energy
    free.write(tmp_path / "cheap.csv")
    cheap = read_csv_trajectory(tmp_path / "cheap.csv")
    made = recorded_motion(tmp_path / "bag", MODEL)
    ends = [one.sample(np.array([0.0, one.duration])).joint_position for one in (cheap, made)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)


def test_a_joint_that_rests_keeps_no_move_slow(tmp_path):
    """Joints 4 and 5 never move and show noise alone; moves 1 and 3 are the same way down."""
    measured(tmp_path / "bag", shares=np.array([0.5, 0.5, 1.0, 1.0]))
    chain = PowerChain(MODEL, np.full((1, 6), 30.0))
    form = read_form(tmp_path / "bag", MODEL, chain.robot)
    # a factor of two by the program; the filter takes more from the peaks of a fast move
    assert ((form.moves.fastest[:2] > 1.4) & (form.moves.fastest[:2] <= 2.0)).all()
    assert form.moves.fastest[2:] == pytest.approx([1.0, 1.0])
    assert np.isinf(form.acceleration).tolist() == [False, False, True, True, True, False]
    found = re.optimize(tmp_path / "bag", MODEL, 30.0, time_law=True).report
    saved = {one.name: one.saving for one in found.measures}
    assert saved["move_overrides"].relative > 0.03
    assert saved["time_law"].energy >= saved["move_overrides"].energy
    assert found.problems == ()


def test_what_is_no_whole_cycle_is_refused(tmp_path):
    kept = np.r_[0:500, 900:1500]
    measured(tmp_path / "gap", kept)
    with pytest.raises(MotionError, match=r"has a gap 1\.996 s after the first"):
        recorded_motion(tmp_path / "gap", MODEL)
    assert recorded_motion(tmp_path / "gap", MODEL, TimeRange(0.0, 1.9)).duration < 1.9
    with pytest.raises(MotionError, match="never moves"):
        re.optimize(tmp_path / "gap", MODEL, 30.0, end=0.6)
    with pytest.raises(MotionError, match="no rest in this part"):
        recorded_motion(BAG, MODEL, TimeRange(3.5, 4.2))
