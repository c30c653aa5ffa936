"""What a driver calls effort becomes motor torque by the meaning it was given, and only by that."""

import numpy as np
import pytest

import robots
from refusals import refused
from robot_energy.foundation.errors import ModelFileError
from robot_energy.model import load, save
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort
from robot_energy.timeline.blocks import EffortMeaning
from robots import figure


def two_link(*constants):
    data = robots.two_link_data()
    for joint, value in zip(data["joints"], constants, strict=False):
        joint["torque_constant"] = figure(value)
    return robots.two_link(joints=data["joints"])


def motor_torque(meaning, joint_effort, model=None):
    model = model or two_link(0.1, -0.2)
    effort = Effort.from_model(model, meaning, Drivetrain.from_model(model))
    return effort.motor_torque(np.asarray(joint_effort, dtype=float))


def test_joint_torque_reaches_the_motors_through_gears_and_coupling():
    # C = [[100, 0], [10, -50]]; C^T m = (30, 5): m2 = 5 / -50 = -0.1, m1 = (30 + 1) / 100
    found = motor_torque(EffortMeaning.JOINT_TORQUE, [[30.0, 5.0]])
    np.testing.assert_allclose(found, [[0.31, -0.1]], rtol=1e-14)
    # at joint velocities (1, 2) the motors turn at (100, 10 - 100) rad/s: 31 + 9 = 30 + 10 W
    assert found @ [100.0, -90.0] == pytest.approx(30.0 * 1.0 + 5.0 * 2.0)


def test_motor_current_times_the_torque_constant_with_its_sign():
    found = motor_torque(EffortMeaning.MOTOR_CURRENT, [[3.0, 2.0], [-1.0, 0.0]])
    np.testing.assert_allclose(found, [[0.3, -0.4], [-0.1, 0.0]], rtol=1e-14)


def test_motor_torque_is_taken_as_it_is():
    np.testing.assert_array_equal(
        motor_torque(EffortMeaning.MOTOR_TORQUE, [[3.0, -2.0]]), [[3.0, -2.0]]
    )


@pytest.mark.parametrize("meaning", list(EffortMeaning))
def test_unknown_effort_stays_unknown_and_touches_no_other_sample(meaning):
    found = motor_torque(meaning, [[1.0, 2.0], [np.nan, np.inf], [-np.inf, 2.0]])
    assert np.isnan(found[1]).all()
    assert np.isnan(found[2, 0])
    known = meaning is not EffortMeaning.NONE
    assert np.isfinite(found[0]).all() == known
    assert np.isfinite(found[2, 1]) == known


def test_coupled_motor_needs_the_effort_of_every_joint_that_loads_it():
    # the shoulder's motor holds C^-T tau, in which the elbow's torque appears
    found = motor_torque(EffortMeaning.JOINT_TORQUE, [[30.0, np.nan], [np.nan, 5.0]])
    np.testing.assert_array_equal(np.isfinite(found), [[False, False], [False, True]])


def test_current_without_a_torque_constant_is_refused_by_name():
    with refused(ModelFileError, found=("torque_constant", "elbow"), expected="N m/A"):
        motor_torque(EffortMeaning.MOTOR_CURRENT, [[1.0, 1.0]], two_link(0.1))


def test_other_meanings_need_no_torque_constant():
    for meaning in set(EffortMeaning) - {EffortMeaning.MOTOR_CURRENT}:
        assert motor_torque(meaning, [[1.0, 1.0]], robots.two_link()).shape == (1, 2)


def test_torque_constant_must_not_be_zero():
    with refused(ModelFileError, found=("shoulder", "torque_constant")):
        two_link(0.0)


def test_model_without_torque_constant_keeps_its_identity_and_its_file(tmp_path):
    assert load("kr16").model_id == "2c5f0b20342e"
    bare, full = robots.two_link(), two_link(0.1, 0.2)
    assert bare.model_id != full.model_id
    for number, model in enumerate((bare, full)):
        path = tmp_path / f"{number}.yaml"
        save(model, path)
        assert ("torque_constant" in path.read_text()) == (model is full)
        assert load(path).model_id == model.model_id
