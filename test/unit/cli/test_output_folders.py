"""Every command that writes a folder: one that is not its own, or holds an input, stays."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from faulty_disk import inventory
from robot_energy_cli import main
from writing_commands import COMMANDS, FOLDERS, own_bag, refused


def three_recordings(path: Path) -> None:
    """A folder of recordings that is not a bag."""
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


@pytest.mark.parametrize(
    ("name", "make"),
    [
        *((FOLDERS[0], make) for make in STRANGE),
        *zip(FOLDERS[1:], STRANGE, strict=False),
        *(("excitation", make) for make in (a_file, a_pipe)),
    ],
)
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
