"""`robot-energy replay`: what it writes, and the bags and models that it refuses."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import yaml

from command_line import refused
from logbook import WHEEL_MAPPING, mapping, wheel_bag, wheel_csv, wheel_model, write_csv
from places import ROOT
from robot_energy.model import load, save
from robot_energy_cli import main
from robot_energy_logs.log_import import import_log

DATA = os.environ.get("ROBOT_ENERGY_DATA", "")


def test_replay_prints_tables_and_writes_all_outputs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    outputs = [tmp_path / name for name in ("out", "r.json", "p.png")]
    args = [
        "replay",
        str(bag),
        "--model",
        str(model),
        "--out",
        str(outputs[0]),
        "--json",
        str(outputs[1]),
        "--plot",
        str(outputs[2]),
        "--compare",
        "40",
    ]
    assert main(args) == 0
    text = capsys.readouterr().out
    assert text.startswith("The model reads 15.0 % low; ")
    assert "\npredicted 680 J, measured 800 J at the grid: -15.0 %" in text
    summary = json.loads(outputs[1].read_text())
    assert summary["comparison"]["measured_energy"] == pytest.approx(800.0)
    assert summary["compared_with"]["model"]["change"] == "friction fixed at 40 degC"
    assert outputs[2].read_bytes().startswith(b"\x89PNG")
    assert main(["info", str(outputs[0])]) == 0
    listing = capsys.readouterr().out
    for topic in ("joint_torque", "joint_friction", "power", "registers"):
        assert f"/energy/{topic}" in listing
    assert "exists" in refused(capsys, *args)
    assert main([*args, "--overwrite"]) == 0


def test_replay_bridges_as_far_as_the_parameter_file_says_unless_asked_otherwise(
    tmp_path: Path,
) -> None:
    """Readings 0.1 s apart, of which a file bridges 0.05 s."""
    bag, model = wheel_bag(tmp_path, rate=10.0), wheel_model(tmp_path)
    file, out = tmp_path / "node.yaml", tmp_path / "r.json"
    file.write_text("/**:\n  ros__parameters:\n    meter_max_gap: 0.05\n")
    words = ["replay", str(bag), "--model", str(model), "--json", str(out), "--inputs", str(file)]
    measured: list[float | None] = []
    for more in ([], ["--meter-max-gap", "0.2"]):
        assert main([*words, *more]) == 0
        comparison = json.loads(out.read_text())["comparison"]
        measured.append(comparison and comparison["measured_energy"])
    assert measured[0] != pytest.approx(800.0)
    assert measured[1] == pytest.approx(800.0)


def test_json_on_standard_output_is_nothing_but_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    assert (
        main(
            [
                "replay",
                str(bag),
                "--model",
                str(model),
                "--json",
                "-",
                "--fixed-friction",
                "30",
                "--meter-max-gap",
                "1",
            ]
        )
        == 0
    )
    summary = json.loads(capsys.readouterr().out)
    assert summary["model"]["change"] == "friction fixed at 30 degC"


def test_a_model_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    assert "shipped models: irb4600, kr16, " in refused(
        capsys, "replay", bag, "--model", "nope"
    ).replace("Shipped", "shipped")
    broken = tmp_path / "broken.yaml"
    text = model.read_text()
    for wrong, said in (
        (text.replace("drive: ideal", "drive: perfect"), "'drive' is 'perfect'"),
        (text.replace("schema_version: 1", "schema_version: 9"), "schema_version 9"),
        ("a: [", "not valid YAML"),
        ("[]", "is a list"),
    ):
        broken.write_text(wrong)
        assert said in refused(capsys, "replay", bag, "--model", broken)
        assert said in refused(capsys, "models", "check", broken)
    broken.write_text(text.replace("<mass value=", "<weight value="))
    assert "inertial without mass" in refused(capsys, "replay", bag, "--model", broken)
    broken.write_text(text.replace("name: axle", "name: axis"))
    assert "axis" in refused(capsys, "replay", bag, "--model", broken)


def test_joints_that_do_not_match(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    joints = {**WHEEL_MAPPING["joints"], "names": ["hub"], "keys": ["axle"]}
    import_log(wheel_csv(tmp_path / "l.csv"), mapping(joints=joints), tmp_path / "bag")
    options = ("--model", wheel_model(tmp_path), "--out", tmp_path / "energy")
    text = refused(capsys, "replay", tmp_path / "bag", *options)
    assert "has the joint(s) axle" in text
    assert "name hub" in text
    assert not (tmp_path / "energy").exists()


def test_bags_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    command = ("replay", bag, "--model", model)
    assert "does not exist" in refused(capsys, "replay", tmp_path / "no", "--model", model)
    assert "does not exist" in refused(capsys, "info", tmp_path / "no")
    assert "has no /joints" in refused(capsys, *command, "--joint-states", "/joints")
    wrong_type = refused(capsys, *command, "--joint-states", "/power_meter")
    assert "/joint_states" in wrong_type  # what would have been right
    assert "has no /t" in refused(capsys, *command, "--temperatures", "/t")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "holds no bag" in refused(capsys, "replay", empty, "--model", model)
    (empty / "x.mcap").write_bytes(b"")
    refused(capsys, "replay", empty, "--model", model)
    (empty / "x.mcap").write_bytes(b"nothing of the kind" * 100)
    refused(capsys, "replay", empty, "--model", model)


def test_a_bag_without_a_single_joint_state(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from robot_energy.bag import BagWriter

    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/joint_states", "sensor_msgs/msg/JointState")
    model = wheel_model(tmp_path)
    assert "no message of /joint_states" in refused(
        capsys, "replay", tmp_path / "bag", "--model", model
    )


def test_a_truncated_bag_is_read_in_part_and_exits_with_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wheel_bag(tmp_path, seconds=200.0)  # several chunks
    file = next((tmp_path / "bag").glob("*.mcap"))
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    report = tmp_path / "r.json"
    args = ["replay", str(tmp_path / "bag"), "--model", str(wheel_model(tmp_path))]
    assert main([*args, "--json", str(report)]) == 3
    assert "problem: " in capsys.readouterr().out
    summary = json.loads(report.read_text())
    assert summary["problems"]
    assert 10e9 < summary["time"]["observed_ns"] < 200e9
    assert main(["info", str(tmp_path / "bag")]) == 3
    assert "problem: " in capsys.readouterr().out


def test_a_bag_cut_in_its_first_chunk_is_called_damaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It lacks joint states because it lacks its end, which is what the user can mend."""
    wheel_bag(tmp_path)
    file = next((tmp_path / "bag").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:1000])
    sentence = refused(capsys, "replay", file, "--model", wheel_model(tmp_path))
    assert "the file ends" in sentence
    assert "topic" not in sentence


