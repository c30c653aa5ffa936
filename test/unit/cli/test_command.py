from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from logbook import WHEEL_MAPPING, mapping, wheel_bag, wheel_csv, wheel_model, write_csv
from places import ROOT
from robot_energy import __version__
from robot_energy.cli import main
from robot_energy.cli import models as cli_models
from robot_energy.cli.main import EXTRAS
from robot_energy.logs import import_log

DATA = os.environ.get("ROBOT_ENERGY_DATA", "")


def refused(capsys: pytest.CaptureFixture[str], *args: object, code: int = 2) -> str:
    """Run a command that must be refused in one sentence and return that."""
    assert main([str(arg) for arg in args]) == code
    out, err = capsys.readouterr()
    assert err.startswith("robot-energy: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err
    return err


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
    assert text.startswith("predicted 680 J, measured 800 J at the grid: -15.0 %")
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


def test_replay_bridges_as_far_as_the_parameter_file_says_unless_told_otherwise(
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


def test_outputs_are_checked_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("replay", tmp_path / "no bag", "--model", "kr16")
    assert "no known format" in refused(capsys, *command, "--plot", tmp_path / "a.bmp")
    assert "there is no folder" in refused(capsys, *command, "--json", tmp_path / "no" / "a")
    assert "a folder" in refused(capsys, *command, "--json", tmp_path)
    assert "the input" in refused(capsys, *command, "--out", tmp_path / "no bag")


def test_import_reports_every_bad_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_csv(tmp_path / "l.csv", "t,q_axle,w_axle,p", ["1,0,0,5", "2,x,0,5", "3,0,0,"])
    file = tmp_path / "m.yaml"
    file.write_text(json.dumps(WHEEL_MAPPING))  # JSON is YAML
    args = ["import", "csv", str(log), "--mapping", str(file), "--out", str(tmp_path / "b")]
    assert main(args) == 0
    text = capsys.readouterr().out
    assert "3 rows, 2 used, rejected: 1 not numeric (first at line 3)" in text
    assert "exists" in refused(capsys, *args)
    assert "no column 'actual_q_0'" in refused(
        capsys,
        "import",
        "ur-rtde",
        write_csv(tmp_path / "u.csv", "timestamp,b", ["1,2"]),
        "--out",
        tmp_path / "c",
    )


def test_models_are_listed_and_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models"]) == 0
    assert "kr16" in capsys.readouterr().out
    assert main(["model", "check", "kr16", "--json", "-"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["figures"]["assumed"] > 0
    assert summary["moving_mass"] > summary["payload_mass"] > 0
    assert main(["models", "check", "ur3e"]) == 0
    assert "locked joints" in capsys.readouterr().out


def test_a_folder_of_the_same_name_does_not_hide_a_shipped_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ur3e").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(["models", "check", "ur3e"]) == 0
    capsys.readouterr()


def test_simulate_records_a_bag_that_replays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(tmp_path / "sim")
    assert main(["simulate", "--duration", "3", "--out", bag, "--start-temperature", "30"]) == 0
    assert "virtual rig" in capsys.readouterr().out
    assert main(["replay", bag, "--model", "kr16"]) == 0
    text = capsys.readouterr().out
    assert "Predicted and measured" in text
    assert "origin" in text  # results on the rig are labelled so
    assert main(["info", bag]) == 0
    assert "origin: virtual" in capsys.readouterr().out
    assert "seed" in refused(capsys, "simulate", "--out", tmp_path / "x", "--seed", "-1")


def test_wrong_arguments_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"robot-energy {__version__}\n"
    assert main(["replay", "--help"]) == 0
    assert "examples:" in capsys.readouterr().out
    for args in (
        ["fly"],
        ["replay", "x"],
        ["replay", "x", "--model", "m", "--temperature-wait", "-1"],
        ["replay", "x", "--model", "m", "--fixed-friction", "hot"],
    ):
        assert main(args) == 2
        assert "Traceback" not in capsys.readouterr().err


def test_unexpected_errors_and_interrupts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    args = ["replay", str(bag), "--model", str(model)]
    for error, code, said in (
        (RuntimeError("a\nbug"), 1, "--debug"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (PermissionError(13, "Permission denied", "x"), 2, "x: Permission"),
    ):

        def fail(*_: object, error: BaseException = error) -> None:
            raise error

        monkeypatch.setattr("robot_energy.results.replay.replay_report", fail)
        assert said in refused(capsys, *args, code=code)
    monkeypatch.setattr("robot_energy.results.replay.replay_report", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main([*args, "--debug"])


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    command = [sys.executable, "-m", "robot_energy", "replay", str(bag), "--model", str(model)]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert (process.wait(timeout=60), error) == (0, b"")


def test_the_version_is_that_of_the_package() -> None:
    tree = ElementTree.parse(ROOT / "src" / "package.xml")
    assert tree.findtext("version") == __version__


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


def test_effort_shows_measured_beside_predicted_shaft_energy(
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


@pytest.mark.parametrize("library", ["clarabel", "matplotlib"])
def test_a_missing_extra_is_named(
    library: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lacking(args: object) -> int:
        raise ModuleNotFoundError(f"No module named '{library}'", name=f"{library}.parts")

    monkeypatch.setattr(cli_models, "run_list", lacking)
    assert f"robot_energy[{EXTRAS[library]}]" in refused(capsys, "models")


def test_joint_states_of_a_shipped_model_name_it(capsys):
    assert main(["replay", str(ROOT / "bags/kr16_cold"), "--model", "ur5e"]) == 2
    assert "kr16" in capsys.readouterr().err


def test_a_command_keeps_to_one_thread_of_blas():
    code = (
        "from robot_energy.cli import main; main(['kinds']); import numpy, threadpoolctl; "
        "assert [one['num_threads'] for one in threadpoolctl.threadpool_info() "
        "if one['user_api'] == 'blas'] == [1]"
    )
    environment = {k: v for k, v in os.environ.items() if not k.endswith("NUM_THREADS")}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, capture_output=True)


def test_the_parser_imports_no_numpy():
    """Not even for commands of other packages: every command begins with it."""
    code = (
        "import sys; from robot_energy.cli.main import build_parser; build_parser(); "
        "sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
