"""Names of inputs and outputs on the command line: nothing foreign changes, whatever they are."""

import contextlib
import functools
import io
import json
import os
import shutil
from pathlib import Path

from target import scratch

import robots
from faulty_disk import inventory
from logbook import WHEEL_MAPPING, wheel_bag
from robot_energy.bag import BagWriter
from robot_energy.foundation.files import output_files
from robot_energy.foundation.files.placement import PREFIX
from robot_energy.model import save
from robot_energy_cli import main

OWN = ("own_bag", "own.json", "own.svg", "own.yaml", "empty")  # may be replaced, as wholes
NAMES = (
    "new", "new.json", "new.svg", "new.png", "no/new", "deep/new", *OWN, "own_bag/x.json",
    "bag", "bag/bag_0.mcap", "bag/new", "./bag/../bag", "round/bag", "twin.mcap", "wheel.yaml",
    "wheel.csv", "map.yaml", "deep", "days", "days/mon.mcap", "days/metadata.yaml", "mixed",
    "foreign.json", "foreign.svg", "link.json", "link_bag", "dead.svg", "",
    ".", "own_bag/", "/dev/null", "/dev/full", "/dev/fd/999", "-", "n" * 300, "d/" * 3000,
)  # fmt: skip
NO_INPUTS = ("/dev/full", "-")  # what only an output may be
COMMANDS = (
    (("replay",), ("--model",), ("--json", "--plot", "--out")),
    (("import", "csv"), ("--mapping",), ("--out",)),
    (("models", "check"), (), ("--json",)),
)
GIVEN = (("bag", "wheel.yaml"), ("wheel.csv", "map.yaml"), ("wheel.yaml",))
DONE, REFUSED, DAMAGED = 0, 2, 3


def file_arguments(data: bytes) -> bool:
    """Run a command with any names; what it refuses leaves all as it was."""
    folder = scratch() / "place"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(_sandbox(), folder, symlinks=True, copy_function=_copy)
    os.link(folder / "bag" / "bag_0.mcap", folder / "twin.mcap")
    before = inventory(folder)
    words = _words(data, folder)
    with (
        contextlib.chdir(folder),  # a name such as "-" is a place here
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as said,
    ):
        code = main(words)
    after = inventory(folder)
    assert code in (DONE, REFUSED, DAMAGED), (words, said.getvalue())
    assert not [name for name in after if PREFIX in name], words
    if code == REFUSED:
        assert after == before, words
        assert said.getvalue().isprintable() or said.getvalue().count("\n") >= 1
    for name, content in before.items():
        if name.split("/")[0] not in OWN:
            assert after.get(name) == content, (words, name)
    return code != REFUSED


def file_seeds() -> list[bytes]:
    """Each command with outputs in new places, and over own files."""
    new = [NAMES.index(name) for name in ("new.json", "new.svg", "new")]
    own = [NAMES.index(name) for name in ("own.json", "own.svg", "own_bag")]
    return [
        bytes([0, 1, 200, 200, *own]),
        bytes([0, 0, 200, 200, *new]),
        bytes([1, 0, 200, 200, new[2]]),
        bytes([2, 0, 200, new[0]]),
    ]


def _words(data: bytes, folder: Path) -> list[str]:
    """A command line: command, overwrite, then a name for each input and output."""
    rest = iter(data)
    index = next(rest, 0) % len(COMMANDS)
    command, inputs, outputs = COMMANDS[index]
    overwrite = next(rest, 0) % 2
    words = list(command)
    for option, default in zip(("", *inputs), GIVEN[index], strict=True):
        number = next(rest, 255)
        name = default if number >= len(NAMES) else NAMES[number]
        words += [option] if option else []
        words.append(_path(folder, default if name in NO_INPUTS else name))
    for option in outputs:
        number = next(rest, 255)
        if number < len(NAMES):
            words += [option, _path(folder, NAMES[number])]
        elif number == 254:  # a name of its own
            name = os.fsdecode(bytes(rest))
            words += [option, _path(folder, "new" if ".." in name else f"x{name}")]
    if overwrite and "--out" in outputs:
        words.append("--overwrite")
    return words


def _path(folder: Path, name: str) -> str:
    return name if name in ("-", "") or name.startswith("/dev/") else f"{folder}/{name}"


def _copy(source: str, target: str) -> None:
    shutil.copyfile(source, target, follow_symlinks=False)


@functools.cache
def _sandbox() -> Path:
    """Inputs, own and foreign files, links."""
    folder = scratch() / "sandbox"
    (folder / "deep").mkdir(parents=True)
    wheel_bag(folder, seconds=0.5)
    save(robots.one_wheel(), folder / "wheel.yaml")
    (folder / "map.yaml").write_text(json.dumps(WHEEL_MAPPING))
    _bag(folder / "own_bag")
    (folder / "own.json").write_bytes(output_files.json_bytes({}))
    (folder / "own.yaml").write_text(output_files.COMMENT)
    (folder / "own.svg").write_bytes(
        output_files.PICTURE[1].start + output_files.PICTURE[1].mark + b"</svg>"
    )
    (folder / "empty").touch()
    _bag(folder / "days")
    (folder / "days" / "days_0.mcap").rename(folder / "days" / "mon.mcap")
    (folder / "days" / "metadata.yaml").write_text("apiVersion: v1\n")
    _bag(folder / "mixed")
    (folder / "mixed" / "thesis.tex").write_text("dear")
    (folder / "foreign.json").write_text("{}")
    (folder / "foreign.svg").write_text("<svg/>")
    for name, target in (("link.json", "own.json"), ("link_bag", "own_bag"), ("dead.svg", "none"),
                         ("round", ".")):  # fmt: skip
        (folder / name).symlink_to(target)
    return folder


def _bag(path: Path) -> None:
    with BagWriter(path) as bag:
        bag.add_topic("/a", "std_msgs/msg/Float64")
