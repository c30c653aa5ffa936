"""The equations of the power chain, against numbers worked out by hand."""

import numpy as np
import pytest

import robot_energy as re
from robot_energy import physics


def test_viscous_friction_over_temperature():
    # 0.002 + 0.02 exp(-40 / 20) = 0.002 + 0.02 * 0.1353353 = 0.004706706
    assert physics.exponential_viscous(40.0, 0.002, 0.02, 20.0) == pytest.approx(0.004706706)
    held = physics.exponential_viscous([10.0, 90.0], 0.002, 0.02, 20.0, (20.0, 80.0))
    assert held == pytest.approx([0.002 + 0.02 * np.exp(-1), 0.002 + 0.02 * np.exp(-4)])
    assert physics.constant_viscous([20.0, 60.0], 0.01).tolist() == [0.01, 0.01]
    assert np.isnan(physics.constant_viscous(np.nan, 0.01))
    table = physics.table_viscous([10.0, 20.0, 40.0, 99.0], [20, 40, 60], [0.03, 0.02, 0.01])
    assert table == pytest.approx([0.03, 0.03, 0.02, 0.01])


def test_friction_torque():
    # 0.5 sgn(w) + 0.01 w
    torque = physics.friction_torque([100.0, -100.0, 0.0], 0.5, 0.01)
    assert torque == pytest.approx([1.5, -1.5, 0.0])
    # load: (0.5 + 0.1 * |-4|) + 1 = 1.9
    loaded = physics.friction_torque(100.0, 0.5, 0.01, motor_torque_rigid=-4.0, load_coulomb=0.1)
    assert loaded == pytest.approx(1.9)
    # Stribeck at its own speed: 0.5 + 0.2 / e + 0.1
    stribeck = physics.friction_torque(
        10.0, 0.5, 0.01, stribeck_torque=0.2, stribeck_velocity=10.0, stribeck_exponent=2.0
    )
    assert stribeck == pytest.approx(0.6 + 0.2 / np.e)
    # smooth sign at its own speed: 0.5 tanh(1) + 0.1
    assert physics.friction_torque(10.0, 0.5, 0.01, smooth_velocity=10.0) == pytest.approx(
        0.5 * np.tanh(1) + 0.1
    )
    # exponent 1/2, nothing changed at 25 rad/s: 25 sqrt(100 / 25) = 50, 25 sqrt(4 / 25) = 10
    bent = physics.friction_torque(
        [100.0, -4.0, 0.0], 0.5, 0.01, viscous_exponent=0.5, exponent_velocity=25.0
    )
    assert bent == pytest.approx([0.5 + 0.5, -0.5 - 0.1, 0.0])
    still = physics.friction_torque([1e-4, 5.0], 0.5, 0.0, standing=np.array([True, False]))
    assert still.tolist() == [0.0, 0.5]


def test_friction_broadcasts_over_samples_and_joints():
    torque = physics.friction_torque(np.ones((2, 4, 3)), np.array([1.0, 2.0, 3.0]), 0.0)
    assert torque.shape == (2, 4, 3)
    assert torque[1, 2].tolist() == [1.0, 2.0, 3.0]


def test_coupling_keeps_the_power():
    coupling = np.array([[100.0, 0.0], [5.0, 50.0]])
    velocity = physics.motor_velocity([0.2, -0.1], coupling)
    assert velocity == pytest.approx([20.0, 5 * 0.2 - 50 * 0.1])
    torque = physics.motor_torque([300.0, 80.0], coupling)
    assert torque @ velocity == pytest.approx(300 * 0.2 - 80 * 0.1)
    assert torque == pytest.approx([(300 - 5 * 80 / 50) / 100, 80 / 50])
    assert physics.shaft_power(torque, velocity).sum() == pytest.approx(52.0)
    assert physics.rotor_torque([2.0, 1.0], coupling, [1e-3, 2e-3]) == pytest.approx([0.2, 0.12])


def test_a_coupling_that_does_not_fit_is_refused():
    with pytest.raises(re.ShapeError):
        physics.motor_velocity([0.2, 0.1], np.eye(3))
    with pytest.raises(re.ShapeError):
        physics.motor_torque([0.2, 0.1], np.ones((2, 2)))


def test_losses_of_a_drive():
    # 100 + 5 + 0.1 * 20 + 0.01 * 400 + 0.5 * (1 + 0.004 * 50) * 9 = 116.4
    power = physics.loss_model_power(
        100.0, -20.0, 3.0, 70.0,
        constant=5.0, linear=0.1, quadratic=0.01, copper=0.5, copper_temperature_coefficient=0.004,
    )  # fmt: skip
    assert power == pytest.approx(116.4)
    assert physics.loss_model_power(100.0, 20.0, 3.0) == 100.0


def test_the_grid_never_takes_back_what_the_brake_burns():
    flows = physics.grid_balance([1000.0, -1000.0], loss_dc=150.0, loss_grid=250.0)
    assert flows.grid_power.tolist() == [1400.0, 250.0]
    assert flows.brake_power.tolist() == [0.0, 850.0]
    back = physics.grid_balance([-1000.0], 150.0, 250.0, regeneration_efficiency=0.8)
    assert back.grid_power == pytest.approx([-0.8 * 850 + 250])
    assert back.loss_grid == pytest.approx([250 + 0.2 * 850])
    stored = physics.grid_balance([-1000.0], 150.0, 250.0, capacitor_power=[600.0])
    assert stored.brake_power == pytest.approx([250.0])
    assert stored.grid_power == pytest.approx([250.0])


def test_trapezoid_energy():
    assert physics.trapezoid_energy([0.0, 1.0, 3.0], [0.0, 10.0, 20.0]) == pytest.approx(35.0)
    both = physics.trapezoid_energy([0.0, 2.0], [[1.0, 10.0], [3.0, 10.0]])
    assert both.tolist() == [4.0, 20.0]
    assert physics.trapezoid_energy([], []) == 0.0
    assert np.isnan(physics.trapezoid_energy([0.0, 1.0], [np.nan, 1.0]))
    many = physics.trapezoid_energy(np.arange(2000.0), np.arange(2000.0))  # several pieces
    assert many == pytest.approx(1999.0**2 / 2)
    with pytest.raises(re.ShapeError):
        physics.trapezoid_energy([0.0, 1.0], [1.0])
