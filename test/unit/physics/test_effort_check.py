"""An effort that is not what it is taken for is said, with what it probably is."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from driver_messages import effort_of, motion, replaced
from robot_energy.model import load
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import MIN_SAMPLES, EffortCheck
from robot_energy.pipeline import Settings, TorqueStage
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_logs.ur_rtde import import_ur_rtde
from robots import one_wheel

DATA = os.environ.get("ROBOT_ENERGY_DATA", "")
UR5E = load("ur5e")
POSE = (0.0, -1.0, 1.2, 0.5, 0.5, 0.0)
BLOCK = motion(6, 100.0, 6.0, POSE)
CURRENT, MOTOR, JOINT = (
    EffortMeaning.MOTOR_CURRENT,
    EffortMeaning.MOTOR_TORQUE,
    EffortMeaning.JOINT_TORQUE,
)
REAL = [CURRENT, MOTOR, JOINT]


def doubts(taken_for, effort, model=UR5E, cut=None):
    """What is said of an effort, taken in blocks of any size."""
    stage = TorqueStage(model, Settings(effort=taken_for, derivative_window=0.1))
    block = replaced(BLOCK, joint_effort=effort)
    for start in range(0, len(block), cut or len(block)):
        stage.step(block[slice(start, start + (cut or len(block)))])
    stage.flush()
    return stage.effort_check.doubts()


@pytest.mark.parametrize("sent", REAL)
@pytest.mark.parametrize("taken_for", REAL)
def test_the_meaning_that_fits_is_named(sent, taken_for):
    effort = effort_of(UR5E, BLOCK, sent)
    friction = 0.3 * np.abs(effort).mean(axis=0) * np.sign(BLOCK.joint_velocity)
    said = doubts(taken_for, effort + friction)
    assert doubts(taken_for, effort + friction, cut=7) == said
    if sent is taken_for:
        assert said == []
    else:
        (sentence,) = said
        assert sentence.startswith(f"taken for {taken_for}, ")
        assert sentence.endswith(f"joint_states.effort_meaning is probably {sent}")


def test_an_effort_of_the_wrong_sign_is_said():
    (sentence,) = doubts(JOINT, -effort_of(UR5E, BLOCK, JOINT))
    assert "opposite sign" in sentence


def test_an_effort_without_gravity_is_said():
    """Only friction is left at this speed; a robot without gravity is not blamed for it."""
    friction = 0.8 * np.sign(BLOCK.joint_velocity)
    (sentence,) = doubts(JOINT, friction)
    assert "takes gravity out of it" in sentence
    assert "none" in sentence
    wheel = one_wheel()
    check = EffortCheck(JOINT, wheel, Drivetrain.from_model(wheel))
    check.step(np.full((MIN_SAMPLES, 1), 9.0), np.full((MIN_SAMPLES, 1), 1e-6))
    assert check.doubts() == []


def test_a_factor_that_no_meaning_explains_is_said():
    (sentence,) = doubts(CURRENT, 40.0 * effort_of(UR5E, BLOCK, JOINT))
    assert "check joint_states.effort_meaning, the torque constants" in sentence


def test_nothing_is_said_without_effort_or_too_early():
    effort = effort_of(UR5E, BLOCK, JOINT)
    assert doubts(EffortMeaning.NONE, effort) == []
    assert doubts(CURRENT, np.full_like(effort, np.nan)) == []
    assert doubts(CURRENT, np.zeros_like(effort)) == []
    stage = TorqueStage(UR5E, Settings(effort=CURRENT, derivative_window=0.1))
    stage.step(replaced(BLOCK, joint_effort=effort)[slice(0, MIN_SAMPLES // 2)])
    assert stage.effort_check.doubts() == []


def test_a_model_without_torque_constants_offers_no_current():
    joints = [joint.model_copy(update={"torque_constant": None}) for joint in UR5E.joints]
    model = UR5E.model_copy(update={"joints": joints})
    (sentence,) = doubts(JOINT, effort_of(UR5E, BLOCK, CURRENT), model)
    assert "probably" not in sentence or "motor_current" not in sentence


@pytest.mark.skipif(not DATA, reason="needs ROBOT_ENERGY_DATA")
@pytest.mark.parametrize("taken_for", REAL)
def test_currents_of_a_real_robot(tmp_path, taken_for):
    import_ur_rtde(sorted(Path(DATA).glob("rad_ur3e/*.csv"), reverse=True), tmp_path / "bag")
    result = replay(tmp_path / "bag", load("ur3e"), ReplaySetup.of({"effort": str(taken_for)}))
    said = [note for note in result.notes if "the effort" in note]
    print(said)
    assert bool(said) == (taken_for is not CURRENT)
