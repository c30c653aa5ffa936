"""Bodies that can exist, near what is known of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robots
from robot_energy.physics.rigid_body import Robot
from robot_energy_identify.dynamics.consistent import (
    Prior,
    consistent_fit,
    link_prior,
    pseudo_inertia,
    second_moments,
)

LINKS = Robot.from_model(robots.two_link()).link_parameters


def lowest(values):
    """Least eigenvalue of every link's pseudo-inertia, as a share of its largest."""
    shares = []
    for start in range(0, 20, 10):
        size = np.linalg.eigvalsh(pseudo_inertia(values[start : start + 10]))
        shares.append(size[0] / size[-1])
    return min(shares)


def test_pseudo_inertia_of_a_ball_is_known():
    """Solid sphere: second moment m r^2 / 5 about each axis through its centre."""
    mass, radius, centre = 3.0, 0.2, np.array([0.1, -0.3, 0.5])
    about_centre = 0.4 * mass * radius**2 * np.eye(3)
    about_joint = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    i = about_joint
    link = [mass, *(mass * centre), i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2]]
    expected = mass * (radius**2 / 5 * np.eye(3) + np.outer(centre, centre))
    np.testing.assert_allclose(second_moments(np.array(link)), expected, atol=1e-12)
    assert np.linalg.eigvalsh(pseudo_inertia(np.array(link)))[0] > 0


def test_without_data_the_prior_stands():
    prior = link_prior(LINKS, 1.0)
    found = consistent_fit(np.zeros((1, 20)), np.zeros(1), prior, 2, ())
    np.testing.assert_allclose(found, LINKS, atol=2e-4)


def test_strong_data_of_a_possible_body_win_over_the_prior():
    truth = LINKS * 1.3
    triangle = 1e4 * np.eye(20)
    found = consistent_fit(triangle, triangle @ truth, link_prior(LINKS, 1.0), 2, ())
    np.testing.assert_allclose(found, truth, rtol=1e-4, atol=1e-5)


def test_impossible_body_in_the_data_becomes_the_nearest_possible_one():
    truth = LINKS.copy()
    truth[0] = -2.0  # a negative mass, as plain least squares likes to give
    truth[16] = -0.4
    triangle = 1e3 * np.eye(20)
    found = consistent_fit(triangle, triangle @ truth, link_prior(LINKS, 1.0), 2, ())
    assert found[0] > 0.0
    assert lowest(found) > 0.0


def test_friction_never_becomes_negative():
    prior = Prior(np.append(LINKS, 0.0), np.append(link_prior(LINKS, 1.0).std, np.inf))
    triangle = np.eye(21)
    target = np.append(LINKS, -3.0)
    assert consistent_fit(triangle, target, prior, 2, [20])[20] == pytest.approx(0.0, abs=1e-6)
    assert consistent_fit(triangle, target, prior, 2, ())[20] == pytest.approx(-3.0, rel=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.floats(-3, 3), st.integers(1, 40))
def test_every_fit_is_a_body_that_can_exist(seed, power, n_rows):
    random = np.random.default_rng(seed)
    triangle = 10.0**power * random.normal(size=(n_rows, 20))
    target = 10.0**power * random.normal(size=n_rows) * 5.0
    found = consistent_fit(triangle, target, link_prior(LINKS, 1.0), 2, ())
    assert lowest(found) > -1e-9
    assert found[0] > 0
    assert found[10] > 0


def test_prior_of_an_empty_link_is_finite():
    prior = link_prior(np.zeros(10), 1.0)
    assert np.isfinite(prior.std).all()
    assert (prior.std > 0).all()
