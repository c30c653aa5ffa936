"""How certain the friction of a constant is away from the temperature at which it was found."""

import numpy as np
import pytest

import robots
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.model import validate


def stds(degc, **more):
    """Deviation of the viscous coefficient of the shoulder, 5 +- 0.1, at some temperatures."""
    data = robots.two_link_data()
    viscous = robots.figure(5.0) | {"std": 0.1}
    data["joints"][0]["friction"]["viscous"] = {"law": "constant", "viscous": viscous, **more}
    total, shared = FrictionCertainty(validate(data, "m")).std(np.array([[d, 40.0] for d in degc]))
    return total[:, 0], shared[:, 0]


def test_a_constant_found_at_one_temperature_is_less_sure_at_others():
    """Colder by 10 K: 5 % of it per kelvin; warmer by 35 K: 2 %; and 0.4 % for the form."""
    total, shared = stds([8.0, 20.0, 60.0], fitted_degc=[18.0, 25.0])
    grown = np.array([10.0 * 0.05, 0.0, 35.0 * 0.02]) * 5.0
    form = np.array([10.0, 0.0, 35.0]) * 0.004 * 5.0
    assert total == pytest.approx(np.sqrt(0.1**2 + grown**2 + form**2))
    assert shared == pytest.approx(np.sqrt(grown**2 + form**2))


def test_a_constant_without_a_range_is_as_sure_everywhere():
    total, shared = stds([8.0, 20.0, 60.0])
    assert total == pytest.approx(0.1)
    assert shared == pytest.approx(0.0)
