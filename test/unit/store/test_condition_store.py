"""Learned figures and their files: restart, other models, damage, a disk in trouble."""

import numpy as np

import robots
from robot_energy.condition.record import THERMAL_VERSION
from robot_energy.model import load
from robot_energy.model.joint import JointThermal
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.store.condition_store import ConditionStore
from robot_energy.store.slots import unwrap, wrap
from robot_energy.timeline.blocks import Learning


def opened(folder, model="kr16", learning=Learning.OBSERVE, node="/cell/monitor"):
    used = load(model)
    learner = EnergyPipeline(used, Settings(learning=learning)).condition
    store = ConditionStore(learner, used, folder, node=node)
    store.open()
    return learner, store


def kept(folder, value: float, **changes) -> None:
    """Leave a figure behind."""
    learner, store = opened(folder, **changes)
    learner.friction.newest[:] = value
    store.close()
    assert not store.trouble


def test_figures_continue(tmp_path):
    kept(tmp_path, 5.0)
    learner, store = opened(tmp_path)
    assert (learner.friction.newest == 5.0).all()
    assert (store.trouble, store.notices) == ("", [])


def test_each_model_file_has_its_own(tmp_path):
    kept(tmp_path, 5.0)
    learner, store = opened(tmp_path, model="mantis")
    assert (learner.friction.newest == 0.0).all()
    store.close()
    learner, _ = opened(tmp_path)
    assert (learner.friction.newest == 5.0).all()


def test_a_damaged_file_is_moved_aside_and_said(tmp_path):
    kept(tmp_path, 5.0)
    for path in tmp_path.glob("*.state"):
        path.write_bytes(path.read_bytes().replace(b"5.0", b"6.0"))
    learner, store = opened(tmp_path)
    assert (learner.friction.newest == 0.0).all()
    assert "CRC" in store.notices[0]
    assert list(tmp_path.glob("*.bad-1"))


def test_two_monitors_do_not_write_the_same_files(tmp_path):
    first, store = opened(tmp_path)
    _, second = opened(tmp_path)
    assert "another monitor" in second.trouble
    first.friction.newest[:] = 7.0
    store.close()
    second.open()
    assert second.trouble == ""
    assert np.all(opened(tmp_path, node="/other")[0].friction.newest == 0.0)


def test_nothing_is_kept_where_nothing_is_learned(tmp_path):
    _, store = opened(tmp_path, learning=Learning.OFF)
    store.close()
    assert not list(tmp_path.iterdir())


def test_estimated_temperatures_are_kept_and_need_no_learning(tmp_path):
    model = robots.one_wheel()
    entry = {"capacity": robots.figure(400.0), "conductance": robots.figure(0.5)}
    thermal = JointThermal.model_validate(entry)
    model = model.changed(joints=[model.joints[0].model_copy(update={"thermal": thermal})])

    def opened_thermal():
        pipeline = EnergyPipeline(model, Settings(learning=Learning.OFF))
        store = ConditionStore(pipeline.condition.thermal, model, tmp_path, node="/cell/monitor")
        store.open()
        return pipeline, store

    pipeline, store = opened_thermal()
    store.close()  # nothing has been estimated: nothing to write
    pipeline, store = opened_thermal()
    stamp = np.arange(100.0, 700.0, 0.5)
    velocity = np.full((len(stamp), 1), 4.0)
    pipeline.step(robots.joint_block(stamp, 4.0 * stamp[:, None], velocity, 0.0 * velocity))
    warm = pipeline.condition.thermal.degc[0]
    assert warm > 30.0
    store.close()
    pipeline, store = opened_thermal()
    assert (store.trouble, store.notices) == ("", [])
    assert pipeline.condition.thermal.degc[0] == warm
    store.close()
    for path in tmp_path.glob("*-thermal-*.state"):  # as a release with another record wrote it
        _, payload = unwrap(THERMAL_VERSION, path.read_bytes())
        path.write_bytes(wrap(THERMAL_VERSION - 1, 1, payload))
    pipeline, store = opened_thermal()
    assert f"format {THERMAL_VERSION - 1}" in store.notices[0]
    assert (store.trouble, store.notices[-1]) == ("", "temperatures begin again")
    assert pipeline.condition.thermal.degc[0] < warm
    assert list(tmp_path.glob("*-thermal-*.bad-1"))
