"""Every command that writes: what is foreign stays, and an end half-way leaves all as it was."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import pytest

from faulty_disk import FaultyDisk, inventory
from logbook import WHEEL_MAPPING, mapping, wheel_bag, wheel_csv, wheel_model
from places import ROOT
from robot_energy.bag import BagWriter
from robot_energy.cli import main
from robot_energy.files.placement import PREFIX
from robot_energy.logs import import_log

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


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
WRITING = ("replay", "simulate", "import csv", "import ur-rtde", "models check")  # in no time
FILES = [(name, option) for name, command in COMMANDS.items() for option in command.files]
FOLDERS = [name for name, command in COMMANDS.items() if command.folder]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The inputs of all commands."""
    folder = tmp_path_factory.mktemp("given")
    wheel_bag(folder, seconds=1.0)
    wheel_model(folder)
    (folder / "map.yaml").write_text(json.dumps(WHEEL_MAPPING))
    joints = ",".join(f"actual_q_{index}" for index in range(6))
    rows = [f"{10 + index / 100:.3f},0.1,0,0,0,0,0" for index in range(20)]
    (folder / "ur.csv").write_text("\n".join([f"timestamp,{joints}", *rows, ""]))
    examples = ROOT / "src" / "examples" / "programs"
    shutil.copy(examples / "kr16_pick_and_place.yaml", folder / "moves.yaml")
    return folder


@pytest.fixture
def place(given: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of them to run in."""
    folder = tmp_path / "place"
    shutil.copytree(given, folder)
    monkeypatch.chdir(folder)
    return folder


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


def a_foreign_file(path: Path) -> None:
    path.write_text('{"mine": 1}\n')


def a_link(path: Path) -> None:
    path.with_name("target").write_text("mine")
    path.symlink_to("target")


def a_link_to_nothing(path: Path) -> None:
    path.symlink_to("nothing")


def a_folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [a_foreign_file, a_link, a_link_to_nothing, a_folder])
@pytest.mark.parametrize(("name", "option"), FILES)
def test_a_file_that_is_not_ours_stays(
    place: Path, capsys: pytest.CaptureFixture[str], name: str, option: str,
    make: Callable[[Path], None],
) -> None:  # fmt: skip
    target = f"there{SUFFIX.get(option, '')}"
    make(place / target)
    before = inventory(place)
    folder = {"out": "new"} if COMMANDS[name].folder else {}
    text = refused(capsys, name, **folder, **{option.strip("-"): target})
    assert target in text
    assert inventory(place) == before


@pytest.mark.parametrize(("name", "option"), FILES)
def test_an_input_is_not_written_to(
    place: Path, capsys: pytest.CaptureFixture[str], name: str, option: str
) -> None:
    inputs = COMMANDS[name].given
    suffix = SUFFIX.get(option, "")
    os.link(place / "wheel.yaml", place / f"twin{suffix}")  # another name of an input
    before = inventory(place)
    folder = {"out": "new"} if COMMANDS[name].folder else {}
    for target in (*inputs, *(["twin"] if "wheel.yaml" in inputs else [])):
        shown = f"{target}{suffix}" if target == "twin" else target
        refused(capsys, name, **folder, **{option.strip("-"): shown})
    assert inventory(place) == before


def own_bag(path: Path) -> None:
    with BagWriter(path) as bag:
        bag.add_topic("/a", "std_msgs/msg/Float64")


def three_recordings(path: Path) -> None:
    """A folder of recordings that is no bag."""
    own_bag(path)
    for day in ("mon", "tue", "wed"):
        shutil.copy(path / f"{path.name}_0.mcap", path / f"{day}.mcap")
    (path / f"{path.name}_0.mcap").unlink()
    (path / "metadata.yaml").unlink()


def a_bag_and_a_foreign_file(path: Path) -> None:
    own_bag(path)
    (path / "thesis.tex").write_text("dear")


def a_bag_and_a_foreign_recording(path: Path) -> None:
    own_bag(path)
    (path / "z.mcap").write_bytes(b"\x89MCAP0\r\n of another tool")


def a_bag_and_a_folder(path: Path) -> None:
    own_bag(path)
    (path / "x.mcap").mkdir()


def a_bag_with_foreign_metadata(path: Path) -> None:
    own_bag(path)
    (path / "metadata.yaml").write_text("apiVersion: v1\nkind: ConfigMap\n")


def a_recording_of_another_tool(path: Path) -> None:
    own_bag(path)
    file = path / f"{path.name}_0.mcap"
    file.write_bytes(file.read_bytes().replace(b"robot_energy", b"other_writer", 1))


def a_bag_with_a_link(path: Path) -> None:
    own_bag(path)
    file = path / f"{path.name}_0.mcap"
    file.rename(path.parent / "elsewhere.mcap")
    file.symlink_to("../elsewhere.mcap")


def a_link_to_a_bag(path: Path) -> None:
    own_bag(path.with_name("real"))
    path.symlink_to("real")


def a_file(path: Path) -> None:
    path.write_text("mine")


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


STRANGE = [
    three_recordings, a_bag_and_a_foreign_file, a_bag_and_a_foreign_recording,
    a_bag_and_a_folder, a_bag_with_foreign_metadata, a_recording_of_another_tool,
    a_bag_with_a_link, a_link_to_a_bag, a_file, a_pipe,
]  # fmt: skip


@pytest.mark.parametrize("make", STRANGE)
@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_that_is_not_ours_stays(
    place: Path, capsys: pytest.CaptureFixture[str], name: str, make: Callable[[Path], None]
) -> None:
    target = "there"
    if name == "excitation":
        if make in (a_file, a_pipe):
            target = "there/excitation_bag"
        (place / "there").mkdir()
        make(place / "there" / "excitation_bag")
    else:
        make(place / target)
    before = inventory(place)
    for overwrite in ({}, {"overwrite": ""}):
        text = refused(capsys, name, out="there", **overwrite)
        assert "give --overwrite" not in text  # it would not help
    assert inventory(place) == before


@pytest.mark.parametrize("name", [name for name in FOLDERS if COMMANDS[name].given])
def test_a_folder_that_holds_or_is_an_input_stays(
    place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    before = inventory(place)
    targets = [*COMMANDS[name].given, "."]
    if name == "replay":
        targets += ["bag/energy", "../place/bag", "bag/../bag"]
    for target in targets:
        refused(capsys, name, out=target, overwrite="")
    assert inventory(place) == before


def test_a_recording_in_the_folder_that_is_to_be_replaced_stays(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder is an own bag as a whole, and the input is its one file by another name."""
    os.link("bag/bag_0.mcap", "run.mcap")
    before = inventory(place)
    words = ["replay", "run.mcap", "--model", "wheel.yaml", "--out", "bag", "--overwrite"]
    assert main(words) == 2
    assert "the input" in capsys.readouterr().err
    assert inventory(place) == before


@pytest.mark.parametrize("name", WRITING)
def test_own_outputs_are_replaced(
    place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    options = outputs(name)
    assert run(name, **options) == 0
    before = inventory(place)
    if COMMANDS[name].folder:
        assert "give --overwrite" in refused(capsys, name, **options)
        assert inventory(place) == before
    assert run(name, **outputs(name, overwrite=True)) == 0
    assert inventory(place) == before  # equal input gives equal bytes


@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt()], ids=["full", "interrupt"])
@pytest.mark.parametrize("name", ["replay", "import csv"])
def test_an_end_at_any_step_leaves_all_as_it_was(
    place: Path, capsys: pytest.CaptureFixture[str], name: str, error: BaseException
) -> None:
    options = outputs(name)
    options.pop("plot", None)  # as slow as all the rest; the same writer
    older = {"replay": ["--fixed-friction", "80"], "import csv": ["--debug"]}[name]
    assert main([*COMMANDS[name].words.split(), *older,
                 *(word for option, value in options.items() for word in (f"--{option}", value))
                 ]) == 0  # fmt: skip
    before = inventory(place)
    options["overwrite"] = ""
    at, met, ends = 0, True, set()
    while met:
        at += 1
        with pytest.MonkeyPatch.context() as patch:
            disk = FaultyDisk(patch, error, at)
            code = run(name, **options)
            met = disk.met
        found = inventory(place)
        assert not [path for path in found if PREFIX in path]
        if code:
            ends.add(code)
            if isinstance(error, OSError):
                assert "No space left" in capsys.readouterr().err
        if found != before:  # all is in place, and what was there before is being removed
            assert found.keys() == before.keys()
            assert met or code == 0
            break
    assert ends == ({2} if isinstance(error, OSError) else {130})
    assert at > 10


