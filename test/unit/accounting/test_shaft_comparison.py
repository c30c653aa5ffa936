"""Measured shaft energy next to the predicted one, joint by joint, worked out by hand."""

import numpy as np
import pytest

import robots
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning

# The wheel of `robots` at 3 rad/s: motor 30 rad/s, friction 33 W = predicted shaft power.
PREDICTED = 33.0
EFFORT = 2.0  # N m at the motor: 60 W measured


def spin(velocity=3.0, effort=EFFORT, seconds=1.0):
    stamp = np.arange(round(seconds * 100) + 1) / 100
    speed = np.full((len(stamp), 1), velocity)
    return robots.joint_block(stamp, speed * stamp[:, None], speed, effort=speed * 0 + effort)


def run(block, meaning=EffortMeaning.MOTOR_TORQUE, model=None, **settings):
    pipeline = EnergyPipeline(model or robots.one_wheel(), Settings(effort=meaning, **settings))
    outputs = [pipeline.step(block), pipeline.flush()]
    means = [out.means for out in outputs if out.means is not None]
    return pipeline.account, MeanBlock.concatenate(means) if means else None


def shaft(account):
    names = ("measured_positive", "measured_negative", "predicted_positive", "predicted_negative")
    return [pytest.approx(account.shaft.joints(name)[0], abs=2e-6) for name in names]


def test_driving_motor_by_hand():
    account, means = run(spin(), power_period=0.1)
    assert shaft(account) == [60.0, 0.0, PREDICTED, 0.0]
    assert account.shaft.compared_ns.tolist() == [10**9]
    np.testing.assert_allclose(means.shaft_power_measured, 60.0)
    np.testing.assert_allclose(means.motor_torque_measured, EFFORT)


def test_measured_generating_counts_in_its_own_register():
    # turning backward against a positive torque: -60 W measured; friction still takes 33 W
    account, _ = run(spin(velocity=-3.0))
    assert shaft(account) == [0.0, 60.0, PREDICTED, 0.0]


def test_missing_effort_is_no_gap_of_the_registers_and_no_zero():
    block = spin()
    block.joint_effort[40:60] = np.nan  # from 0.39 s to 0.60 s nothing is measured
    account, means = run(block, power_period=0.1)
    assert account.registers.time.observed_ns == 10**9
    assert account.registers.joints("shaft_positive")[0] == pytest.approx(PREDICTED)
    assert account.shaft.compared_ns.tolist() == [790_000_000]
    assert shaft(account) == [60.0 * 0.79, 0.0, PREDICTED * 0.79, 0.0]
    whole = np.isfinite(means.shaft_power_measured[:, 0])
    assert whole.sum() in (7, 8)  # periods without a missing sample
    np.testing.assert_allclose(means.shaft_power_measured[whole], 60.0)
    np.testing.assert_allclose(means.powers["friction"], PREDICTED)


def test_gap_of_the_joint_states_counts_for_neither():
    block = spin()
    block.stamp_ns[50:] += 10**10
    block.segment[50:] = 1
    account, _ = run(block)
    assert account.shaft.compared_ns.tolist() == [account.registers.time.observed_ns]
    assert account.shaft.compared_ns.tolist() == [990_000_000]
    assert shaft(account) == [60.0 * 0.99, 0.0, PREDICTED * 0.99, 0.0]


def test_each_joint_has_its_own_coverage():
    stamp = np.arange(101) / 100
    speed = np.tile([1.0, 0.0], (101, 1))
    block = robots.joint_block(stamp, speed * stamp[:, None], speed, effort=speed * 0 + 0.5)
    block.joint_effort[:50, 1] = np.nan
    account, _ = run(block, model=robots.two_link())
    assert account.shaft.compared_ns.tolist() == [10**9, 510_000_000 - 10_000_000]
    # motors at 100 and 10 rad/s (the elbow's through the coupling), 0.5 N m each
    np.testing.assert_allclose(account.shaft.joints("measured_positive"), [50.0, 2.5], rtol=1e-9)


@pytest.mark.parametrize("effort", [np.nan, np.inf, 1e300])
def test_effort_that_cannot_be_is_unknown(effort):
    account, means = run(spin(effort=effort))
    assert account.shaft.compared_ns.tolist() == [0]
    assert np.isnan(account.shaft.joints("measured_positive")).all()
    assert not account.shaft.microjoule.any()
    assert np.isnan(means.shaft_power_measured).all()
    assert account.registers.joints("friction")[0] == pytest.approx(PREDICTED)


def test_effort_is_not_used_unless_its_meaning_is_said():
    account, means = run(spin(), meaning=EffortMeaning.NONE)
    assert account.shaft.compared_ns.tolist() == [0]
    assert np.isnan(means.shaft_power_measured).all()
    assert Settings().effort is EffortMeaning.NONE


def test_block_without_any_effort_is_not_bridged():
    block = spin()
    block.joint_effort[40:60] = np.nan
    pipeline = EnergyPipeline(robots.one_wheel(), Settings(effort=EffortMeaning.MOTOR_TORQUE))
    for start, stop in ((0, 40), (40, 60), (60, 101)):
        torque = pipeline.torque.step(block[slice(start, stop)])
        rest = pipeline.torque.flush()
        for part in (torque, rest):
            power = pipeline.power.step(part) if part is not None else None
            if power is not None:
                pipeline.account.step(power)
        power = pipeline.power.flush()
        pipeline.account.step(power)
    assert pipeline.account.shaft.compared_ns.tolist() == [790_000_000]