@pytest.mark.skipif(not DATA, reason="no data folder")
def test_a_recorded_ur3e_from_log_to_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The model was not fitted to it; its standstill power was chosen knowing it."""
    bag = str(tmp_path / "ur3e")
    logs = [str(path) for path in sorted(Path(DATA).glob("rad_ur3e/*.csv"))]
    assert main(["import", "ur-rtde", *logs, "--out", bag]) == 0
    capsys.readouterr()
    assert main(["replay", bag, "--model", "ur3e", "--json", "-"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["comparison"]["compared_ns"] == 5_320_000_000
    assert summary["comparison"]["measured_energy"] == pytest.approx(222.184, abs=0.01)
    assert abs(summary["comparison"]["predicted_minus_measured_relative"]) < 0.15


def test_effort_shows_measured_next_to_predicted_shaft_energy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Motor at 30 rad/s for 10 s: 1 N m measured is 300 J; the model says 330 J, +10 %."""
    header = "t,q_axle,w_axle,torque"
    rows = [(f"{n / 100:.6f}", f"{3 * n / 100:.9f}", 3.0, 1.0) for n in range(1001)]
    log = write_csv(tmp_path / "wheel.csv", header, rows)
    joints = {**WHEEL_MAPPING["joints"], "effort": {"columns": ["torque"], "unit": "newton_metre"}}
    import_log(log, mapping(joints=joints, power=None), tmp_path / "bag")
    args = ["replay", str(tmp_path / "bag"), "--model", str(wheel_model(tmp_path))]
    assert main([*args, "--json", str(tmp_path / "r.json"), "--effort", "motor_torque"]) == 0
    text = capsys.readouterr().out
    (line,) = [line for line in text.split("Shaft energy")[1].splitlines() if "axle" in line]
    assert line.split() == "axle 300.0 330.0 0.0 0.0 30.0 +10.0 % 100.0 %".split()
    (joint,) = json.loads((tmp_path / "r.json").read_text())["shaft"]["joints"]
    assert joint["shaft_energy_positive_measured"] == pytest.approx(300.0)
    assert joint["compared_time"] == pytest.approx(10.0)
    assert main([*args, "--json", str(tmp_path / "r.json")]) == 0
    assert "Shaft energy" not in capsys.readouterr().out
    assert json.loads((tmp_path / "r.json").read_text())["shaft"] is None
    assert "no torque_constant for axle" in refused(capsys, *args, "--effort", "motor_current")
    assert main([*args, "--effort", "torque"]) == 2
    assert "joint_torque" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("definition", "said"),
    [
        ("std_msgs/Header header\nstring[] name\nfloat64[] angle\n", "has no field 'position'"),
        ("std_msgs/Header header\nstring[] name\nfloat64[\n", "cannot be parsed"),
        ("nowhere/Header header\nstring[] name\n", "nowhere/msg/Header"),
    ],
)
def test_a_bag_whose_own_definition_does_not_fit_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], definition: str, said: str
) -> None:
    """The bag says how its bytes lie; if that is not a joint state, nothing is guessed."""
    from mcap.writer import Writer

    path = tmp_path / "own.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        schema = writer.register_schema(
            "sensor_msgs/msg/JointState", "ros2msg", definition.encode()
        )
        channel = writer.register_channel("/joint_states", "cdr", schema)
        writer.add_message(channel, 0, bytes(100), 0)
        writer.finish()
    assert said in refused(capsys, "replay", path, "--model", wheel_model(tmp_path))


