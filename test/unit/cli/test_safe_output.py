"""Names from outside reach terminal, log and pages without anything that acts there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import unicodedata
from pathlib import Path

import numpy as np
import pytest
import yaml

from logbook import WHEEL_MAPPING, wheel_bag, wheel_model
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.decode import Encoder
from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.foundation.shown_text import MAX_LINE, shown, shown_lines
from robot_energy_cli import main
from robot_energy_report.canvas import canvas, named_ticks
from robot_energy_report.document import Document
from robot_energy_report.html import page_html

ESCAPE = "\x1b[2J\x1b]0;owned\x07"
NASTY = f"a{ESCAPE}\r\n\x9b31m\u202etxt\u2066\u200b\u2028 $\\frac[red]"
LONG = "n" * 10_000
BAD_FILE = os.fsdecode(b"x\xff\x1b[2J")


def unsafe(text: str) -> set[str]:
    """What of a text acts on a terminal: control, format, separator characters, surrogates."""
    kinds = {"Cc", "Cf", "Cs", "Zl", "Zp"}
    return {c for c in text if c != "\n" and unicodedata.category(c) in kinds}


@pytest.mark.parametrize("text", [NASTY, LONG, BAD_FILE, "\ud800", "tab\there"])
def test_a_shown_text_is_safe_and_bounded(text: str) -> None:
    for safe in (shown(text), shown_lines(text), str(RobotEnergyError(text, text, text))):
        assert not unsafe(safe)
        safe.encode()
    assert len(shown(text)) <= 200
    assert len(shown_lines(LONG)) <= MAX_LINE
    assert "\n" not in shown(text)


def test_an_error_keeps_its_parts_and_quotes_them_safely() -> None:
    error = RobotEnergyError(f"no {NASTY}", "joint 'a'", "name it")
    assert error.found.startswith("no a\\x1b[2J")
    assert str(error).endswith("; expected joint 'a'. Name it.")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A bag, a model, a log, a mapping, a program, a parameter file with such names."""
    tmp_path = tmp_path_factory.mktemp("names")
    wheel_bag(tmp_path)
    found = {"bag": tmp_path / "bag", "log": tmp_path / "wheel.csv"}
    found["model"] = wheel_model(tmp_path)
    nasty = tmp_path / BAD_FILE
    with BagWriter(nasty, origin=NASTY) as bag:
        states = BagReader(found["bag"])
        bag.add_topic("/joint_states", "sensor_msgs/msg/JointState")
        for part in states.parts(["/joint_states"]):
            batch = part["/joint_states"]
            rows = [batch.row(index) for index in range(len(batch))]
            bag.write("/joint_states", batch.log_time_ns, rows)
        names = {"header.frame_id": NASTY, "name": (NASTY, "axle")}
        lengths = {"position": 2, "velocity": 0, "effort": 0}
        encoder = Encoder("sensor_msgs/msg/JointState", names, lengths)
        stamp = {"header.stamp.sec": 10**9, "header.stamp.nanosec": 0}
        for topic in (NASTY, LONG):
            bag.add_topic(topic, "sensor_msgs/msg/JointState")
            none = np.zeros((1, 0))
            columns = {"position": np.zeros((1, 2)), "velocity": none, "effort": none}
            rows = encoder.encode({**stamp, **columns}, 1)
            bag.write(topic, np.array([10**18]), rows)
    found["nasty_bag"] = nasty
    log = {**WHEEL_MAPPING, "description": NASTY, NASTY: 1}
    data = yaml.safe_load(found["model"].read_text())
    data["robot"] = {"type": NASTY, "serial": LONG, "description": NASTY}
    data["provenance"] = {"notes": NASTY, "bags": [NASTY]}
    data["joints"][0]["gear_ratio"]["source"] = NASTY
    for name, content in {
        "nasty_model": data,
        "unknown_key": {**data, NASTY: 1, LONG: 2},
        "wrong_value": {**data, "drive": NASTY},
        "nasty_mapping": log,
        "long_mapping": {**WHEEL_MAPPING, "time": {"column": NASTY, "start": LONG}},
        "program": {
            "schema_version": 1, "motion": "point_to_point", "angle_unit": "rad",
            "via": [{NASTY: 0.0}],
        },
        "parameters": {NASTY: {"ros__parameters": {"meter": {"topic": NASTY, NASTY: 1}}}},
    }.items():  # fmt: skip
        found[name] = tmp_path / f"{name}{BAD_FILE}.yaml"
        found[name].write_text(yaml.safe_dump(content))
    header, _, rest = found["log"].read_text().partition("\n")
    found["nasty_log"] = tmp_path / f"log{BAD_FILE}.csv"
    found["nasty_log"].write_text(f"{header},{NASTY.replace(chr(13) + chr(10), '')}\n{rest}")
    found["mapping"] = tmp_path / "mapping.yaml"
    found["mapping"].write_text(yaml.safe_dump(WHEEL_MAPPING))
    found["out"] = tmp_path / f"out{BAD_FILE}"
    return found


