"""Filtered channels stay where they were in time, and are cut alike."""

import numpy as np
import pytest

from robot_energy.foundation.errors import NotIdentifiableError, ShapeError
from robot_energy_identify.data.observations import Channels, inside, later, standing, stretches
from robot_energy_plan.motion.sampled_motion import low_pass, motion_from_position

RATE = 500.0
TIME = np.arange(4000) / RATE


def test_low_pass_shifts_nothing_and_halves_at_its_cutoff():
    slow, edge = np.sin(2 * np.pi * 1.0 * TIME), np.sin(2 * np.pi * 10.0 * TIME)
    filtered = low_pass(np.stack([slow, edge], axis=1), RATE, 10.0)[500:-500]
    np.testing.assert_allclose(filtered[:, 0], slow[500:-500], atol=2e-4)
    np.testing.assert_allclose(filtered[:, 1], 0.5 * edge[500:-500], atol=2e-3)


def test_central_differences_of_a_sine():
    omega = 2 * np.pi * 0.5
    motion = motion_from_position(np.sin(omega * TIME)[:, None], RATE, 50.0)
    middle = slice(500, -500)
    np.testing.assert_allclose(
        motion.joint_velocity[middle, 0], omega * np.cos(omega * TIME)[middle], atol=1e-4
    )
    np.testing.assert_allclose(
        motion.joint_acceleration[middle, 0], -(omega**2) * np.sin(omega * TIME)[middle], atol=1e-3
    )


@pytest.mark.parametrize("delay", [0.0, 0.0003, -0.0011, 0.0247])
def test_a_delay_of_any_fraction_of_a_sample_is_undone(delay):
    late = np.sin(2 * np.pi * (TIME - delay))[:, None]
    np.testing.assert_allclose(
        later(late, RATE, delay)[50:-50, 0], np.sin(2 * np.pi * TIME)[50:-50], atol=1e-6
    )


def test_both_ends_lose_the_same_rows():
    assert inside(7, 2).tolist() == [False, False, True, True, True, False, False]
    assert not inside(3, 2).any()


def test_a_reversal_is_no_standstill():
    speed = np.concatenate([np.linspace(1, -1, 101), np.zeros(60), np.ones(20)])[:, None]
    found = standing(speed, 0.05, 10)[:, 0]
    assert not found[:101].any()
    assert found[115:145].all()
    assert not found[155:].any()


def test_positions_and_torques_of_different_length_are_refused():
    with pytest.raises(ShapeError, match="one torque for every position"):
        Channels(RATE, np.zeros((10, 2)), np.zeros((9, 2)))


def test_a_recording_is_cut_at_its_gaps_and_put_on_one_grid():
    random = np.random.default_rng(0)
    stamp = (np.arange(3000) * 4_000_000 + random.integers(-200_000, 200_000, 3000)).astype(
        np.int64
    )
    segment = np.zeros(3000, dtype=np.int64)
    segment[1000:], segment[2900:] = 1, 2
    stamp[1000:] += 10_000_000_000
    at = stamp * 1e-9
    parts = stretches(stamp, segment, np.sin(at)[:, None], np.cos(at)[:, None])
    assert len(parts) == 2  # the third is shorter than a second
    assert parts[0].rate == pytest.approx(250.0, rel=0.02)
    for part, start in zip(parts, (stamp[0], stamp[1000]), strict=True):
        grid = start * 1e-9 + np.arange(len(part.joint_position)) / part.rate
        np.testing.assert_allclose(part.joint_position[:, 0], np.sin(grid), atol=1e-5)
        np.testing.assert_allclose(part.motor_torque[:, 0], np.cos(grid), atol=1e-5)


def test_a_recording_of_gaps_is_refused():
    stamp = np.arange(100, dtype=np.int64) * 4_000_000
    with pytest.raises(NotIdentifiableError, match="no stretch of 1 s"):
        stretches(stamp, np.arange(100), np.zeros((100, 1)), np.zeros((100, 1)))


@pytest.mark.parametrize(
    ("samples", "cutoff", "words"), [(10, 10.0, "10 samples"), (1000, 300.0, "below 250 Hz")]
)
def test_what_cannot_be_filtered_is_refused(samples, cutoff, words):
    with pytest.raises(NotIdentifiableError, match=words):
        low_pass(np.zeros((samples, 1)), RATE, cutoff)
