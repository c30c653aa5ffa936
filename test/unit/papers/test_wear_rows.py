"""Rows that stand for many days of the rig, against the rig itself."""

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.model import load
from robot_energy.timeline.blocks import Learning, PowerBlock
from robot_energy_rig import RigConfig, VirtualRig, random_profile
from robot_energy_studies.learning_study import joint_block, pipeline_of, work
from wear_cycle import RATE
from wear_rows import CHANGE_EVERY, WearRows
from wear_study import records_of

SEED, WARM = 5, 65.0
PROFILE = random_profile("kr16", SEED)
ROWS = WearRows(PROFILE, SEED)
WORN = np.linspace(1.0, 1.5, PROFILE.n_joints)


def test_a_cycle_at_another_temperature_is_that_of_the_rig():
    """Friction over a cycle, rig and pipeline at 65 degC; the rows were computed at 40 degC."""
    config = replace(RigConfig.hard(), warming=False, stamp_jitter=False, temperature_error=False)
    rig = VirtualRig(PROFILE, work(PROFILE, SEED), config, SEED, WARM, WARM, rate_hz=RATE)
    true, known = ROWS.payloads[0]
    rig.change(payload=true, wear=WORN)
    pipeline = pipeline_of(load("kr16"), Learning.OBSERVE, True)
    pipeline.torque.set_payload(known)
    blocks: list[PowerBlock] = []
    learner = pipeline.condition
    learner.step = lambda block, _: blocks.append(block)
    output = rig.step(round(ROWS.cycle * RATE))
    pipeline.step(joint_block(output.joints), output.temperatures, None)
    block = PowerBlock.concatenate(blocks)
    seen = learner.reader.read(block, block.friction_power)
    degc = np.full(PROFILE.n_joints, WARM)
    measured, model = ROWS.torques(ROWS.loads[0], degc, degc, degc, WORN)
    for rows, by_rig in ((measured, seen.measured), (model, seen.model)):
        np.testing.assert_allclose(
            rows.sum(axis=(0, 3)), by_rig.sum(axis=2), rtol=0.03, atol=0.02 * abs(by_rig).max()
        )


def test_a_day_swings_and_its_payloads_change():
    (day,) = ROWS.days(1)
    degc = np.array([part.degc for part in day])
    assert (np.ptp(degc, axis=0) > 15.0).all()
    assert degc.max() < 150.0
    loads = {part.load.tobytes() for part in day}
    assert len(loads) > 2 * ROWS.cycle / 15.0
    assert CHANGE_EVERY < 3600.0


def test_temperatures_go_on_from_one_program_to_the_next():
    rows = WearRows(PROFILE, SEED, changes=(7.0, 10.0))
    (day,) = rows.days(1)
    assert len({part.time.tobytes() for part in day}) > len(ROWS.loads) * len(ROWS.loads[0].time)
    degc = np.array([part.degc for part in day])
    assert np.abs(degc[4:] - degc[:-4]).max() < 4.0  # a minute


@pytest.mark.long
def test_wear_in_the_plant_raises_the_excess_of_its_axis_alone():
    def excess(wear):
        records = records_of(WearRows(PROFILE, SEED).days(1, wear), PROFILE.n_joints)
        return np.array([np.mean([one.excess for one in own]) for own in records])

    one = np.where(np.arange(PROFILE.n_joints) == 3, 1.15, 1.0)
    rise = excess(lambda _: one) - excess(None)
    assert 0.1 < rise[3] < 0.2
    np.testing.assert_allclose(np.delete(rise, 3), 0.0, atol=1e-6)