@pytest.fixture
def files(made: dict[str, Path], tmp_path: Path) -> dict[str, Path]:
    """Copies of them."""
    folder = shutil.copytree(made["bag"].parent, tmp_path / "names")
    return {name: folder / path.name for name, path in made.items()}


COMMANDS = [
    "info nasty_bag",
    "replay nasty_bag --model model",
    "replay bag --model nasty_model --compare 40 --plot out.svg --json -",
    "replay bag --model nasty_model",
    "replay bag --model model --inputs parameters",
    "replay bag --model unknown_key",
    "replay bag --model wrong_value",
    "replay bag --model out",
    "replay out --model model",
    "replay bag --model model --out out",
    "report nasty_bag --model nasty_model --out out.html",
    "model check nasty_model",
    "model check unknown_key",
    "import csv nasty_log --mapping mapping --out out",
    "import csv log --mapping nasty_mapping --out out",
    "import csv log --mapping long_mapping --out out",
    "import ur-rtde nasty_log --out out",
    "predict program --model nasty_model --temperature 20",
    "predict nasty_bag --model nasty_model --temperature 20",
    "identify friction nasty_bag --model nasty_model --effort motor_torque --out out",
    "identify cabinet nasty_bag --model nasty_model --out out",
    "identify drives nasty_bag --model nasty_model --out out",
    "identify dynamics nasty_bag --model nasty_model --effort motor_torque --out out",
    "identify dynamics --log unknown_key",
    "identify all nasty_bag --model nasty_model --effort motor_torque --out out --report out.html",
    "identify friction --log nasty_log --mapping mapping",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_shows_what_acts_on_a_terminal(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str], command: str
) -> None:
    words = [str(files.get(word, word)) for word in command.split()]
    words = [str(files["out"]) + word[3:] if word.startswith("out.") else word for word in words]
    code = main(words)
    out, err = capsys.readouterr()
    assert code in (0, 2, 3), err
    assert out or err
    assert not unsafe(out + err)
    if code == 2 and err.startswith("robot-energy: "):
        assert err.count("\n") == 1


def test_a_wrong_argument_is_quoted_safely(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["info", "bag", f"--{NASTY}"], ["replay", "bag", "--model", "kr16", BAD_FILE]):
        assert main(words) == 2
        assert not unsafe(capsys.readouterr().err)


def test_letters_that_a_terminal_lacks_are_written_as_escapes(files: dict[str, Path]) -> None:
    bag = files["bag"].rename(files["bag"].with_name("b\u00e4g"))
    done = subprocess.run(
        [sys.executable, "-m", "robot_energy", "info", str(bag)], capture_output=True, check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"b\\xe4g" in done.stdout


def test_pages_and_pictures_hold_names_as_they_are_shown(tmp_path: Path) -> None:
    page = Document(NASTY, NASTY)
    page.heading(NASTY)
    page.note(NASTY)
    page.table(NASTY, (NASTY,), ((NASTY,),))
    path = tmp_path / "figure.svg"
    with canvas(path, (4.0, 3.0), NASTY) as figure:
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], label=NASTY)
        axes.set_xlabel(NASTY)
        named_ticks(axes.yaxis, [0.0, 1.0], [NASTY, "plain"])
        axes.legend()
    for text in (page_html(page), path.read_text()):
        assert not unsafe(text)
