"""Constant errors in the covariance of a fit, against figures worked out by hand."""

import numpy as np
import pytest

from robot_energy.foundation.errors import ModelFileError
from robot_energy_identify.stats.regression import fit, jackknife, regress, student
from robot_energy_identify.stats.systematic import SensorLimits, moved_by, total, with_systematic

NAMES = ("level", "slope")


@pytest.fixture
def line():
    """A line through 400 samples in 20 blocks."""
    random = np.random.default_rng(3)
    columns = np.stack([np.ones(400), random.uniform(0.0, 10.0, 400)], axis=1)
    target = columns @ [2.0, 0.5] + random.normal(0.0, 0.1, 400)
    return columns, target, np.arange(400) // 20


def test_a_limit_of_a_data_sheet_is_a_uniform_distribution():
    assert SensorLimits(meter=0.01).std.meter == pytest.approx(0.01 / 3**0.5)
    with pytest.raises(ModelFileError, match="thermometer is -1"):
        SensorLimits(thermometer=-1.0)


def test_a_gain_of_the_target_moves_every_figure_by_its_share(line):
    """A target that is 1 % too large makes level and slope 1 % too large."""
    columns, target, block = line
    plain = regress(columns, target, block, NAMES)
    whole = with_systematic(plain, columns, {"gain": (0.01 * target,)})
    np.testing.assert_allclose(whole.parts["gain"], 0.01 * np.abs(plain.values), rtol=1e-6)
    np.testing.assert_allclose(whole.std**2, plain.std**2 + whole.parts["gain"] ** 2, rtol=1e-9)
    level, slope = plain.values
    assert whole.covariance[0, 1] - plain.covariance[0, 1] == pytest.approx(1e-4 * level * slope)


def test_independent_errors_of_one_cause_add_up_in_square(line):
    columns, target, block = line
    plain = regress(columns, target, block, NAMES)
    ones = np.ones(len(target))
    twice = with_systematic(plain, columns, {"offset": (0.3 * ones, 0.4 * ones)})
    np.testing.assert_allclose(twice.parts["offset"], [0.5, 0.0], atol=1e-9)


def test_an_error_of_one_joint_leaves_the_parameters_of_the_other_alone():
    """Two targets with a parameter each, weighted differently."""
    random = np.random.default_rng(5)
    columns = np.zeros((200, 2, 2))
    columns[:, 0, 0], columns[:, 1, 1] = random.normal(size=(2, 200))
    target = columns @ [3.0, 4.0] + random.normal(0.0, [0.1, 1.0], (200, 2))
    found = fit(columns, target, NAMES, lambda *_: (np.zeros((2, 2)), np.ones(2), 100.0), "wls")
    change = np.zeros_like(target)
    change[:, 1] = 0.02 * target[:, 1]
    moved = with_systematic(found, columns, {"torque": (change,)})
    np.testing.assert_allclose(moved.parts["torque"], [0.0, 0.02 * found.values[1]], rtol=1e-9)


def test_a_move_that_is_known_is_added_as_it_is(line):
    columns, target, block = line
    plain = regress(columns, target, block, NAMES)
    moved = moved_by(plain, "thermometer", np.array([0.2, -0.1]))
    np.testing.assert_allclose(moved.parts_of(1)["thermometer"], 0.1)
    assert moved.covariance[0, 1] == pytest.approx(plain.covariance[0, 1] - 0.02)


def test_a_scatter_from_two_blocks_counts_as_students_t_says():
    """Quantile 0.975 of t: 12.706 for one degree of freedom, 2.228 for ten (tables)."""
    assert student(1.0) == pytest.approx(12.706 / 1.95996, rel=1e-4)
    assert student(10.0) == pytest.approx(2.228 / 1.95996, rel=1e-3)
    assert student(1e9) == pytest.approx(1.0)
    columns, target = np.ones((40, 1)), np.repeat([1.0, 2.0], 20)
    found = fit(columns, target, ("mean",), jackknife(np.arange(40) // 20), "ols")
    assert found.interval()[0] == pytest.approx(12.706 * 0.5, rel=1e-3)


def test_the_gain_of_a_meter_is_uniform_within_its_class():
    """1.96 deviations are the 95 % interval: of a uniform error, 0.95 of its limit."""
    limit = 3.0
    assert total({"meter": limit / 3**0.5}) * 1.96 == pytest.approx(0.95 * limit, rel=1e-3)
    assert total({"scatter": 3.0, "torque": 4.0}) == pytest.approx(5.0)
    assert total({}) == 0.0
    random = np.random.default_rng(1)
    errors = np.abs(random.normal(0.0, 1.0, 400_000) + random.uniform(-limit, limit, 400_000))
    half = 1.96 * total({"scatter": 1.0, "meter": limit / 3**0.5})
    assert half == pytest.approx(float(np.quantile(errors, 0.95)), rel=5e-3)


def test_independent_errors_of_a_fit_sum_to_its_covariance(line):
    columns, target, block = line
    found = regress(columns, target, block, NAMES)
    found = with_systematic(found, columns, {"gain": (0.01 * target, 0.1 * columns[:, 1])})
    found = moved_by(found, "gain", np.array([0.1, 0.2]))
    errors = found.errors()
    assert errors["gain"].shape == (2, 3)
    whole = sum(moves @ moves.T for moves in errors.values())
    np.testing.assert_allclose(whole, found.covariance, rtol=1e-9)
