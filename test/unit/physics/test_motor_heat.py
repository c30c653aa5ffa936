"""The exact solution against an integration of the equations, and against heat balances."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from robot_energy.model.joint import JointThermal
from robot_energy.physics.motor_heat import MotorHeat
from robots import figure

ENTRY = {"capacity": figure(2000.0), "conductance": figure(4.0)}
STRUCTURE = {
    "structure_capacity": figure(9000.0),
    "structure_conductance": figure(3.0),
    "friction_to_motor": figure(0.25),
}


def heat(*entries):
    return MotorHeat.of([JointThermal.model_validate(entry) for entry in entries])


@pytest.mark.parametrize("duration", [10.0, 700.0, 40_000.0])
def test_a_step_is_the_integral_of_both_balances(duration):
    transition, gain = heat({**ENTRY, **STRUCTURE}).step(duration)
    power, start = np.array([60.0, 20.0]), np.array([12.0, 5.0])  # above the ambient

    def balance(_, above):
        flow = 4.0 * (above[0] - above[1])
        return [(power[0] - flow) / 2000.0, (power[1] + flow - 3.0 * above[1]) / 9000.0]

    expected = solve_ivp(balance, (0.0, duration), start, rtol=1e-10, atol=1e-10).y[:, -1]
    np.testing.assert_allclose(transition[0] @ start + gain[0] @ power, expected, rtol=1e-6)


def test_one_node_is_an_exponential_towards_power_over_conductance():
    transition, gain = heat(ENTRY).step(1000.0)
    decay = np.exp(-1000.0 / 500.0)  # time constant 2000 / 4 s
    assert transition[0, 0, 0] == pytest.approx(decay, rel=1e-9)
    assert gain[0, 0, 0] * 40.0 == pytest.approx(10.0 * (1.0 - decay), rel=1e-9)
    assert (gain[0, :, 1] == 0.0).all()  # nothing but the motor takes heat


def test_a_motor_without_a_network_takes_no_heat_and_cools_to_the_ambient():
    """After its time constant exp(-1) of the temperature above the ambient is left."""
    motor = MotorHeat.of([None], cooling=600.0)
    transition, gain = motor.step(600.0)
    assert transition[0, 0, 0] == pytest.approx(np.exp(-1.0), rel=1e-9)
    assert (gain == 0.0).all()
    assert (motor.share.item(), motor.idle.item()) == (1.0, 0.0)


def test_several_motors_are_independent():
    both = heat({**ENTRY, **STRUCTURE}, ENTRY).step(10.0)
    for place, entry in enumerate(({**ENTRY, **STRUCTURE}, ENTRY)):
        for together, alone in zip(both, heat(entry).step(10.0), strict=True):
            np.testing.assert_allclose(together[place], alone[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"capacity": figure(0.0)}, "capacity\n  Value error, must be > 0"),
        ({"structure_capacity": figure(1.0)}, "both or neither"),
        ({"friction_to_motor": figure(0.5)}, "needs a structure"),
        ({**STRUCTURE, "friction_to_motor": figure(1.5)}, "friction_to_motor <= 1"),
    ],
)
def test_networks_that_cannot_be_are_refused(change, words):
    with pytest.raises(ValidationError, match=words):
        JointThermal.model_validate({**ENTRY, **change})
