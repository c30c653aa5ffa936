"""Rest of seven axes, found by the noise of their velocities."""

import numpy as np
import pytest
from scipy.signal import lfilter

from robot_energy_identify.data.rest import rest_of, still

RATE, AXES, STANDSTILL = 250, 7, 2e-3
TIME = np.arange(0, 24 * RATE) / RATE
STAMP = np.round(TIME * 1e9).astype(np.int64)
MOVES = (TIME >= 4.0) & (TIME < 20.0)


def motion(slow=0.5):
    """Four seconds of rest at both ends, sines of all axes between."""
    phase = 2 * np.pi * (TIME - 4.0)[:, None] * np.linspace(0.25, 0.5, AXES)
    return np.where(MOVES[:, None], slow * np.sin(phase), 0.0)


def noisy(velocity, std, colour):
    """White noise, or that of an encoder behind a first-order low-pass."""
    noise = np.random.default_rng(1).normal(size=velocity.shape)
    noise = lfilter([1.0 - colour], [1.0, -colour], noise, axis=0)
    return velocity + std * noise / noise.std()


def resting(velocity):
    return still(STAMP, velocity, np.full(AXES, STANDSTILL)).all(axis=1)


@pytest.mark.parametrize("colour", [0.0, 0.7])
@pytest.mark.parametrize("std", [0.0, 5e-4, 2e-3, 8e-3])
def test_rest_is_found_whatever_the_noise_and_motion_is_not(std, colour):
    velocity = noisy(motion(), std, colour)
    found = resting(velocity)
    inside = ~MOVES & (np.abs(TIME - 4.0) > 0.1) & (np.abs(TIME - 20.0) > 0.1)
    assert found[inside].mean() > 0.9
    assert found[MOVES].mean() < 0.01
    if std >= 2e-3:  # what a fixed threshold finds
        assert (np.abs(velocity) < STANDSTILL).all(axis=1)[inside].mean() < 0.15


def test_a_slow_steady_motion_is_no_rest():
    velocity = noisy(np.where(MOVES[:, None], 8e-3, 0.0) * np.ones(AXES), 2e-3, 0.0)
    assert resting(velocity)[MOVES].mean() < 0.01


def test_without_rest_there_is_none():
    phase = 2 * np.pi * TIME[:, None] * np.linspace(0.25, 0.5, AXES) + np.arange(AXES)
    assert resting(noisy(0.5 * np.sin(phase), 2e-3, 0.0)).mean() < 1e-3


def test_how_long_and_how_often_is_said():
    rest = rest_of(STAMP, ~MOVES)
    assert (rest.count, rest.longest) == (2, pytest.approx(4.0, abs=0.01))
    assert str(rest) == "the joints rest 8.0 s in all, 2 times, 4.0 s at the longest"
    assert str(rest_of(STAMP, np.zeros(len(STAMP), dtype=bool))) == (
        "no joint states at rest were found"
    )