def test_joint_states_of_a_shipped_model_name_it(capsys):
    assert main(["replay", str(ROOT / "bags/kr16_cold"), "--model", "ur5e"]) == 2
    assert "kr16" in capsys.readouterr().err


def test_a_replay_names_the_payload_that_explains_its_torque(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The model carries 7 kg more than the robot does; with the true payload nothing is said."""
    heavier = load("kr16")
    (body,) = heavier.payload
    more = body.model_copy(update={"mass": body.mass + 7.0})
    heavier = heavier.changed(payload=(more,))
    path = tmp_path / "heavier.yaml"
    save(heavier, path)
    for model, named in (("kr16", False), (str(path), True)):
        words = ["replay", str(ROOT / "bags/kr16_warm"), "--effort", "motor_torque"]
        assert main([*words, "--model", model]) == 0
        text = " ".join(capsys.readouterr().out.split())
        assert ("what check finds: the robot carries" in text) is named
        assert ("remedy: payload:" in text) is named


def test_a_replay_shows_the_temperature_of_a_gear_where_the_model_has_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "geared.yaml"
    save(load("kr16"), path)
    data = yaml.safe_load(path.read_text())
    values = {"capacity": 5000.0, "motor_conductance": 5.0, "ambient_conductance": 5.0}
    parts = {name: {"value": value, "tag": "assumed"} for name, value in values.items()}
    data["joints"][1]["gear"] = {**parts, "std": 1.0}
    path.write_text(yaml.safe_dump(data))
    words = ["replay", str(ROOT / "bags/kr16_warm"), "--model", str(path), "--json"]
    assert main([*words, str(tmp_path / "r.json")]) == 0
    assert "gear" in capsys.readouterr().out
    joints = json.loads((tmp_path / "r.json").read_text())["joints"]
    gears = [joint["last_gear_temperature_degc"] for joint in joints]
    assert [gear is not None for gear in gears] == [False, True, False, False, False, False]
    assert 10.0 < gears[1] < 100.0
