"""The learner in the pipeline: the rig at work, cut in any way, restarted."""

import json
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import robots
from robot_energy.foundation.errors import StateFileError
from robot_energy.model import load
from robot_energy.model.schema import CabinetFan
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import Learning, PowerBlock, Quality
from robot_energy_rig import VirtualRig, load_profile
from robot_energy_studies.learning_study import (
    at_work,
    joint_block,
    learning_study,
    mistaken,
    pipeline_of,
    work,
)

PROFILE = load_profile("kr16")
WRONG = mistaken(load("kr16"), 0.7, 0.85)


def rig(rate_hz=100.0, seed=3) -> VirtualRig:
    return VirtualRig(PROFILE, work(PROFILE, seed), seed=seed, rate_hz=rate_hz)


@cache
def recorded(seconds, rate):
    return rig(rate).step(round(seconds * rate))


def run(learning, with_torque, cuts, seconds=150, rate=50.0, model=WRONG) -> EnergyPipeline:
    """Feed the rig's samples in pieces; temperatures and readings come with their own stamps."""
    output = recorded(seconds, rate)
    joints = joint_block(output.joints, with_torque)
    pipeline = pipeline_of(model, learning, with_torque)
    stamps = joints.stamp_ns
    bounds = [int(stamps[0]) - 1, *stamps[sorted(cuts)].tolist(), int(stamps[-1]) + 10**9]
    for start, stop in pairwise(bounds):
        part = [
            block[(block.stamp_ns > start) & (block.stamp_ns <= stop)]
            for block in (joints, output.temperatures, output.meter)
        ]
        pipeline.step(*(block if len(block) else None for block in part))
    pipeline.flush()
    return pipeline


@pytest.mark.parametrize(
    ("learning", "with_torque"),
    [(Learning.OBSERVE, True), (Learning.APPLY, True), (Learning.APPLY, False)],
)
def test_any_cutting_teaches_the_same(learning, with_torque):
    rng = np.random.default_rng(7)
    many = np.cumsum(rng.integers(1, 90, 200))
    whole = run(learning, with_torque, [])
    for cuts in (many[many < 7500].tolist(), [50 * k for k in range(1, 150)]):
        cut = run(learning, with_torque, cuts)
        assert cut.condition.state() == whole.condition.state()
        np.testing.assert_array_equal(
            cut.account.registers.microjoule, whole.account.registers.microjoule
        )
        assert cut.account.counts.quality == whole.account.counts.quality
    applied = learning is Learning.APPLY
    assert (whole.account.counts.quality[Quality.LEARNED] > 0) is applied
    assert bool(whole.account.counts.learned_energy_sum.joule[0] > 0) is applied


def with_open_fan(runs):
    """200 W that may run at any temperature of a motor; in the constants or in the fan."""
    model = load("kr16")
    grid = model.cabinet.loss_grid
    grid = grid.model_copy(update={"value": grid.value - 200.0 * runs})
    fan = {
        "power": robots.figure(200.0),
        "on_above_degc": robots.figure(120.0),
        "hysteresis": robots.figure(110.0),
    }
    update = {"fan": CabinetFan.model_validate(fan), "loss_grid": grid}
    return model.changed(cabinet=model.cabinet.model_copy(update=update)), grid.value


@pytest.mark.parametrize("runs", [True, False])
def test_the_meter_shows_whether_a_fan_runs_however_it_is_cut(runs):
    """Between its stop and its start it has 100 W until the first windows, then 200 W or 0."""
    model, constant = with_open_fan(runs)
    output = rig(50.0).step(2500)
    joints = joint_block(output.joints)

    def fan_powers(cuts, learning=Learning.APPLY, meter=True):
        pipeline, found = EnergyPipeline(model, Settings(learning=learning)), []
        bounds = [int(joints.stamp_ns[0]) - 1, *joints.stamp_ns[cuts].tolist(), 2**62]
        for start, stop in pairwise(bounds):
            part = [
                block[(block.stamp_ns > start) & (block.stamp_ns <= stop)]
                for block in (joints, output.temperatures, output.meter)
            ]
            part = [block if len(block) else None for block in part]
            found.append(pipeline.step(*(part if meter else part[:2])).power)
        found.append(pipeline.flush().power)
        power = PowerBlock.concatenate([one for one in found if one is not None])
        by_meter = power.quality & Quality.LEARNED > 0
        np.testing.assert_array_equal(by_meter, ~np.isclose(power.loss_grid - constant, 100.0))
        return power.loss_grid - constant

    whole = fan_powers([])
    assert whole[:250] == pytest.approx(100.0)
    assert whole[-1000:] == pytest.approx(200.0 * runs, abs=2.0)
    for cuts in ([1234], list(range(17, 2500, 33))):
        np.testing.assert_array_equal(fan_powers(cuts), whole)
    for learning in (Learning.OFF, Learning.OBSERVE):
        assert fan_powers([], learning) == pytest.approx(100.0)
    assert fan_powers([], meter=False) == pytest.approx(100.0)


