"""Electrical power of a drive from d and q quantities, against the equations of the motor."""

from __future__ import annotations

import numpy as np
import pytest

from robot_energy.physics.electrical_power import electrical_power

RESISTANCE, INDUCTANCE, FLUX, POLE_PAIRS = 0.8, 3e-3, 0.11, 4  # ohm, H, V s, of one motor


@pytest.mark.parametrize(
    ("speed", "torque", "field"), [(200.0, 3.0, -1.5), (150.0, -2.0, 0.0), (0, 2, 1)]
)
def test_power_is_shaft_power_and_copper_loss(speed, torque, field):
    """A steady motor with equal inductances: ``u_d = R i_d - w_e L i_q`` and ``u_q = R i_q + w_e
    (L i_d + psi)`` give ``P = tau w + 3/2 R (i_d^2 + i_q^2)``: reactive parts cancel."""
    current_q = torque / (1.5 * POLE_PAIRS * FLUX)
    electric = POLE_PAIRS * speed
    voltage_d = RESISTANCE * field - electric * INDUCTANCE * current_q
    voltage_q = RESISTANCE * current_q + electric * (INDUCTANCE * field + FLUX)
    copper = 1.5 * RESISTANCE * (field**2 + current_q**2)
    quantities = [np.array([value]) for value in (field, current_q, voltage_d, voltage_q)]
    assert electrical_power(*quantities) == pytest.approx(torque * speed + copper, rel=1e-12)


def test_three_scalings_of_one_motor_are_one_power():
    peak = [np.array([value]) for value in (0.5, 4.0, -20.0, 90.0)]
    rms = [value / np.sqrt(2.0) for value in peak]
    invariant = [value * np.sqrt(1.5) for value in peak]
    power = electrical_power(*peak)
    assert power == pytest.approx(1.5 * (4.0 * 90.0 - 0.5 * 20.0))
    assert electrical_power(*rms, scaling="rms") == pytest.approx(power)
    assert electrical_power(*invariant, scaling="power_invariant") == pytest.approx(power)


def test_a_missing_value_is_no_power():
    known, missing = np.ones(1), np.full(1, np.nan)
    assert np.isnan(electrical_power(known, known, missing, known)).all()
