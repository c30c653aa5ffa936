"""The command line as a whole: its commands, wrong arguments, errors and interrupts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from command_line import refused
from logbook import WHEEL_MAPPING, wheel_bag, wheel_model, write_csv
from places import ROOT
from robot_energy import __version__
from robot_energy.foundation.extras import EXTRAS
from robot_energy.physics import kernels
from robot_energy_cli import main


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
    assert "3 rows, 2 used, rejected: 1 not numeric (first at line 3, where q_axle is 'x')" in text
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
    said = capsys.readouterr().out
    form = "without" if kernels.compiled is None else "with"
    assert said == f"robot-energy {__version__} {form} compiled kernels\n"
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
        (PermissionError(13, "Permission denied", "x"), 2, "denied; expected access rights to it"),
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


@pytest.mark.parametrize("library", ["clarabel", "matplotlib"])
def test_a_missing_extra_is_named(
    library: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lacking() -> None:
        raise ModuleNotFoundError(f"No module named '{library}'", name=f"{library}.parts")

    monkeypatch.setattr("robot_energy.model.shipped_models", lacking)
    assert f"pip install './src[{EXTRAS[library]}]'" in refused(capsys, "models")


def test_studies_that_count_our_own_claims_ask_for_a_clone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a wheel has them not."""
    for name in [name for name in sys.modules if name.startswith("robot_energy_studies")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "robot_energy_studies", None)
    out = tmp_path / "study"
    said = refused(capsys, "reproduce", "certainty", "--quick", "--out", out)
    assert "needs robot_energy_studies" in said
    assert "Run it in a clone" in said
    assert not out.exists()


def test_a_command_keeps_to_one_thread_of_blas():
    code = (
        "from robot_energy_cli import main; main(['kinds']); import numpy, threadpoolctl; "
        "assert [one['num_threads'] for one in threadpoolctl.threadpool_info() "
        "if one['user_api'] == 'blas'] == [1]"
    )
    environment = {k: v for k, v in os.environ.items() if not k.endswith("NUM_THREADS")}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, capture_output=True)


def test_the_parser_imports_no_numpy():
    """Not even for commands of other packages: every command begins with it."""
    code = (
        "import sys; from robot_energy_cli.main import build_parser; build_parser(); "
        "sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
