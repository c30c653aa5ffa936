"""Robust regression with blocks: exact on clean data, honest about what it knows."""

import numpy as np
import pytest
from scipy.signal import lfilter

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy_identify.stats.regression import factor, regress

TRUTH = np.array([1.5, -0.4])
NAMES = ("gain", "slope")


def line(seed, n_samples=4000, correlated=0.0):
    """Samples of a line with AR(1) noise, in blocks of 100."""
    random = np.random.default_rng(seed)
    columns = np.stack([np.ones(n_samples), random.normal(size=n_samples)], axis=1)
    columns[:, 1] = lfilter([1.0], [1.0, -correlated], columns[:, 1])
    noise = lfilter([1.0], [1.0, -correlated], random.normal(scale=0.3, size=n_samples))
    return columns, columns @ TRUTH + noise, np.arange(n_samples) // 100


def test_clean_data_give_the_exact_parameters():
    columns, _, block = line(0)
    fit = regress(columns, columns @ TRUTH, block, NAMES)
    np.testing.assert_allclose(fit.values, TRUTH, rtol=1e-12)


def test_white_noise_gives_the_textbook_deviation():
    """Standard deviation of a mean of N samples: sigma / sqrt(N)."""
    columns, target, block = line(1, n_samples=40_000)
    fit = regress(columns, target, block, NAMES, method="ols")
    np.testing.assert_allclose(fit.std, 0.3 / np.sqrt(40_000), rtol=0.15)


def test_a_fit_without_deviations_has_the_same_values():
    columns, target, block = line(4)
    target[::20] += 50.0
    whole, bare = (
        regress(columns, target, block, NAMES, deviations=want) for want in (True, False)
    )
    np.testing.assert_allclose(bare.values, whole.values, rtol=0.0, atol=0.05 * whole.std.min())
    assert np.isnan(bare.std).all()


def test_rows_are_compressed_in_parts_to_the_same_sums_of_squares():
    random = np.random.default_rng(0)
    columns, target = random.normal(size=(9000, 2, 3)), random.normal(size=(9000, 2))
    weight = np.where(random.random((9000, 2)) < 0.3, 0.0, random.random((9000, 2)))
    triangle, right = factor(columns, target, weight)
    squares = np.einsum("kjp,kj,kjq->pq", columns, weight**2, columns)
    np.testing.assert_allclose(triangle.T @ triangle, squares, rtol=1e-10, atol=1e-9)
    products = np.einsum("kjp,kj,kj->p", columns, weight**2, target)
    np.testing.assert_allclose(triangle.T @ right, products, rtol=1e-10, atol=1e-9)


def test_outliers_do_not_pull_the_fit():
    columns, target, block = line(2)
    spoilt = target.copy()
    spoilt[::20] += 50.0
    robust = regress(columns, spoilt, block, NAMES)
    plain = regress(columns, spoilt, block, NAMES, method="ols")
    np.testing.assert_allclose(robust.values, TRUTH, atol=0.05)
    assert abs(plain.values[0] - TRUTH[0]) > 2.0


def test_intervals_cover_the_truth_as_often_as_they_say_though_noise_is_correlated():
    """95 % intervals over 300 recordings with strongly correlated noise."""
    inside = np.zeros(2)
    for seed in range(300):
        columns, target, block = line(seed, correlated=0.9)
        fit = regress(columns, target, block, NAMES)
        inside += np.abs(fit.values - TRUTH) <= fit.interval()
    assert 0.90 <= (inside / 300).min()
    assert (inside / 300).max() <= 0.985


@pytest.mark.parametrize("third", [0.0, 1.0, "twice the second"])
def test_columns_that_cannot_be_said_apart_are_refused_by_name(third):
    columns, target, block = line(3)
    extra = 2.0 * columns[:, 1] if isinstance(third, str) else np.full(len(columns), third)
    with pytest.raises(NotIdentifiableError, match="third"):
        regress(np.column_stack([columns, extra]), target, block, (*NAMES, "third"))


def test_fewer_samples_than_parameters_are_refused():
    with pytest.raises(NotIdentifiableError, match="gain, slope"):
        regress(np.ones((1, 2)), np.ones(1), np.zeros(1, dtype=np.int64), NAMES)
