"""A real 300 kg robot: one recording predicted from the other, and the check of its axes."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excited import monitor_torque
from places import ROOT
from refusals import refused
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load, save
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy_cli.main import main
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_identify.dynamics.dynamics import DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_identify.dynamics.leave_one_out import across_recordings
from robot_energy_identify.dynamics.validation import torque_error
from robot_energy_logs.mapping import load_mapping
from robot_energy_plan.motion.sampled_motion import low_pass

MAPPING = ROOT / "src/examples/identify/kr300.yaml"
DATA = Path(os.environ.get("ROBOT_ENERGY_DATA", "/nonexistent")) / "kr300"
HOME = np.array([0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0])


def model():
    return model_of(load_mapping(MAPPING), [MAPPING.parent])


def published_flange(angles):
    """Flange by the published Denavit-Hartenberg rows: d, a, alpha [m, rad] and zero of each."""
    rows = [
        (-0.675, 0.350, np.pi / 2, 0.0),
        (-0.189, 1.150, 0.0, 0.0),
        (0.189, 0.041, -np.pi / 2, np.pi / 2),
        (-1.0, 0.0, np.pi / 2, 0.0),
        (0.0, 0.0, -np.pi / 2, 0.0),
        (-0.24, 0.0, np.pi, 0.0),
    ]
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # the base stands on its head
    for angle, (d, a, twist, zero) in zip(angles, rows, strict=True):
        c, s = np.cos(angle + zero), np.sin(angle + zero)
        k, m = np.cos(twist), np.sin(twist)
        pose = pose @ np.array(
            [[c, -s * k, s * m, a * c], [s, c * k, -c * m, a * s], [0, m, k, d], [0, 0, 0, 1]]
        )
    return pose[:3, 3]


def test_the_flange_is_where_the_published_kinematics_put_it():
    robot = Robot.from_model(model())
    angles = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 6))
    angles[0] = HOME
    expected = [published_flange(row) for row in angles]
    found = [robot.link_position(row, "load") for row in angles]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert expected[0] == pytest.approx([0.35 + 1.24, 0.0, 0.675 + 1.15 - 0.041])


@pytest.fixture(scope="module")
def recordings():
    if not DATA.is_dir():
        pytest.skip("no data folder (ROBOT_ENERGY_DATA)")
    log = load_mapping(MAPPING)
    return read_channels([DATA], log, model())


@pytest.fixture(scope="module")
def held_out(recordings):
    across = across_recordings(recordings, model())
    assert not across.refused
    return {(each.recording, each.trained_on): each for each in across.judgements}


@pytest.mark.parametrize(("recording", "other"), [("A", "B"), ("B", "A")])
def test_one_recording_is_predicted_from_the_other(held_out, recording, other):
    found = held_out[recording, (other,)]
    assert found.torque.total < 0.08
    assert (found.torque.joint < [0.10, 0.12, 0.05, 0.22, 0.10, 0.20]).all()
    assert found.least_squares.total > 1.5 * found.torque.total  # 10 s are few for 58 parameters
    for kind, limit in (("net", 0.015), ("positive", 0.02)):
        said = getattr(found.predicted, kind).sum()
        assert said == pytest.approx(getattr(found.measured, kind).sum(), rel=limit)


@pytest.mark.parametrize("name", ["A", "B"])
def test_blocks_of_the_same_recording_are_predicted(held_out, name):
    found = held_out[name, (name,)]
    assert found.torque.total < 0.10
    said, measured = found.predicted.net.sum(), found.measured.net.sum()
    assert said == pytest.approx(measured, rel=0.045)


def test_the_written_model_gives_that_error_through_the_stages_of_the_monitor(recordings, tmp_path):
    """Rigid bodies, rotors and friction of the saved file, filtered as the measurement is."""
    fit = identify_dynamics(recordings["A"], model())
    save(to_model(fit, ["A"]), tmp_path / "a.yaml")
    rows = fit.rows_of(recordings["B"])
    motor = monitor_torque(load(tmp_path / "a.yaml"), rows.motion)
    joint = Drivetrain.from_model(fit.model).joint_torque_from_motor(motor)
    found = torque_error(rows, low_pass(joint, rows.rate, fit.settings.filters.cutoff))
    assert found.total == pytest.approx(torque_error(rows, fit.predict(rows)).total, rel=0.02)
    assert found.total < 0.08


def cross_errors(recordings, sense=1.0, zero=0.0):
    """Error of each axis, both recordings, with axes turned round or counted from elsewhere."""
    settings = DynamicsSettings(delay_span=0.0)
    changed = {
        name: [
            replace(
                part,
                joint_position=(part.joint_position - HOME) * sense + HOME + zero,
                motor_torque=part.motor_torque * sense,
            )
            for part in parts
        ]
        for name, parts in recordings.items()
    }
    errors = []
    for one, other in (("A", "B"), ("B", "A")):
        fit = identify_dynamics(changed[one], model(), settings)
        rows = fit.rows_of(changed[other])
        errors.append(torque_error(rows, fit.predict(rows)).joint)
    return np.array(errors)


@pytest.mark.long
def test_the_conventions_of_the_axes_are_those_that_predict_best(recordings):
    """Sense of axes 1 to 5 and zero of axes 2 to 5; axis 6 turns a load that is round about it."""
    as_published = cross_errors(recordings)
    for axis in range(5):
        turned = cross_errors(recordings, sense=1.0 - 2.0 * np.eye(6)[axis])
        assert (turned[:, axis] > 1.25 * as_published[:, axis]).all(), f"sense of axis {axis + 1}"
    for axis in range(1, 5):
        shifted = cross_errors(recordings, zero=0.5 * np.pi * np.eye(6)[axis])
        assert shifted.mean() > 1.5 * as_published.mean(), f"zero of axis {axis + 1}"


def test_no_delay_is_made_up_from_ten_seconds(recordings):
    """Least squares alone would shift recording A by 5 ms, the end of the range, and gain 7 %."""
    found = identify_dynamics(recordings["A"], model()).delay
    assert abs(found.value) < 0.003
    assert found.applied == 0.0
    assert not found.at_edge


def test_offsets_of_the_torque_stay_as_small_as_sensors_have_them(recordings):
    """Free ones would reach 3500 N m on axis 2, whose weight hardly changes in 30 deg."""
    fit = identify_dynamics(recordings["B"], model(), DynamicsSettings(delay_span=0.0))
    names = [
        f"{column.kind} {name}"
        for column in fit.columns
        for name in fit.model.joint_names
        if len(column.joints(np.eye(6))) == 6
    ]
    found = dict(zip(names, fit.standard[60:], strict=True))
    assert abs(found["offset joint_a2"]) < 100.0
    place = fit.fit.names.index("offset joint_a2")
    assert fit.fit.std[place] > 300.0  # least squares cannot determine


def test_its_gas_spring_is_not_told_from_weight(recordings):
    """54 degrees in ten seconds: a constant, a slope and a weight look alike."""
    zero = {"value": 0.0, "tag": "assumed"}
    spring = {"kind": "spring", "stiffness": zero, "rest": zero}
    joints = list(model().joints)
    given = joints[1].model_dump(exclude_none=True) | {"counterbalance": spring}
    joints[1] = type(joints[1]).model_validate(given)
    with refused(NotIdentifiableError, found=("joint_a2", "weight"), remedy=("data sheet",)):
        identify_dynamics(recordings["A"], model().changed(joints=joints))


def test_the_command_prints_both_directions(recordings, capsys):
    assert main(["identify", "dynamics", "--log", str(MAPPING), "--data", str(DATA)]) == 0
    text = capsys.readouterr().out
    assert "A from B" in text
    assert "B from A" in text
    assert "work of the motors" in text
