"""Whole recordings held out, work of the motors, and priors that keep a short one honest."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from excited import fourier_motion, monitor_torque, recorded
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy_identify.api.identify import dynamics_of
from robot_energy_identify.data.observations import Channels, Filters, observe
from robot_energy_identify.dynamics.consistent import Prior
from robot_energy_identify.dynamics.dynamics import DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.leave_one_out import across_recordings, motor_work, share_off
from robot_energy_identify.dynamics.torque_model import (
    ParameterColumn,
    TorqueModel,
    standard_columns,
)
from robot_energy_identify.dynamics.validation import estimate_delay
from robot_energy_plan.motion import Trajectory

ARM = robots.two_link()
QUICK = DynamicsSettings(columns=standard_columns(0.05), delay_span=0.0)


def other_motion(seed, noise=0.02, loaded=0.0, duration=12.0, size=1.0):
    """The arm on a motion of its own."""
    time = np.arange(round(duration * 500.0)) / 500.0
    path = fourier_motion(2, time, seed)
    motion = Trajectory(*(size * part for part in path.__dict__.values()))
    model = ARM
    if loaded:
        payload = [
            {"link": "fore", "mass": loaded, "centre_of_mass": [0.4, 0, 0], "tag": "assumed"}
        ]
        data = robots.two_link_data() | {"payload": payload}
        model = robots.validate(data, "loaded")
    torque = monitor_torque(model, motion)
    random = np.random.default_rng(seed)
    torque = torque + noise * torque.std(axis=0) * random.normal(size=torque.shape)
    return [Channels(500.0, motion.joint_position, torque)]


def test_work_of_a_robot_at_constant_power_by_hand():
    """2 rad/s against 3 N m and back: 6 W; coupled motors share it by their speeds."""
    drivetrain = Drivetrain.from_model(ARM)
    rows = observe([recorded(ARM)], TorqueModel.from_model(ARM, ()), Filters(cutoff=10.0))
    count = len(rows.segment)
    velocity = np.tile([2.0, 0.0], (count, 1))
    velocity[count // 2 :] *= -1.0
    motion = replace(rows.motion, joint_velocity=velocity)
    still = replace(rows, motion=motion, compared=np.ones(count, dtype=np.bool_))
    found = motor_work(still, np.tile([3.0, 0.0], (count, 1)), drivetrain.transmission)
    half = 6.0 * (count // 2) / rows.rate
    assert found.net.sum() == pytest.approx(half - 6.0 * (count - count // 2) / rows.rate)
    assert found.positive.sum() == pytest.approx(half)
    assert share_off(90.0, 100.0) == pytest.approx(-0.1)
    assert np.isnan(share_off(1.0, 0.0))


def test_recordings_of_one_robot_predict_each_other_and_another_load_does_not():
    same = across_recordings({"one": other_motion(1), "two": other_motion(2)}, ARM, QUICK)
    assert [(each.recording, each.trained_on) for each in same.judgements] == [
        ("one", ("two",)),
        ("two", ("one",)),
        ("one", ("one",)),
        ("two", ("two",)),
    ]
    for each in same.judgements:
        assert each.torque.total < 0.03
        assert each.predicted.net.sum() == pytest.approx(each.measured.net.sum(), rel=0.02)
    loaded = across_recordings(
        {"bare": other_motion(1), "loaded": other_motion(2, loaded=2.0)}, ARM, QUICK
    )
    across, own = loaded.judgements[:2], loaded.judgements[2:]
    assert min(each.torque.total for each in across) > 0.1
    assert max(each.torque.total for each in own) < 0.03


def test_several_recordings_are_held_out_whole_and_one_is_not():
    recordings = {"one": other_motion(1), "two": other_motion(2)}
    found = dynamics_of(recordings, ARM, QUICK, ()).found
    assert found.across is not None
    assert len(found.across.judgements) == 4
    assert list(found.torque_error) == ["held_out", "held_out_model_file"]
    assert dynamics_of({"one": recordings["one"]}, ARM, QUICK, ()).found.across is None


def test_three_recordings_are_each_predicted_from_the_two_others():
    three = {name: other_motion(seed) for seed, name in enumerate("abc")}
    found = across_recordings(three, ARM, QUICK)
    assert [each.trained_on for each in found.judgements[:3]] == [
        ("b", "c"),
        ("a", "c"),
        ("a", "b"),
    ]


def test_a_recording_that_says_too_little_is_named():
    short = [replace(part, **cut(part)) for part in other_motion(2)]
    found = across_recordings({"long": other_motion(1), "short": short}, ARM, QUICK)
    assert [each.recording for each in found.judgements] == ["short", "long"]
    assert [text.split(":")[0] for text in found.refused] == [
        "long from short",
        "short from short",
    ]


def cut(part):
    return {"joint_position": part.joint_position[:600], "motor_torque": part.motor_torque[:600]}


def test_the_held_out_recording_does_not_reach_the_fit():
    recordings = {"one": other_motion(1), "two": other_motion(2)}
    before = across_recordings(recordings, ARM, QUICK).judgements[0]
    louder = [replace(part, motor_torque=3.0 * part.motor_torque) for part in recordings["one"]]
    after = across_recordings(recordings | {"one": louder}, ARM, QUICK).judgements[0]
    np.testing.assert_allclose(after.predicted.net, before.predicted.net, rtol=1e-9)
    np.testing.assert_allclose(after.measured.net, 3.0 * before.measured.net, rtol=1e-9)


def test_weight_does_not_go_into_the_offset_that_the_model_file_lacks():
    """A fifth of the usual motion: weight hardly changes and looks like an offset."""
    settings = replace(QUICK, filters=Filters(standing_velocity=0.002))
    recording = other_motion(3, noise=0.05, size=0.2)
    kept = identify_dynamics(recording, ARM, settings)
    free = identify_dynamics(recording, ARM, replace(settings, offset=1e3))
    assert np.abs(offsets(kept)).max() < 0.02  # there is none
    assert np.abs(offsets(free)).max() > 1.0
    assert free.held_out_consistent().total > 1.5 * kept.held_out_consistent().total
    assert kept.held_out_consistent().total < 1.1 * kept.held_out().total


def offsets(result):
    names = [f"{one.kind} {j + 1}" for one in result.columns for j in one.joints(np.eye(2))]
    return np.array(
        [
            value
            for name, value in zip(names, result.standard[20:], strict=False)
            if name.startswith("offset")
        ]
    )


def test_the_model_file_is_judged_without_the_sensors_offset():
    """An offset of a tenth of the torque is not an error of least squares but one of the file."""
    shifted = other_motion(4)[0]
    size = 0.1 * np.abs(shifted.motor_torque).max(axis=0)
    shifted = replace(shifted, motor_torque=shifted.motor_torque + size)
    result = identify_dynamics([shifted], ARM, QUICK)
    assert result.held_out().total < 0.03
    assert result.held_out_consistent().total > 0.05
    expected = size @ Drivetrain.from_model(ARM).transmission
    rows = result.rows_of([shifted])
    missing = np.median(rows.joint_torque - result.predict(rows), axis=0)
    np.testing.assert_allclose(missing, expected, rtol=0.4)


class Spring(ParameterColumn):
    """A spring at the first joint only, as a counterbalance has it."""

    def joints(self, transmission):
        return [0]

    def torque(self, motion, transmission):
        result = np.zeros((*motion.joint_position.shape, 1))
        result[:, 0, 0] = motion.joint_position[:, 0]
        return result


def test_a_column_of_one_joint_only_is_fitted():
    part = other_motion(5)[0]
    drivetrain = Drivetrain.from_model(ARM)
    joint = np.zeros_like(part.joint_position)
    joint[:, 0] = 7.0 * part.joint_position[:, 0]
    sprung = replace(
        part, motor_torque=part.motor_torque + drivetrain.motor_torque_from_joint(joint)
    )
    settings = replace(
        QUICK,
        columns=(
            *QUICK.columns,
            Spring("spring", "N m/rad", written=lambda joint, ratio, estimate: joint),
        ),
    )
    result = identify_dynamics([sprung], ARM, settings)
    assert result.standard[-1] == pytest.approx(7.0, rel=0.05)
    assert result.held_out_consistent().total < 0.03


def test_no_delay_is_seen_where_parameters_are_hardly_said():
    """Without the prior, free parameters of a short recording take up a delay of any size."""
    settings = replace(QUICK, delay_span=0.005)
    result = identify_dynamics(other_motion(6, noise=0.1, duration=8.0), ARM, settings)
    assert abs(result.delay.value) < 5e-4
    assert result.delay.applied == 0.0


def test_a_delay_beyond_the_range_is_noted_and_not_half_applied():
    result = identify_dynamics([recorded(ARM, delay=0.05)], ARM, replace(QUICK, delay_span=0.005))
    assert result.delay.at_edge
    assert result.delay.applied == 0.0


def test_a_firm_prior_decides_what_the_rows_do_not_say():
    """Prior of the wrong size: the delay's fits follow it, so it is really used."""
    late = recorded(ARM, delay=0.003)
    rows = observe([late], TorqueModel.from_model(ARM, QUICK.columns), QUICK.filters)
    size = rows.regressor.shape[2]
    weight = np.full(2, 1.0)
    firm = Prior(np.zeros(size), np.full(size, 1e-9))  # nothing moves: no delay is better
    loose = Prior(np.zeros(size), np.full(size, np.inf))
    stuck = estimate_delay(rows, weight, firm, 0.005, 0.1)
    free = estimate_delay(rows, weight, loose, 0.005, 0.1)
    assert abs(stuck.gain) < 1e-3
    assert free.gain > 0.1
    assert free.value == pytest.approx(0.003, abs=2e-4)
