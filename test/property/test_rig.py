"""Laws of motions and of the rig, on random input."""

from dataclasses import fields
from typing import get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moves import PointToPoint
from robot_energy_plan.motion import MotionLimits, random_program
from robot_energy_rig import RigConfig, RigOutput, VirtualRig, load_profile

PROFILE = load_profile("kr16")
LIMITS = PROFILE.motion_limits(PROFILE.mechanics()[0])
PROGRAM = random_program(LIMITS, 0)
SIZE = 700
SWITCHES = [name for name, kind in get_type_hints(RigConfig).items() if kind is bool]


def build(seed=0, **changes):
    config = RigConfig(thermal_speedup=changes.pop("thermal_speedup", 12.0))
    return VirtualRig(PROFILE, PROGRAM, config, seed, **changes)


def same(one, other):
    for part in fields(RigOutput):
        left, right = getattr(one, part.name), getattr(other, part.name)
        for f in fields(left):
            a, b = getattr(left, f.name), getattr(right, f.name)
            if isinstance(a, np.ndarray):
                assert a.tobytes() == b.tobytes(), f"{part.name}.{f.name} differs"


WHOLE = build().step(SIZE)


@settings(max_examples=12, deadline=None)
@given(st.lists(st.integers(1, 400), min_size=1, max_size=40))
def test_any_cut_gives_the_same_bytes(cuts):
    rig, parts, left = build(), [], SIZE
    while left:
        for cut in cuts:
            if left:
                parts.append(rig.step(min(cut, left)))
                left -= len(parts[-1].joints)
    same(RigOutput.concatenate(parts), WHOLE)


@settings(max_examples=12, deadline=None)
@given(st.lists(st.integers(0, 400_000_000), min_size=0, max_size=30))
def test_any_clock_gives_the_same_bytes(ticks):
    rig, parts, now = build(), [], build().stamp_ns
    for tick in ticks:
        now += tick
        if rig.samples < SIZE:
            end = min(now, rig.stamp_ns + (SIZE - rig.samples - 1) * 4_000_000)
            output = rig.step_until(end)
            if output is not None:
                parts.append(output)
    if rig.samples < SIZE:
        parts.append(rig.step(SIZE - rig.samples))
    same(RigOutput.concatenate(parts), WHOLE)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**63))
def test_seed_decides_the_noise_and_nothing_else(seed):
    one, again = build(seed).step(300), build(seed).step(300)
    same(one, again)
    other = build(seed + 1).step(300)
    assert (one.joints.joint_velocity != other.joints.joint_velocity).any()
    np.testing.assert_array_equal(one.truth.grid_power, other.truth.grid_power)


@settings(max_examples=8, deadline=None)
@given(st.sets(st.sampled_from(SWITCHES)), st.floats(0.0, 90.0))
def test_books_balance_whatever_is_switched_off(off, degc):
    rig = VirtualRig(PROFILE, PROGRAM, RigConfig().without(*off), 0, degc)
    truth = rig.step(500).truth
    joints = (
        truth.rigid_power
        + truth.friction_power
        + truth.iron_loss
        + truth.copper_loss
        + truth.inverter_loss
    ).sum(axis=1)
    total = joints + (
        truth.loss_dc
        + truth.loss_grid
        + truth.rectifier_loss
        + truth.brake_power
        + truth.capacitor_power
    )
    np.testing.assert_allclose(truth.grid_power, total, rtol=1e-12, atol=1e-8)
    assert (truth.grid_power >= PROFILE.supply.loss_grid - 1e-9).all()


@st.composite
def motions(draw):
    size = draw(st.integers(1, 7))
    angle = st.integers(-3_000_000, 3_000_000).map(lambda n: n * 1e-6)
    vector = st.lists(angle, min_size=size, max_size=size).map(np.array)
    limit = st.lists(st.floats(0.05, 20.0), min_size=size, max_size=size).map(np.array)
    limits = MotionLimits(
        np.full(size, -3.0),
        np.full(size, 3.0),
        draw(limit),
        draw(limit),
        draw(st.sampled_from([0.0, 0.01, 0.2])),
    )
    return draw(vector), draw(vector), limits


@settings(max_examples=60, deadline=None)
@given(motions())
def test_motions_keep_their_limits_and_end_at_rest(case):
    start, goal, limits = case
    motion = PointToPoint(start, goal, limits)
    path = motion.sample(np.linspace(0.0, motion.duration, 301))
    slack = 1 + 1e-6
    assert (np.abs(path.joint_velocity) <= limits.velocity * slack).all()
    assert (np.abs(path.joint_acceleration) <= limits.acceleration * slack + 1e-9).all()
    low, high = np.minimum(start, goal), np.maximum(start, goal)
    assert (path.joint_position >= low - 1e-12).all()
    assert (path.joint_position <= high + 1e-12).all()
    ends = motion.sample(np.array([0.0, motion.duration]))
    np.testing.assert_array_equal(ends.joint_position, [start, goal])
    assert not ends.joint_velocity.any()
    middle = 0.5 * motion.duration
    near = motion.sample(middle + np.array([-1e-6, 1e-6]) * motion.duration)
    if motion.duration > 0:
        speed = np.diff(near.joint_position, axis=0)[0] / (2e-6 * motion.duration)
        expected = motion.sample(np.array([middle])).joint_velocity[0]
        np.testing.assert_allclose(speed, expected, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("speedup", [0.5, 1.0, 300.0])
def test_long_runs_stay_finite_and_in_range(speedup):
    truth = build(thermal_speedup=speedup).step(20_000).truth
    assert np.isfinite(truth.grid_power).all()
    assert (truth.gear_temperature_degc >= 20.0 - 1e-9).all()
    assert (truth.motor_temperature_degc < 120.0).all()
