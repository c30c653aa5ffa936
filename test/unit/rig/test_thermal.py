"""The thermal network against analytic solutions."""

from dataclasses import replace

import numpy as np

from robot_energy_rig import load_profile
from robot_energy_rig.plant import ThermalNetwork, longest_step

PROFILE = load_profile("kr16")


def network(profile=PROFILE, step=1.0, start=50.0, ambient=20.0):
    degc = np.full(6, start)
    return ThermalNetwork(profile, step, degc, degc, ambient)


def test_one_node_cools_and_heats_as_an_exponential():
    # A motor without heat and far better coupled than the gear is to the air moves with it.
    one = replace(PROFILE, motor_capacity=np.full(6, 50.0), motor_conductance=np.full(6, 50.0))
    step = longest_step(one) * 0.9
    nodes = network(one, step)
    heat = np.linspace(0.0, 100.0, 6)
    steps = round(600.0 / step)
    for _ in range(steps):
        nodes.step(np.zeros(6), heat)
    capacity = one.gear_capacity + one.motor_capacity
    end = 20.0 + heat / one.gear_conductance
    expected = end + (50.0 - end) * np.exp(-steps * step * one.gear_conductance / capacity)
    np.testing.assert_allclose(nodes.gear_temperature_degc, expected, atol=2e-2)
    np.testing.assert_allclose(nodes.motor_temperature_degc, expected, atol=5e-2)


def test_settles_where_the_heat_leaves():
    nodes = network(step=20.0)
    motor, gear = np.full(6, 12.0), np.full(6, 20.0)
    for _ in range(5000):
        nodes.step(motor, gear)
    expected = 20.0 + 32.0 / PROFILE.gear_conductance
    np.testing.assert_allclose(nodes.gear_temperature_degc, expected, rtol=1e-6)
    np.testing.assert_allclose(
        nodes.motor_temperature_degc, expected + 12.0 / PROFILE.motor_conductance, rtol=1e-6
    )


def test_step_length_does_not_matter_under_constant_heat():
    coarse, fine = network(step=20.0), network(step=0.25)
    heat = np.full(6, 80.0)
    coarse.step(heat, heat)
    for _ in range(80):
        fine.step(heat, heat)
    np.testing.assert_allclose(
        fine.motor_temperature_degc, coarse.motor_temperature_degc, rtol=1e-12
    )
    np.testing.assert_allclose(fine.gear_temperature_degc, coarse.gear_temperature_degc, rtol=1e-12)


def test_heat_is_conserved():
    nodes = network(step=0.5, start=20.0)
    heat = np.array([100.0, 50.0, 20.0, 10.0, 5.0, 0.0])
    nodes.step(heat, heat)
    stored = PROFILE.motor_capacity * (nodes.motor_temperature_degc - 20.0) + (
        PROFILE.gear_capacity * (nodes.gear_temperature_degc - 20.0)
    )
    # What has left to ambient in half a second is below one part in a thousand.
    np.testing.assert_allclose(stored, 2 * heat * 0.5, rtol=1e-3, atol=1e-9)


def test_gear_lags_the_heated_motor():
    nodes = network(step=1.0, start=20.0)
    for _ in range(120):
        nodes.step(np.full(6, 60.0), np.zeros(6))
    assert (nodes.motor_temperature_degc > nodes.gear_temperature_degc + 0.5).all()
    assert (nodes.gear_temperature_degc > 20.0).all()
