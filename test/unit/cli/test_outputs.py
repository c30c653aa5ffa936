"""Every command that writes: what is foreign stays, and an end half-way leaves all as it was."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from itertools import cycle
from pathlib import Path

import pytest

from faulty_disk import FaultyDisk, inventory
from logbook import mapping, wheel_csv
from robot_energy.foundation.files.placement import PREFIX
from robot_energy_cli import main
from robot_energy_cli.main import Stopped, stoppable
from robot_energy_logs.log_import import import_log
from writing_commands import COMMANDS, FILES, SUFFIX, outputs, own_bag, refused, run

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
WRITING = ("replay", "simulate", "import csv", "import ur-rtde", "models check")  # in no time


def a_foreign_file(path: Path) -> None:
    path.write_text('{"mine": 1}\n')


def a_link(path: Path) -> None:
    path.with_name("target").write_text("mine")
    path.symlink_to("target")


def a_link_to_nothing(path: Path) -> None:
    path.symlink_to("nothing")


def a_folder(path: Path) -> None:
    path.mkdir()


STRANGE = (a_foreign_file, a_link, a_link_to_nothing, a_folder)
OUTPUTS = zip(
    FILES, cycle(STRANGE), strict=False
)  # each output with one of them, the first with all


@pytest.mark.parametrize(
    ("name", "option", "make"),
    [*((*one, make) for one, make in OUTPUTS), *((*FILES[0], make) for make in STRANGE[1:])],
)
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


@pytest.mark.parametrize(("name", "error"), [("replay", FULL), ("import csv", KeyboardInterrupt())])
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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_what_is_stoppable(number: signal.Signals) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(f"{number.name} is ignored here, as under nohup")
    with pytest.raises(Stopped) as caught, stoppable():
        signal.raise_signal(number)
    assert caught.value.number == number


def test_signals_that_are_ignored_stay_ignored(place: Path) -> None:
    code = (
        "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN);"
        "from robot_energy_cli.main import stoppable\n"
        "with stoppable(): signal.raise_signal(signal.SIGHUP)\n"
        "assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_modules_load_ends_as_one_later(
    place: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    """One of the first modules waits, and loses interrupts as exceptions."""
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(f"{number.name} is ignored here, as under nohup")
    (place / "early").mkdir()
    (place / "early/difflib.py").write_text(
        "import sys\n"
        "print('loads', flush=True)\n"
        "try:\n"
        "    sys.stdin.read()\n"
        "except KeyboardInterrupt:\n"
        "    pass\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(place / "early"), prepend=os.pathsep)
    command = [sys.executable, "-m", "robot_energy", "fleet", "run", "--help"]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, text=True, **pipes) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "loads\n"
        running.send_signal(number)
        _, said = running.communicate()
    assert running.returncode == 128 + number
    assert said == f"robot-energy: interrupted ({number.name})\n"