@pytest.mark.parametrize("name", [*WRITING, "predict", "excitation"])
def test_a_full_disk_leaves_nothing_new(
    place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The last of the files cannot be put into place: none of them is."""
    before = inventory(place)
    with pytest.MonkeyPatch.context() as patch:
        disk = FaultyDisk(patch, FULL, 0, calls=("replace", "rename"))
        assert run(name, **outputs(name)) == 0
        last = disk.count
    for path in list(inventory(place)):
        if path not in before and (place / path).exists():
            shutil.rmtree(path) if (place / path).is_dir() else (place / path).unlink()
    capsys.readouterr()
    with pytest.MonkeyPatch.context() as patch:
        FaultyDisk(patch, FULL, last, calls=("replace", "rename"))
        assert "No space left" in refused(capsys, name, **outputs(name))
    assert inventory(place) == before


def test_one_file_for_two_outputs_is_refused(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own_bag(place / "there")
    before = inventory(place)
    text = refused(capsys, "replay", out="there", json="there/r.json", overwrite="")
    assert "lies in the bag" in text
    assert main(["replay", "bag", "--model", "wheel.yaml", "--json", "r.svg", "--plot",
                 "./r.svg"]) == 2  # fmt: skip
    assert inventory(place) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_signal_leaves_the_old_bag_and_a_kill_only_a_draft(
    place: Path, number: signal.Signals
) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(f"{number.name} is ignored here, as under nohup")
    import_log(wheel_csv(place / "short.csv", seconds=0.1), mapping(), place / "recording")
    before = inventory(place)
    words = "simulate --duration 100000 --out recording --overwrite".split()
    command = [sys.executable, "-m", "robot_energy", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as running:
        while not any(path.stat().st_size for path in place.glob(f"{PREFIX}*/*.mcap")):
            with suppress(subprocess.TimeoutExpired):
                running.wait(0.02)
            assert running.returncode is None
        running.send_signal(number)
        _, text = running.communicate()
    after = inventory(place)
    if number != signal.SIGKILL:
        assert running.returncode == 128 + number, text
        assert number.name.encode() in text
        assert after == before
        return
    assert [path for path in after if path not in before and PREFIX not in path] == []
    assert {path: after[path] for path in before} == before
    assert main(["simulate", "--duration", "0.05", "--out", "recording", "--overwrite"]) == 0
    assert not [path for path in inventory(place) if PREFIX in path]


def test_signals_that_are_ignored_stay_ignored(place: Path) -> None:
    code = (
        "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN);"
        "from robot_energy.cli.stopping import stoppable\n"
        "with stoppable(): signal.raise_signal(signal.SIGHUP)\n"
        "assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
