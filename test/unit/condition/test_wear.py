"""Wear in the pipeline: which axis, what the meter alone can say, and what is said of it."""

import json

import numpy as np
import pytest

from robot_energy.condition.drift import Drift
from robot_energy.condition.joint_friction import MotionSums
from robot_energy.condition.wear import MAX_SURE, WearAlarm, WearMonitor
from robot_energy.condition.wear_records import FEATURES
from robot_energy.foundation.errors import StateFileError

NAMES = ("a", "b")
PART = 5_000_000_000


def part(number, factor, load=0.0, joints=2):
    """Five seconds, half of them forward; the load acts against one direction."""
    model = np.zeros((2, joints, 4))
    model[:, :, 2] = 1.0
    factor = np.broadcast_to(np.asarray(factor, dtype=np.float64), joints)
    measured = model * factor[:, None]
    measured[0] += load * model[0]
    measured[1] -= load * model[1]
    time = np.zeros_like(model)
    time[:, :, 2] = 2.5
    return MotionSums(
        number * PART, model, measured, time, np.ones((2, joints)), np.full(joints, 40.0)
    )


def run(hours, factor, load=lambda h: 0.0) -> WearMonitor:
    monitor, rng = WearMonitor(NAMES), np.random.default_rng(0)
    for number in range(int(hours * 720)):
        now = number / 720
        noise = 1 + 0.02 * rng.standard_normal(2)
        monitor.step(part(number, np.asarray(factor(now)) * noise, load(now)))
    return monitor


def test_the_axis_that_wears_is_named():
    monitor = run(5, lambda h: (1.0, 1.15 if h >= 4 else 1.0))
    assert [alarm.joint for alarm in monitor.alarms] == ["b"]
    alarm = monitor.alarms[0]
    assert alarm.warns
    assert alarm.drift.size == pytest.approx(0.15, abs=0.02)
    assert "friction of b rose and is" in alarm.sentence


def test_a_collision_is_no_wear():
    def factor(hours):
        return (4.0, 4.0) if 3.0 < hours < 3.01 else (1.0, 1.0)

    assert run(4, factor).alarms == ()


def test_a_load_that_acts_one_way_is_no_wear():
    assert run(5, lambda h: (1.0, 1.0), lambda h: 0.5 * (h >= 3)).alarms == ()


def test_the_meter_alone_watches_the_whole_robot():
    monitor, rng = WearMonitor(NAMES), np.random.default_rng(0)
    for number in range(180 * 90):
        hours = number / 180
        friction = rng.uniform(0, 600)
        losses = 30.0 + 20.0 * np.sin(hours)  # the constant losses wander
        worn = 0.15 * (hours >= 60)
        residual = losses + worn * friction + 5 * rng.standard_normal()
        monitor.step_meter(number * 4 * PART, 20.0, 20 * residual, 20 * friction, 40.0)
    (alarm,) = monitor.alarms
    assert alarm.joint == ""
    assert alarm.drift.size == pytest.approx(0.15, abs=0.03)
    assert "the whole robot" in alarm.sentence


def test_bad_windows_change_nothing():
    monitor = WearMonitor(NAMES)
    for number in range(100):
        monitor.step_meter(number, 5.0, np.nan, 5.0, 40.0)
    assert monitor.state().meter_hours == 0.0


def test_it_continues_from_its_state():
    whole = run(2, lambda h: (1.0, 1.1))
    again = WearMonitor(NAMES)
    again.restore(type(whole.state()).model_validate_json(whole.state().model_dump_json()))
    assert again.state() == whole.state()
    with pytest.raises(StateFileError, match="of 2 joints"):
        WearMonitor(("a",)).restore(whole.state())


def test_records_with_other_features_are_refused():
    state = run(2, lambda h: (1.0, 1.1)).state()
    content = state.model_dump(mode="json")
    content["tests"][0]["records"][0]["features"].append(0.0)
    with pytest.raises(StateFileError, match=f"{FEATURES + 1} features"):
        WearMonitor(NAMES).restore(type(state).model_validate_json(json.dumps(content)))


def test_a_fall_and_a_rise_are_different_alarms():
    fell = WearAlarm("A2", Drift(-0.08, 0.01, 10**18, 1.0, True))
    assert "fell, as after re-greasing or running in, and is 8.0 +- 1.0 % below" in fell.sentence
    assert not fell.warns
    assert fell.sure == MAX_SURE
