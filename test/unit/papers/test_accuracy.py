"""Accuracy of an energy by several definitions, on powers that can be added up by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy_papers.paper_b import accuracies, energy

STEP = np.full(4, 0.5)  # s
MEASURED = np.array([[10.0, 0.0], [10.0, 4.0], [-5.0, 4.0], [-5.0, 0.0]])
PREDICTED = np.array([[8.0, 0.0], [10.0, 5.0], [-5.0, 5.0], [-3.0, 0.0]])


def test_every_definition_by_hand():
    found = accuracies(PREDICTED, MEASURED, STEP)
    # joint 1: net 5 J both; magnitude 15 and 13 J; positive 10 and 9 J; wrong by 2 J
    # joint 2: 4 J and 5 J by all three; wrong by 1 J
    np.testing.assert_allclose(found["net"].joint, [1.0, 0.75])
    assert found["net"].total == pytest.approx(1 - 1 / 9)
    assert found["net"].summed == pytest.approx(1 - 1 / 9)
    np.testing.assert_allclose(found["absolute"].joint, [1 - 2 / 15, 0.75])
    assert found["absolute"].total == pytest.approx(1 - 1 / 19)
    np.testing.assert_allclose(found["positive"].joint, [0.9, 0.75])
    assert found["positive"].total == pytest.approx(1.0)  # errors cancel between the joints
    np.testing.assert_allclose(found["pointwise"].joint, [1 - 2 / 15, 0.75])
    assert found["pointwise"].total == pytest.approx(1 - 3 / 19)
    assert found["pointwise"].mean == pytest.approx((1 - 2 / 15 + 0.75) / 2)
    # summed power: 10, 14, -1, -5 and 8, 15, 0, -3 W
    assert found["absolute"].summed == pytest.approx(1 - 2 / 15)
    assert found["positive"].summed == pytest.approx(1 - 0.5 / 12)


def test_energy_counts_braking_only_where_it_is_meant_to():
    np.testing.assert_allclose(energy(MEASURED, STEP, "net"), [5.0, 4.0])
    np.testing.assert_allclose(energy(MEASURED, STEP, "positive"), [10.0, 4.0])
    np.testing.assert_allclose(energy(MEASURED, STEP, "absolute"), [15.0, 4.0])


@given(st.integers(0, 1000), st.floats(0.5, 1.5))
def test_total_lies_between_the_joints_when_all_err_alike(seed, factor):
    """So the paper's total below each of its joints is not a sum of such energies."""
    power = np.random.default_rng(seed).uniform(0.1, 5.0, (20, 3))
    scale = 1.0 + (factor - 1.0) * np.array([0.2, 0.6, 1.0])
    found = accuracies(power * scale, power, np.full(20, 0.1))
    for value in found.values():
        assert value.joint.min() - 1e-9 <= value.total <= value.joint.max() + 1e-9
