"""Viscosity of gear oil against published and derived figures."""

import numpy as np
import pytest

from refusals import refused
from robot_energy.foundation.errors import RigError
from robot_energy_rig import Lubricant

# Walther / ASTM D341 from catalogue figures at 40 and 100 degC: A, B, and nu at 20, 60, 80.
TABLE = [
    (150.0, 19.0, 7.747, 2.968, [446, 64.2, 32.8]),
    (150.0, 21.0, 7.292, 2.786, [414, 67.4, 35.5]),
    (150.0, 14.7, 8.974, 3.460, [545, 56.6, 26.6]),
    (220.0, 25.8, 7.472, 2.846, [672, 91.6, 45.5]),
    (320.0, 35.0, 7.215, 2.731, [1002, 130, 63.1]),
]


@pytest.mark.parametrize(("nu_40", "nu_100", "a", "b", "others"), TABLE)
def test_agrees_with_the_oil_tables(nu_40, nu_100, a, b, others):
    oil = Lubricant(nu_40, nu_100)
    assert oil.constants == pytest.approx((a, b), abs=2e-3)
    np.testing.assert_allclose(oil.viscosity(np.array([40.0, 100.0])), [nu_40, nu_100], rtol=1e-10)
    np.testing.assert_allclose(oil.viscosity(np.array([20.0, 60.0, 80.0])), others, rtol=6e-3)


@pytest.mark.parametrize(("grade", "low", "high"), [(150, 135, 165), (220, 198, 242)])
def test_lies_within_its_iso_grade(grade, low, high):
    oil = {150: Lubricant(150.0, 14.7), 220: Lubricant(220.0, 25.8)}[grade]
    assert low <= float(oil.viscosity(40.0)) <= high


def test_thins_with_temperature_and_is_held_far_outside():
    oil = Lubricant(150.0, 14.7)
    nu = oil.viscosity(np.linspace(-60.0, 250.0, 200))
    assert (np.diff(nu) <= 0).all()
    assert np.isfinite(nu).all()
    assert nu[0] == oil.viscosity(-40.0)


def test_friction_follows_the_square_root():
    oil = Lubricant(150.0, 21.0)
    assert float(oil.friction_factor(40.0)) == pytest.approx(1.0)
    ratio = oil.friction_factor(20.0) / oil.friction_factor(80.0)
    assert float(ratio) == pytest.approx(3.4, abs=0.05)


def test_an_oil_that_does_not_thin_is_refused():
    with refused(RigError, expected="viscosity_100 < viscosity_40"):
        Lubricant(100.0, 120.0)
