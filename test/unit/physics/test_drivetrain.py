import numpy as np
import pytest

import robots
from refusals import refused
from robot_energy.foundation.errors import ModelFileError
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.pipeline.torque_stage import TorqueStage


def test_coupling_turns_the_coupled_motor():
    drivetrain = Drivetrain.from_model(robots.two_link())
    motor = drivetrain.motor_velocity_from_joint(np.array([[1.0, 2.0]]))
    np.testing.assert_array_equal(motor, [[100.0, -50.0 * 2.0 + 10.0 * 1.0]])


def test_torque_map_is_worked_out_by_hand():
    # C = [[100, 0], [10, -50]]; tau_j = C^T tau_m: shoulder = 100 t1 + 10 t2, elbow = -50 t2
    drivetrain = Drivetrain.from_model(robots.two_link())
    motor = drivetrain.motor_torque_from_joint(np.array([[200.0, 100.0]]))
    np.testing.assert_allclose(motor, [[(200.0 - 10.0 * -2.0) / 100.0, -2.0]], rtol=1e-14)


def test_velocity_and_torque_maps_undo_each_other():
    drivetrain = Drivetrain.from_model(robots.two_link())
    values = np.random.default_rng(0).normal(size=(5, 2))
    back = drivetrain.joint_velocity_from_motor(drivetrain.motor_velocity_from_joint(values))
    np.testing.assert_allclose(back, values, rtol=1e-13)
    back = drivetrain.joint_torque_from_motor(drivetrain.motor_torque_from_joint(values))
    np.testing.assert_allclose(back, values, rtol=1e-13)


def test_rotor_torque_is_inertia_times_motor_acceleration():
    drivetrain = Drivetrain.from_model(robots.two_link())
    torque = drivetrain.rotor_torque(np.array([[3.0, 1.0]]))
    np.testing.assert_allclose(torque, [[1e-4 * 300.0, 2e-5 * (-50.0 + 30.0)]], rtol=1e-14)


def test_singular_coupling_is_refused():
    with refused(ModelFileError, remedy="coupling ratios"):
        Drivetrain(np.array([[1.0, 1.0], [1.0, 1.0]]), np.zeros(2))


def test_rigid_torque_adds_rotor_to_reflected_body_torque():
    model = robots.one_wheel()
    block = robots.joint_block(
        np.array([0.0]), np.array([[0.3]]), np.array([[1.0]]), np.array([[4.0]])
    )
    torque = TorqueStage(model).plan(block)
    assert torque is not None
    assert torque.joint_torque_rigid[0, 0] == pytest.approx(2.0 * 4.0)
    assert torque.motor_velocity[0, 0] == pytest.approx(10.0)
    assert torque.motor_torque_rigid[0, 0] == pytest.approx(8.0 / 10.0 + 0.01 * 40.0)
