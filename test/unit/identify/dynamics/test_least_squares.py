"""Fits of rows whose truth is known, and how often their intervals hold it."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

import robots
from excited import recorded
from robot_energy.model import validate
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy_identify.data.observations import Filters, observe
from robot_energy_identify.dynamics.dynamics import fit_rows
from robot_energy_identify.dynamics.torque_model import TorqueModel, standard_columns
from robot_energy_identify.stats.regression import Method, factor


def smooth_two_link(smooth_velocity=0.05):
    """The two-link arm with the smooth sign that the columns have."""
    data = robots.two_link_data()
    for joint in data["joints"]:
        smooth = smooth_velocity * abs(joint["gear_ratio"]["value"])
        joint["friction"]["smooth_velocity"] = robots.figure(smooth)
    return validate(data, "smooth two-link")


MODEL = smooth_two_link()
ROBOT = Robot.from_model(MODEL)
TRANSMISSION = Drivetrain.from_model(MODEL).transmission
COLUMNS = standard_columns(0.05)
TORQUE_MODEL = TorqueModel.from_model(MODEL, COLUMNS)
BASE = TORQUE_MODEL.structure()


def rows(**options):
    observed = observe([recorded(MODEL, **options)], TORQUE_MODEL, Filters())
    return observed.with_columns(BASE.independent)


def truth():
    """Base parameters of the model file, worked out without any fit."""
    friction = FrictionModel.from_model(MODEL)
    ratio = np.abs(np.diagonal(TRANSMISSION))
    viscous = friction.viscous(np.full(2, 25.0)) * ratio**2
    rotor = np.array([joint.rotor_inertia.value for joint in MODEL.joints]) * ratio**2
    standard = [ROBOT.link_parameters, viscous, friction.coulomb * ratio, rotor]
    given = np.concatenate(standard)  # no offsets, nothing of the elbow's own next to its motor
    return BASE.matrix @ np.append(given, np.zeros(len(BASE.names) - len(given)))


TRUTH = truth()


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    with threadpool_limits(1):
        yield


@pytest.mark.parametrize("method", get_args(Method))
def test_fit_of_exact_rows_is_exact(method):
    observed = rows()
    exact = replace(observed, joint_torque=observed.regressor @ TRUTH)
    np.testing.assert_allclose(fit_rows(exact, method).values, TRUTH, rtol=1e-7, atol=1e-9)


def test_parameters_of_the_robot_come_back():
    """Without noise, what is left is the error of filters and differences."""
    found = fit_rows(rows(), "ols").values
    np.testing.assert_allclose(found, TRUTH, rtol=0.01, atol=2e-3 * np.abs(TRUTH).max())
    by_name = dict(zip(BASE.labels, found, strict=True))
    inertia = robots.M2 * robots.C2**2 + robots.I2
    assert by_name["Iyy elbow"] == pytest.approx(inertia, rel=0.01)
    assert by_name["rotor_inertia elbow"] == pytest.approx(2e-5 * 50.0**2, rel=0.01)


def test_triangle_keeps_the_sum_of_squares_but_for_a_constant():
    observed = rows(noise=0.05)
    weight = observed.used * np.array([0.3, 2.0])
    triangle, target = factor(observed.regressor, observed.joint_torque, weight)

    def both(values):
        error = weight * (observed.joint_torque - observed.regressor @ values)
        return (error**2).sum(), ((triangle @ values - target) ** 2).sum()

    one, other = both(TRUTH), both(TRUTH * 1.1)
    assert one[0] - other[0] == pytest.approx(one[1] - other[1], rel=1e-9)
    both_sides = np.dstack([observed.regressor, observed.joint_torque]) * weight[..., None]
    plain = both_sides[weight != 0.0]
    np.testing.assert_allclose(
        np.linalg.lstsq(plain[:, :-1], plain[:, -1], rcond=None)[0],
        np.linalg.lstsq(triangle, target, rcond=None)[0],
    )


def test_weighting_by_joint_beats_equal_weights_where_one_joint_is_noisy():
    errors = {"ols": [], "wls": []}
    for seed in range(8):
        observed = rows(seed=seed)
        random = np.random.default_rng(seed)
        noise = random.normal(size=observed.joint_torque.shape) * np.array([5.0, 0.02])
        noisy = replace(observed, joint_torque=observed.joint_torque + noise)
        for method, found in errors.items():
            found.append(fit_rows(noisy, method).values[BASE.labels.index("mx elbow")])
    spread = {method: np.std(found) for method, found in errors.items()}
    assert spread["wls"] < 0.2 * spread["ols"]


def test_robust_fit_ignores_bursts():
    observed = rows(noise=0.02)
    torque = observed.joint_torque.copy()
    torque[200:240] += 30.0
    burst = replace(observed, joint_torque=torque)
    scale = np.maximum(fit_rows(observed, "wls").std, 1e-9)
    plain = np.abs(fit_rows(burst, "wls").values - TRUTH) / scale
    robust = np.abs(fit_rows(burst, "irls").values - TRUTH) / scale
    assert robust.max() < 0.3 * plain.max()


def test_rows_alike_count_for_less():
    """Noise that lasts is worth fewer rows, and its deviations are larger."""
    white, lasting = fit_rows(rows(noise=0.05)), fit_rows(rows(noise=0.05, memory=0.995))
    n_rows = rows().used.sum(axis=0)
    assert (white.independent < 0.6 * n_rows).all()  # the filter makes rows alike
    assert (lasting.independent < white.independent).all()


@pytest.mark.parametrize("memory", [0.0, 0.98])
def test_intervals_hold_the_truth_as_often_as_they_say(memory):
    """95 % intervals, 40 recordings; 40 x 13 dependent trials scatter by about 2 %."""
    inside = []
    for seed in range(40):
        result = fit_rows(rows(noise=0.1, memory=memory, seed=seed, rate=250.0, duration=15.0))
        inside.append(np.abs(result.values - TRUTH) <= result.interval())
    share = np.mean(inside)
    assert 0.92 <= share <= 0.98, share
    assert np.mean(inside, axis=0).min() >= 0.80  # no parameter is far off


def test_rows_that_were_made_are_kept_once_and_used_again():
    channels = [recorded(MODEL, duration) for duration in (5.0, 6.0, 7.0)]
    seen = {}
    whole = observe(channels, TORQUE_MODEL, Filters(), seen)
    assert all(np.shares_memory(whole.regressor, regressor) for _, regressor, _ in seen.values())
    for part in (channels, channels[:2], channels[1:2]):
        again, fresh = (observe(part, TORQUE_MODEL, Filters(), made) for made in (seen, None))
        for name in ("regressor", "joint_torque", "used", "compared", "segment"):
            np.testing.assert_array_equal(getattr(again, name), getattr(fresh, name))
