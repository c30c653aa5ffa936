import numpy as np
import pytest

import robots
from robot_energy.physics.derivative import Derivative
from robot_energy.timeline.blocks import JointBlock, Quality


def differentiate(block, **settings):
    stage = Derivative(**settings)
    return JointBlock.concatenate([*stage.step(block), *stage.flush()])


def jittered(size, period=0.002, seed=0):
    rng = np.random.default_rng(seed)
    return 100.0 + np.cumsum(rng.uniform(0.7 * period, 1.3 * period, size))


def cubic(stamp):
    t = stamp - stamp[0]
    position = np.stack([1 + 2 * t + 3 * t**2, 0.5 * t], axis=1)
    velocity = np.stack([2 + 6 * t, np.full_like(t, 0.5)], axis=1)
    return position, velocity, np.stack([np.full_like(t, 6.0), np.zeros_like(t)], axis=1)


def test_slope_of_a_measured_parabola_is_exact_on_jittered_stamps():
    # velocity quadratic in time: the fit has no truncation error
    stamp = np.rint(jittered(200) * 1e9) * 1e-9
    t = (stamp - stamp[0])[:, None]
    velocity = 1 + 2 * t + 3 * t**2
    out = differentiate(robots.joint_block(stamp, velocity * 0, velocity))
    np.testing.assert_allclose(out.joint_acceleration, 2 + 6 * t, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(out.joint_velocity, velocity)


def test_missing_velocity_comes_from_positions_and_is_flagged():
    stamp = jittered(100)
    position, velocity, acceleration = cubic(np.rint(stamp * 1e9) * 1e-9)
    out = differentiate(robots.joint_block(stamp, position, np.full_like(velocity, np.nan)))
    np.testing.assert_allclose(out.joint_velocity, velocity, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(out.joint_acceleration, acceleration, atol=1e-3)
    assert (out.quality & Quality.VELOCITY_DERIVED).all()


@pytest.mark.parametrize("first", [np.nan, 0.0])
def test_positions_alone_have_the_longer_window(first):
    """At 250 Hz 13 samples in 50 ms; the noise is that of the closed form.

    Variance of the second derivative of a quadratic through N equal steps h: 720 sigma^2 over
    h^4 N (N^2 - 1) (N^2 - 4). One velocity at the begin does not shorten the window.
    """
    count = 13
    position = np.random.default_rng(3).normal(scale=1e-5, size=(40_000, 1))
    velocity = np.full_like(position, np.nan)
    velocity[0] = first
    out = differentiate(robots.joint_block(np.arange(40_000) * 0.004, position, velocity))
    expected = 1e-5 / 0.004**2 * np.sqrt(720 / (count * (count**2 - 1) * (count**2 - 4)))
    assert out.joint_acceleration[20:-20].std() == pytest.approx(expected, rel=0.02)


def test_two_velocities_around_a_sample_are_too_few_for_a_slope():
    """They are wrong by 100 rad/s; the slope in the middle is that of the positions."""
    stamp = np.rint((100.0 + 0.002 * np.arange(101)) * 1e9) * 1e-9
    position, velocity, acceleration = cubic(stamp)
    known = np.full_like(velocity, np.nan)
    known[[49, 51]] = velocity[[49, 51]] + [[100.0], [-100.0]]
    out = differentiate(robots.joint_block(stamp, position, known))
    np.testing.assert_allclose(out.joint_acceleration[50], acceleration[50], atol=1e-3)


@pytest.mark.parametrize("every", [2, 4, 20])
def test_a_missing_velocity_leaves_the_slope_of_its_neighbours(every):
    """Positions that say nothing: neither velocity nor acceleration may come from them."""
    stamp = np.rint(jittered(400) * 1e9) * 1e-9
    t = (stamp - stamp[0])[:, None]
    velocity = 1 + 2 * t + 3 * t**2
    measured = velocity.copy()
    measured[every - 1 :: every] = np.nan
    noise = np.random.default_rng(5).normal(size=velocity.shape)
    out = differentiate(robots.joint_block(stamp, noise, measured))
    inside = slice(10, -10)
    np.testing.assert_allclose(out.joint_velocity[inside], velocity[inside], rtol=1e-9)
    np.testing.assert_allclose(out.joint_acceleration[inside], (2 + 6 * t)[inside], rtol=1e-6)
    derived = (out.quality & Quality.VELOCITY_DERIVED) > 0
    np.testing.assert_array_equal(derived, np.isnan(measured[:, 0]))


def test_a_stretch_without_velocities_has_the_window_of_positions():
    stamp = np.arange(1000) * 0.002
    position, velocity = np.sin(3 * stamp)[:, None], 3 * np.cos(3 * stamp)[:, None]
    measured = velocity.copy()
    measured[400:600] = np.nan
    noisy = position + np.random.default_rng(6).normal(scale=1e-6, size=position.shape)
    out = differentiate(robots.joint_block(stamp, noisy, measured))
    alone = differentiate(robots.joint_block(stamp, noisy, np.full_like(velocity, np.nan)))
    inner = slice(405, 595)  # 10 ms from the velocities on either side
    np.testing.assert_array_equal(out.joint_acceleration[inner], alone.joint_acceleration[inner])
    np.testing.assert_array_equal(out.joint_velocity[inner], alone.joint_velocity[inner])
    np.testing.assert_array_equal(out.joint_velocity[600:], velocity[600:])


def test_missing_velocities_give_the_same_bits_in_blocks_of_any_size():
    random = np.random.default_rng(7)
    stamp = jittered(600)
    position, velocity, _ = cubic(stamp)
    position += random.normal(scale=1e-6, size=position.shape)
    share = np.repeat([0.0, 0.1, 0.5, 1.0, 0.02, 0.9], 100)[:, None]
    velocity[random.random(velocity.shape) < share] = np.nan
    block = robots.joint_block(stamp, position, velocity)
    whole = differentiate(block)
    for size in (1, 2, 7, 40, 150):
        stage = Derivative()
        parts = [block[slice(row, row + size)] for row in range(0, len(stamp), size)]
        cut = JointBlock.concatenate(
            [*(done for part in parts for done in stage.step(part)), *stage.flush()]
        )
        np.testing.assert_array_equal(cut.joint_acceleration, whole.joint_acceleration)
        np.testing.assert_array_equal(cut.joint_velocity, whole.joint_velocity)
        np.testing.assert_array_equal(cut.quality, whole.quality)


def test_every_stretch_has_its_own_window():
    stamp = np.concatenate([np.arange(100) * 0.004, 1.0 + np.arange(100) * 0.004])
    position = np.random.default_rng(4).normal(scale=1e-5, size=(200, 1))
    velocity = np.where(np.arange(200)[:, None] < 100, np.nan, 0.0)
    block = robots.joint_block(stamp, position, velocity)
    block.segment[100:] = 1
    whole = differentiate(block)
    assert (whole.joint_acceleration[100:] == 0.0).all()
    for size in (1, 7, 150):
        stage = Derivative()
        parts = [block[slice(row, row + size)] for row in range(0, 200, size)]
        cut = JointBlock.concatenate(
            [*(done for part in parts for done in stage.step(part)), *stage.flush()]
        )
        np.testing.assert_array_equal(cut.joint_acceleration, whole.joint_acceleration)


def test_estimate_has_no_phase_lag():
    # a lag of half a period would show as an error of omega^2 * dt / 2 = 2 % here
    stamp = np.arange(1000) * 0.002
    omega = 10.0
    velocity = np.sin(omega * stamp)[:, None]
    out = differentiate(robots.joint_block(stamp, velocity * 0, velocity))
    exact = omega * np.cos(omega * stamp)[:, None]
    assert np.abs(out.joint_acceleration - exact)[10:-10].max() < 2e-3 * omega


def test_samples_leave_when_the_stamps_have_passed_the_lag():
    stage = Derivative(window=0.02, lag=0.01)
    stamp = np.arange(30) * 0.002
    out = stage.step(robots.joint_block(stamp, stamp[:, None], stamp[:, None]))
    assert out[0].stamp_ns[-1] == round((stamp[-1] - 0.01) * 1e9)


def test_zero_lag_is_causal():
    stage = Derivative(window=0.02, lag=0.0)
    stamp = np.arange(30) * 0.002
    (out,) = stage.step(robots.joint_block(stamp, stamp[:, None], 3 * stamp[:, None]))
    assert len(out) == 30
    np.testing.assert_allclose(out.joint_acceleration[2:], 3.0, rtol=1e-9)


def test_slow_driver_uses_its_neighbours():
    stamp = np.arange(20) * 0.04  # 25 Hz: a 20 ms window holds one sample
    velocity = (5 * stamp)[:, None]
    out = differentiate(robots.joint_block(stamp, velocity, velocity))
    np.testing.assert_allclose(out.joint_acceleration, 5.0, rtol=1e-9)


def test_nothing_is_fitted_across_a_gap():
    stamp = np.concatenate([np.arange(20) * 0.002, 5 + np.arange(20) * 0.002])
    velocity = np.where(stamp < 1, 1.0, 100.0)[:, None]
    block = robots.joint_block(stamp, velocity, velocity)
    block.segment[20:] = 1
    out = differentiate(block)
    np.testing.assert_allclose(out.joint_acceleration, 0.0, atol=1e-6)
    flagged = (out.quality & Quality.ACCELERATION_INCOMPLETE) > 0
    np.testing.assert_array_equal(np.flatnonzero(flagged), [0, 1, 18, 19, 20, 21, 38, 39])


def test_single_sample_gives_nan_not_zero():
    out = differentiate(robots.joint_block(np.array([1.0]), np.zeros((1, 1)), np.ones((1, 1))))
    assert np.isnan(out.joint_acceleration).all()


@pytest.mark.parametrize("settings", [{"lag": 0.03}, {"lag": -1.0}])
def test_impossible_settings_are_refused(settings):
    with pytest.raises(ValueError, match="expected"):
        Derivative(window=0.02, **settings)


def test_effort_describes_the_same_instant_as_velocity():
    stamp = np.concatenate([jittered(40), 200 + jittered(30, seed=1)])
    position = np.zeros((70, 1))
    block = robots.joint_block(stamp, position, position + 1, effort=stamp[:, None].copy())
    block.segment[40:] = 1
    stage = Derivative(window=0.02)
    parts = [part for row in range(70) for part in stage.step(block[slice(row, row + 1)])]
    out = JointBlock.concatenate([*parts, *stage.flush()])
    np.testing.assert_array_equal(np.rint(out.joint_effort[:, 0] * 1e9), out.stamp_ns)
    assert len(out) == 70


def test_short_blocks_give_the_bits_of_a_long_one():
    """Sums over the window are made in one call for short blocks, row by row for long ones."""
    stamp = jittered(3000, period=0.001)
    random = np.random.default_rng(1)
    for joints in (1, 6):
        velocity = random.normal(size=(len(stamp), joints))
        block = robots.joint_block(stamp, velocity * 0, velocity)
        whole = differentiate(block)
        for size in (1, 7, 40, 300):
            stage = Derivative()
            parts = [block[slice(row, row + size)] for row in range(0, len(block), size)]
            found = [done for part in parts for done in stage.step(part)]
            cut = JointBlock.concatenate([*found, *stage.flush()])
            np.testing.assert_array_equal(cut.joint_acceleration, whole.joint_acceleration)


def test_short_blocks_may_be_views_of_a_long_one_with_contiguous_joints():
    """Blocks document this order; pieces of such a block are not contiguous."""
    stamp = jittered(60)
    position, velocity, _ = cubic(stamp)
    plain = robots.joint_block(stamp, position, velocity)
    joints = robots.joint_block(stamp, *map(np.asfortranarray, (position, velocity)))
    stage = Derivative()
    parts = [one for at in range(0, 60, 2) for one in stage.step(joints[slice(at, at + 2)])]
    found = JointBlock.concatenate([*parts, *stage.flush()])
    expected = differentiate(plain)
    np.testing.assert_array_equal(found.joint_acceleration, expected.joint_acceleration)


@pytest.mark.parametrize("lowest", [-np.pi, 0.0])
def test_a_joint_that_turns_without_end_has_the_slope_of_its_turns(lowest):
    """However the driver wraps its positions, and to the bit however the samples are cut."""
    stamp = jittered(2000, period=0.01)
    turned = 3.0 * (stamp - stamp[0]) + np.sin(stamp)
    position = np.stack([(turned - lowest) % (2 * np.pi) + lowest, turned], axis=1)
    block = robots.joint_block(stamp, position, np.full_like(position, np.nan))
    wraps = np.array([True, False])
    whole = differentiate(block, wraps=wraps)
    for found in (whole.joint_velocity, whole.joint_acceleration):
        np.testing.assert_allclose(found[:, 0], found[:, 1], atol=1e-6)
    np.testing.assert_array_equal(whole.joint_position, position)
    for size in (1, 7, 300):
        stage = Derivative(wraps=wraps)
        parts = [block[slice(row, row + size)] for row in range(0, len(block), size)]
        done = [one for part in parts for one in stage.step(part)]
        cut = JointBlock.concatenate([*done, *stage.flush()])
        np.testing.assert_array_equal(cut.joint_velocity, whole.joint_velocity)
        np.testing.assert_array_equal(cut.joint_acceleration, whole.joint_acceleration)
