"""The experiment by motion: one uninterrupted rig, some of whose sets are recorded."""

import numpy as np
import pytest

from plants import LIMITS, two_link_profile
from robot_energy.bag import BagReader
from robot_energy_papers import experiment
from robot_energy_papers.experiment import MotionSequence, Plan, by_motion, make_programs, soaked
from robot_energy_plan.motion import Program
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_rig.record import outputs

HOME = np.array([0.3, -1.0])
SET = Program(np.array([HOME, [1.4, 0.8], [-0.6, 1.2]]), LIMITS, dwell=1.2)
WARM_UP = Program(np.array([HOME, [-1.0, 1.0]]), LIMITS, dwell=0.0)
HOLD = Program(np.array([HOME, [1.0, -1.5]]), LIMITS, dwell=1.0)
FAST = RigConfig(thermal_speedup=50.0)


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(experiment, "WARM_UP", 3.0)
    monkeypatch.setattr(experiment, "REST", 6.0)


def test_recorded_sets_are_pieces_of_one_uninterrupted_rig(short, tmp_path, monkeypatch):
    profile = two_link_profile(tmp_path)
    monkeypatch.setattr(experiment, "allowed", lambda profile: (LIMITS, None))
    plan = Plan(3, (20.0, 22.0), cool_cycles=2, cool_at=(200.0,))
    sets, rest = by_motion(profile, SET, WARM_UP, plan, tmp_path, "x", 5, HOLD, FAST)
    heat = WARM_UP.period * np.ceil(3.0 / WARM_UP.period)
    cycle = SET.period + heat
    # The first set is due at once, the second at 22 degC, which the first warm-up passes.
    assert [entry.way for entry in sets] == ["heating", "heating", "cooling"]
    begin = [HOLD.period, HOLD.period + cycle, HOLD.period + 3 * cycle + 6.0]
    assert [entry.time for entry in sets] == pytest.approx(begin)
    assert rest is not None
    assert rest.path.name == "x_hold"
    # The same rig, run without recording anything.
    parts = [(HOLD, HOLD.period), *[(SET, SET.period), (WARM_UP, heat)] * 3]
    parts += [(Program(SET.via[:1], LIMITS, 6.0), 6.0), (SET, SET.period)] * 2
    sequence = MotionSequence(parts)
    rig = VirtualRig(profile, sequence, FAST, 5)
    truth = [piece.truth for piece in outputs(rig, sequence.duration)]
    stamp = np.concatenate([part.stamp_ns for part in truth])
    power = np.concatenate([part.grid_power for part in truth])
    gear = np.concatenate([part.gear_temperature_degc for part in truth])
    for entry in sets:
        first = round((entry.time - 0.0) * 250 + 0.499)
        count = entry.recording.messages["/joint_states"]
        rows = slice(first, first + count)
        assert count == pytest.approx(SET.period * 250, abs=1)
        assert entry.recording.energy == pytest.approx(power[rows].sum() * 0.004, rel=1e-12)
        np.testing.assert_array_equal(entry.recording.gear_temperature_degc, gear[rows][[0, -1]])
        assert BagReader(entry.path).start_ns >= stamp[first] - 1_000_000
    assert sets[1].rise > 0
    assert sets[1].recording.motor_temperature_degc[0].mean() > 22.0


def test_soaked_rigs_start_with_motors_gears_and_hall_at_one_temperature(tmp_path):
    profile = two_link_profile(tmp_path)
    cold, hot = soaked(profile, SET, (30.0, 60.0), tmp_path, "s", 1)
    for entry, degc in ((cold, 30.0), (hot, 60.0)):
        recording = entry.recording
        assert (recording.motor_temperature_degc[0] == degc).all()
        assert (recording.gear_temperature_degc[0] == degc).all()
    # One meter: the same gain, and the same noise of every sensor.
    assert cold.recording.messages == hot.recording.messages


def test_programs_of_training_and_test_differ_and_begin_in_one_pose():
    programs = make_programs(load_profile("kr16"), 0, moves=4)
    assert programs.train.moves == programs.test.moves == 4
    home = programs.train.via[0]
    for name in ("test", "hold", "train_warm_up", "test_warm_up"):
        np.testing.assert_array_equal(getattr(programs, name).via[0], home)
    assert not np.allclose(programs.train.via[1:], programs.test.via[1:])
    # At rest until the thermometers have spoken, then in motion.
    still = programs.test.sample(np.linspace(0.0, experiment.LEAD, 50)).joint_velocity
    assert not still.any()
    moving = programs.test.sample(np.array([experiment.LEAD + 0.1])).joint_velocity
    assert np.abs(moving).max() > 0.1
    again = make_programs(load_profile("kr16"), 0, moves=4)
    np.testing.assert_array_equal(programs.test.via, again.test.via)
    other = make_programs(load_profile("kr16"), 1, moves=4)
    assert not np.allclose(programs.train.via, other.train.via)
