"""Laws of the whole chain, on random input."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import robots
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.model.payload import Payload, payload
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import (
    EffortMeaning,
    JointBlock,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    PowerBlock,
    TemperatureBlock,
    sum_over_joints,
)

MODEL = robots.two_link()


def motion(seed: int, size: int = 400) -> JointBlock:
    """Random smooth motion with jitter, a gap, a NaN, and a backward jump of the stamps."""
    rng = np.random.default_rng(seed)
    stamp = 50.0 + np.cumsum(rng.uniform(0.001, 0.004, size))
    frequency, phase = rng.uniform(1, 8, (2, 3)), rng.uniform(0, 6, (2, 3))
    angle = frequency * stamp[:, None, None] + phase
    block = robots.joint_block(
        stamp, np.sin(angle).sum(axis=2) / 2, (frequency * np.cos(angle)).sum(axis=2) / 2
    )
    gap, jump = sorted(rng.integers(1, size, 2))
    block.stamp_ns[gap:] += 3 * 10**9
    block.segment[gap:] += 1
    block.stamp_ns[jump:] -= 20 * 10**9
    block.segment[jump:] += 1
    block.joint_velocity[rng.integers(size)] = np.nan
    block.joint_effort[:] = rng.normal(size=(size, 2)) * 5
    block.joint_effort[rng.random((size, 2)) < rng.choice([0.0, 0.1, 1.0])] = np.nan
    block.joint_effort[: rng.integers(size // 2)] = np.nan
    lost = rng.integers(size // 2, size)
    block.joint_effort[lost : lost + 50] = np.nan
    return block


def readings(block: JointBlock, seed: int) -> tuple[TemperatureBlock, MeterBlock]:
    rng = np.random.default_rng(seed)
    first = int(block.stamp_ns[0])
    stamp = first + np.sort(rng.integers(0, 10**9, 8))
    temperature = TemperatureBlock(stamp, rng.uniform(10, 90, (8, 2)))
    stamp = first + np.unique(rng.integers(0, 2 * 10**9, 40))
    none = np.full(len(stamp), np.nan)
    meter = MeterBlock(
        stamp,
        rng.uniform(0, 500, len(stamp)),
        none,
        none,
        MeterMeaning.INSTANTANEOUS,
        MeterLocation.GRID,
    )
    return temperature, meter


def payloads(block: JointBlock, seed: int) -> list[tuple[Payload, int]]:
    """Changes at, between and beyond the stamps, on either link."""
    rng = np.random.default_rng(seed)
    low, high = int(block.stamp_ns.min()), int(block.stamp_ns.max())
    stamps = [int(rng.choice(block.stamp_ns)), *rng.integers(low, high + 10**8, 3).tolist()]
    links = rng.choice(["upper", "fore"], 4).tolist()
    return [
        (payload(link, round(float(rng.uniform(0, 5))), (0.1, 0, 0)), stamp)
        for link, stamp in zip(links, stamps, strict=True)
    ]


def run(block: JointBlock, seed: int, cuts: list[int]):
    pipeline = EnergyPipeline(MODEL, Settings(effort=EffortMeaning.JOINT_TORQUE))
    temperature, meter = readings(block, seed)
    for body, from_ns in payloads(block, seed):
        pipeline.torque.set_payload(body, from_ns)
    outputs = [pipeline.step(temperatures=temperature, meter=meter)]
    bounds = [0, *sorted(cuts), len(block)]
    for start, stop in pairwise(bounds):
        if stop > start:
            outputs.append(pipeline.step(joints=block[slice(start, stop)]))
    outputs.append(pipeline.flush())
    power = PowerBlock.concatenate([out.power for out in outputs if out.power is not None])
    means = MeanBlock.concatenate([out.means for out in outputs if out.means is not None])
    return pipeline, power, means


def same(a, b, equal: Callable[..., None]) -> None:
    for name in a.__dataclass_fields__:
        equal(getattr(a, name), getattr(b, name), err_msg=name)


seeds = st.integers(0, 2**31)


@settings(deadline=None, max_examples=12)
@given(seed=seeds, cuts=st.lists(st.integers(0, 400), max_size=60))
def test_any_cutting_gives_the_same_output(seed, cuts):
    block = motion(seed)
    whole, power, means = run(block, seed, [])
    cut, power_cut, means_cut = run(block, seed, cuts)
    same(power, power_cut, np.testing.assert_array_equal)
    books, books_cut = whole.account, cut.account
    np.testing.assert_array_equal(books.registers.microjoule, books_cut.registers.microjoule)
    assert books.registers.time == books_cut.registers.time
    assert books.comparison.compared_ns == books_cut.comparison.compared_ns
    assert books.comparison.measured_energy == books_cut.comparison.measured_energy
    assert books.comparison.predicted_energy == books_cut.comparison.predicted_energy
    assert books.counts.quality == books_cut.counts.quality
    assert books.calibration.state() == books_cut.calibration.state()
    np.testing.assert_array_equal(books.shaft.microjoule, books_cut.shaft.microjoule)
    np.testing.assert_array_equal(books.shaft.compared_ns, books_cut.shaft.compared_ns)
    assert (books.shaft.compared_ns <= books.registers.time.observed_ns).all()

    def close(a, b, err_msg):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-9, err_msg=err_msg)

    same(means, means_cut, close)


@settings(deadline=None, max_examples=12)
@given(seed=seeds)
def test_breakdown_sums_and_friction_never_gives_power(seed):
    pipeline, power, _ = run(motion(seed), seed, [])
    total = sum_over_joints(power.rigid_power + power.friction_power + power.drive_loss)
    total += power.loss_dc + power.loss_grid + power.brake_power + power.capacitor_power
    np.testing.assert_allclose(total, power.grid_power, rtol=1e-12, atol=1e-9)
    friction = power.friction_power[np.isfinite(power.friction_power)]
    assert (friction >= 0).all()
    assert (power.brake_power[np.isfinite(power.brake_power)] >= 0).all()
    assert (power.grid_power[np.isfinite(power.grid_power)] >= 30.0 - 1e-9).all()
    time = pipeline.account.registers.time
    block = motion(seed)
    elapsed = np.diff(block.stamp_ns)
    assert time.observed_ns + time.gap_ns == int(elapsed[elapsed > 0].sum())


@settings(deadline=None, max_examples=12)
@given(seed=seeds)
def test_order_of_joints_in_the_model_does_not_matter(seed):
    data = robots.two_link_data()
    data["joints"].reverse()
    block = motion(seed)
    temperature, _ = readings(block, seed)
    straight, turned = EnergyPipeline(MODEL), EnergyPipeline(robots.two_link(**data))
    swapped = JointBlock(
        block.stamp_ns,
        block.segment,
        block.quality,
        block.joint_position[:, ::-1].copy(),
        block.joint_velocity[:, ::-1].copy(),
        block.joint_acceleration[:, ::-1].copy(),
        block.joint_effort[:, ::-1].copy(),
    )
    turned_temperature = TemperatureBlock(
        temperature.stamp_ns, temperature.motor_temperature_degc[:, ::-1].copy()
    )
    straight.step(block, temperature)
    turned.step(swapped, turned_temperature)
    straight.flush()
    turned.flush()
    for name in ("grid_import", "brake", "loss_dc"):
        a, b = straight.account.registers.cabinet(name), turned.account.registers.cabinet(name)
        assert abs(a - b) <= 1e-9 * max(abs(a), 1)


@given(seed=seeds)
def test_power_is_the_same_on_both_sides_of_the_gears(seed):
    rng = np.random.default_rng(seed)
    drivetrain = Drivetrain.from_model(MODEL)
    velocity, torque = rng.normal(size=(2, 5, 2)) * 10
    joint = sum_over_joints(velocity * torque)
    motor = sum_over_joints(
        drivetrain.motor_velocity_from_joint(velocity) * drivetrain.motor_torque_from_joint(torque)
    )
    np.testing.assert_allclose(motor, joint, rtol=1e-10, atol=1e-9)
