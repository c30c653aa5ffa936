"""`robot-energy identify excitation`: files that a controller can play."""

import json

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_cli import main

QUICK = ["identify", "excitation", "--model", "kr16", "--starts", "1", "--iterations", "2"]
JOINTS = [f"joint_a{number}" for number in range(1, 7)]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("excitation") / "motion"
    report = folder.parent / "report.json"
    assert main([*QUICK, "--rate", "50", "--loops", "2", "--floor", "0.3", "--out", str(folder),
                 "--json", str(report)]) == 0  # fmt: skip
    return folder, json.loads(report.read_text())


def test_csv_and_trajectory_hold_the_same_motion(written):
    folder, _ = written
    table = np.genfromtxt(folder / "excitation.csv", delimiter=",", names=True)
    with AnyReader([folder / "excitation_bag"]) as bag:
        ((connection, _, data),) = bag.messages()
        message = bag.deserialize(data, connection.msgtype)
    assert connection.msgtype == "trajectory_msgs/msg/JointTrajectory"
    assert connection.topic == "/joint_trajectory"
    assert message.joint_names == list(load("kr16").joint_names)
    assert len(message.points) == len(table) == 1001
    time = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
    np.testing.assert_allclose(time, table["time"], atol=1e-8)
    assert time[-1] == 20.0
    for kind, field in (
        ("position", "positions"),
        ("velocity", "velocities"),
        ("acceleration", "accelerations"),
    ):
        for place, name in enumerate(message.joint_names):
            values = [getattr(point, field)[place] for point in message.points]
            np.testing.assert_allclose(values, table[f"{kind}_{name}"], rtol=1e-8, atol=1e-8)
    for ends in (message.points[0], message.points[-1]):
        assert np.abs(ends.velocities).max() < 1e-9
        assert np.abs(ends.accelerations).max() < 1e-9


def test_report_names_parameters_limits_and_the_floor(written):
    folder, report = written
    table = np.genfromtxt(folder / "excitation.csv", delimiter=",", names=True)
    assert report["after"]["log_determinant"] > report["before"]["log_determinant"]
    assert len(report["base_parameters"]) == 58
    assert report["after"]["not_excited"] == []
    assert "m joint_a1" in report["without_effect"]
    assert report["acceleration_assumed"]
    model = load("kr16")
    robot = Robot.from_model(model)
    for joint, name in enumerate(model.joint_names):
        entry = report["joints"][joint]
        assert entry["start"] == pytest.approx(table[f"position_{name}"][0], abs=1e-8)
        fastest = np.abs(table[f"velocity_{name}"]).max() / robot.limits.velocity[joint]
        assert entry["use"]["velocity"] == pytest.approx(fastest, rel=0.02)
        assert max(entry["use"].values()) <= 0.9
    positions = np.column_stack([table[f"position_{name}"] for name in model.joint_names])
    height = [robot.link_position(row, "flange")[2] for row in positions[::10]]
    assert report["least_height"] >= 0.3
    assert min(height) > 0.0


def test_terminal_says_what_to_mind(tmp_path, capsys):
    assert main([*QUICK, "--no-floor", "--out", str(tmp_path / "motion")]) == 0
    text = capsys.readouterr().out
    for part in ("condition number", "start [rad or m]", "not excited: -", "collisions",
                 "no link is kept above a floor", "full speed in 0.5 s is assumed"):  # fmt: skip
        assert part in text


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--period", "0"], "period"),
        (["--harmonics", "1"], "harmonics"),
        (["--rate", "0"], "rate"),
        (["--loops", "0"], "loops"),
        (["--margin", "2"], "share of the limits"),
        (["--acceleration", "1", "2"], "acceleration limits"),
        (["--tool", "hand"], "no link 'hand'"),
        (["--starts", "0"], "starts"),
    ],
)
def test_bad_options_are_refused_before_the_search(options, text, tmp_path, capsys):
    assert main([*QUICK, *options, "--out", str(tmp_path / "motion")]) == 2
    assert text in capsys.readouterr().err
    assert not (tmp_path / "motion").exists()


def test_files_of_an_earlier_run_are_kept(written, capsys):
    folder, _ = written
    assert main([*QUICK, "--out", str(folder)]) == 2
    assert "--overwrite" in capsys.readouterr().err
