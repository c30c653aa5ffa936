"""Fourier series that begin and end at rest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy.foundation.errors import MotionError
from robot_energy_plan.motion import FourierBasis, FourierMotion


@given(
    harmonics=st.integers(2, 12),
    period=st.floats(0.5, 60.0),
    seed=st.integers(0, 1000),
)
def test_every_series_rests_at_both_ends_and_comes_back(harmonics, period, seed):
    basis = FourierBasis(harmonics, period)
    motion = FourierMotion(basis, np.random.default_rng(seed).normal(size=(basis.size, 3)))
    ends = motion.sample(np.array([0.0, period * (1 - 1e-15), period, 2 * period]))
    scale = np.abs(motion.sample(np.linspace(0, period, 200)).joint_acceleration).max()
    assert np.abs(ends.joint_velocity).max() < 1e-12 * max(1.0, scale * period)
    assert np.abs(ends.joint_acceleration).max() < 1e-11 * max(1.0, scale)
    np.testing.assert_allclose(
        ends.joint_position - ends.joint_position[0], 0.0, atol=1e-11 * max(1.0, period)
    )
    before = motion.sample(np.array([-1.0]))
    np.testing.assert_allclose(before.joint_position[0], ends.joint_position[0], atol=1e-12)


def test_derivatives_are_those_of_the_position():
    basis = FourierBasis(5, 7.0)
    motion = FourierMotion(basis, np.random.default_rng(1).normal(size=(basis.size, 2)))
    time, step = np.linspace(0.5, 6.5, 50), 1e-5
    before, here, after = (motion.sample(time + shift) for shift in (-step, 0.0, step))
    np.testing.assert_allclose(
        (after.joint_position - before.joint_position) / (2 * step), here.joint_velocity, atol=1e-8
    )
    np.testing.assert_allclose(
        (after.joint_velocity - before.joint_velocity) / (2 * step),
        here.joint_acceleration,
        atol=1e-7,
    )


def test_only_the_chosen_harmonics_are_in_it():
    """Read from the spectrum of one period."""
    basis = FourierBasis(4, 10.0)
    motion = FourierMotion(basis, np.random.default_rng(2).normal(size=(basis.size, 1)))
    signal = motion.sample(np.arange(1000) * 0.01).joint_velocity[:, 0]
    size = np.abs(np.fft.rfft(signal)) / len(signal)
    assert size[1:5].min() > 1e-3
    assert size[5:].max() < 1e-12


@pytest.mark.parametrize(
    ("harmonics", "period"), [(1, 10.0), (51, 10.0), (5, 0.0), (5, np.inf), (5, np.nan)]
)
def test_senseless_series_are_refused(harmonics, period):
    with pytest.raises(MotionError):
        FourierBasis(harmonics, period)