def test_after_an_hour_without_samples_the_meter_says_no_more_of_a_fan():
    """It was found to run, with 200 W; from the first sample after the gap on it has 100 W."""
    model, constant = with_open_fan(True)
    output = rig(50.0).step(2500)
    joints = joint_block(output.joints)
    end = int(joints.stamp_ns[1500])
    before, after = (
        [block[(block.stamp_ns <= end) == early] for block in (joints, output.temperatures)]
        for early in (True, False)
    )
    after = [replace(block, stamp_ns=block.stamp_ns + 3_600_000_000_000) for block in after]
    pipeline = EnergyPipeline(model, Settings(learning=Learning.APPLY))
    pipeline.step(*before, output.meter[output.meter.stamp_ns <= end])
    found = [pipeline.step(*after).power, pipeline.flush().power]
    power = np.concatenate([one.loss_grid for one in found if one is not None]) - constant
    assert power[0] == pytest.approx(200.0, abs=2.0)  # a sample waits for the derivative
    later = np.concatenate([one.stamp_ns for one in found if one is not None]) > end + 10**12
    assert power[later] == pytest.approx(100.0)


@pytest.mark.parametrize("model", [WRONG, with_open_fan(True)[0]], ids=["wrong", "fan"])
def test_observing_changes_no_energy(model):
    off, observed = (run(way, True, [], model=model) for way in (Learning.OFF, Learning.OBSERVE))
    np.testing.assert_array_equal(
        off.account.registers.microjoule, observed.account.registers.microjoule
    )
    assert off.condition.end_ns is None
    assert observed.condition.friction.valid.all()


@pytest.mark.parametrize("with_torque", [True, False])
def test_a_mistaken_model_follows_the_meter(with_torque):
    rows, pipeline = learning_study(PROFILE, Learning.APPLY, with_torque, 10)
    assert rows[0].error < -0.15
    assert all(abs(row.error) < 0.03 for row in rows[3:])
    condition = pipeline.condition
    assert condition.friction.valid.all() is np.bool_(with_torque)
    assert condition.meter.valid
    if with_torque:  # 1 / 0.7, times what the rig has and the model not
        assert ((condition.friction.filtered > 1.2) & (condition.friction.filtered < 1.8)).all()


def test_what_was_learned_survives_a_restart():
    machine = rig()
    before = pipeline_of(WRONG, Learning.APPLY, True)
    at_work(before, machine, 3, True)
    kept = before.condition.state()
    after = pipeline_of(WRONG, Learning.APPLY, True)
    after.condition.restore(type(kept).from_json(kept.to_json()))
    fresh = pipeline_of(WRONG, Learning.APPLY, True)
    output = machine.step(3000)
    for pipeline in (after, fresh):
        pipeline.step(joint_block(output.joints), output.temperatures, output.meter)
    measured, predicted = after.account.comparison.joule
    assert abs(predicted / measured - 1.0) < 0.03
    measured, predicted = fresh.account.comparison.joule
    assert predicted / measured - 1.0 < -0.1


def test_figures_of_another_model_are_refused():
    kept = pipeline_of(WRONG, Learning.OBSERVE, True).condition.state()
    other = EnergyPipeline(load("kr16"))
    with pytest.raises(StateFileError, match="learned figures of model"):
        other.condition.restore(kept)


def test_a_file_of_the_first_format_is_refused():
    kept = pipeline_of(WRONG, Learning.OBSERVE, True).condition.state()
    old = kept.model_dump(mode="json")
    for entry in old["wear"]["tests"]:
        del entry["contrasts"]
    with pytest.raises(StateFileError, match=r"wear.tests.0.contrasts"):
        type(kept).from_json(json.dumps(old).encode())


def test_a_file_of_the_second_format_keeps_its_records_of_wear():
    pipeline = pipeline_of(WRONG, Learning.OBSERVE, True)
    at_work(pipeline, rig(25.0), 9, True)
    kept = pipeline.condition.state()
    old = kept.model_dump(mode="json")
    for entry in old["wear"]["tests"]:
        del entry["contrasts"]["levels"]
        del entry["programs"]
        for record in entry["records"]:
            del record["work"], record["program"]
    after = pipeline_of(WRONG, Learning.OBSERVE, True)
    after.condition.restore(type(kept).from_json(json.dumps(old).encode()))
    before, now = (one.condition.wear.joints for one in (pipeline, after))
    assert any(test.records for test in before)
    assert [test.records for test in before] == [test.records for test in now]


@pytest.mark.parametrize("quality", [Quality.OK, Quality.TEMPERATURE_STUCK])
def test_friction_at_a_temperature_that_is_stuck_says_nothing_of_wear(quality):
    output = rig(50.0).step(1500)
    pipeline = pipeline_of(load("kr16"), Learning.OBSERVE, True)
    learner, blocks = pipeline.condition, []
    take, learner.step = learner.step, lambda *given: blocks.append(given)
    pipeline.step(joint_block(output.joints), output.temperatures, None)
    for block, degc in blocks:
        take(replace(block, quality=block.quality | np.uint32(quality)), degc)
    learner.flush()
    assert learner.friction.parts.all()
    assert (np.array(learner.wear.state().hours) > 0).all() == (quality == Quality.OK)


def test_of_every_10_ms_the_first_sample_is_learned_from():
    output = rig(500.0).step(3000)
    pipeline = pipeline_of(load("kr16"), Learning.OBSERVE, True)
    reader, stamps = pipeline.condition.reader, []
    read = reader.read
    reader.read = lambda samples, friction: (
        stamps.append(samples.stamp_ns) or read(samples, friction)
    )
    power = pipeline.step(joint_block(output.joints), output.temperatures, None).power
    pipeline.flush()
    found = np.concatenate(stamps)
    slots, first = np.unique(power.stamp_ns // 10_000_000, return_index=True)
    np.testing.assert_array_equal(found[: len(slots) - 1], power.stamp_ns[first[:-1]])
