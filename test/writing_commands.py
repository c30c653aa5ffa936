"""Commands that write, and how tests run them in a folder of inputs."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest

from robot_energy.bag import BagWriter
from robot_energy_cli import main


class Command(NamedTuple):
    """A command line that writes.

    Attributes:
        words: Of the command and its inputs, in a folder of `inputs`.
        files: Options that name a file.
        folder: Whether --out names a folder.
        given: Names of the inputs that it must not touch.
    """

    words: str
    files: tuple[str, ...]
    folder: bool
    given: tuple[str, ...]


IDENTIFY = ("--out", "--json", "--report")
COMMANDS = {
    "replay": Command("replay bag --model wheel.yaml", ("--json", "--plot"), True,
                      ("bag", "bag/bag_0.mcap", "wheel.yaml")),
    "report": Command("report bag --model wheel.yaml", ("--out",), False, ("bag", "wheel.yaml")),
    "simulate": Command("simulate --duration 0.05", (), True, ()),
    "import csv": Command("import csv wheel.csv --mapping map.yaml", (), True,
                          ("wheel.csv", "map.yaml")),
    "import ur-rtde": Command("import ur-rtde ur.csv", (), True, ("ur.csv",)),
    "models check": Command("models check wheel.yaml", ("--json",), False, ("wheel.yaml",)),
    "predict": Command("predict moves.yaml --model kr16 --temperature 20",
                       ("--json", "--report", "--plot"), False, ("moves.yaml",)),
    "excitation": Command("identify excitation --model kr16 --no-floor --starts 1 --iterations 1 "
                          "--harmonics 2", ("--json",), True, ()),
    "friction": Command("identify friction bag --model wheel.yaml --effort motor_torque",
                        (*IDENTIFY, "--plot"), False, ("bag", "wheel.yaml")),
    "cabinet": Command("identify cabinet bag --model wheel.yaml", IDENTIFY, False,
                       ("bag", "wheel.yaml")),
    "drives": Command("identify drives bag --model wheel.yaml", (*IDENTIFY, "--plot"), False,
                      ("bag", "wheel.yaml")),
    "dynamics": Command("identify dynamics bag --model wheel.yaml --effort motor_torque",
                        IDENTIFY, False, ("bag", "wheel.yaml")),
    "all": Command("identify all bag --model wheel.yaml", IDENTIFY, False, ("bag", "wheel.yaml")),
    "paper-a": Command("reproduce paper-a --quick", (), True, ()),
    "paper-b": Command("reproduce paper-b --quick", (), True, ()),
}  # fmt: skip
SUFFIX = {"--plot": ".svg"}
FILES = [(name, option) for name, command in COMMANDS.items() for option in command.files]
FOLDERS = [name for name, command in COMMANDS.items() if command.folder]


def run(name: str, **options: str) -> int:
    """Run a command with some options."""
    words = COMMANDS[name].words.split()
    for option, value in options.items():
        words += [f"--{option}", value] if value else [f"--{option}"]
    return main(words)


def outputs(name: str, overwrite: bool = False) -> dict[str, str]:
    """All outputs of a command, each in a place of its own."""
    command = COMMANDS[name]
    found = {option.strip("-"): f"new{SUFFIX.get(option, '.x')}" for option in command.files}
    found = {option: f"{option}_{value}" for option, value in found.items()}
    if command.folder:
        found["out"] = "new_folder"
        if overwrite:
            found["overwrite"] = ""
    return found


def refused(capsys: pytest.CaptureFixture[str], name: str, **options: str) -> str:
    """Run a command that must refuse in one sentence."""
    assert run(name, **options) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    return text


def own_bag(path: Path) -> None:
    with BagWriter(path) as bag:
        bag.add_topic("/a", "std_msgs/msg/Float64")
