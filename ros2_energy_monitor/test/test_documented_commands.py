# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The ROS commands of the documents: executable, launch argument, parameter, service exist."""

from __future__ import annotations

import argparse
import contextlib
import re
import runpy
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import yaml

from ros2_energy_monitor.executables import EXECUTABLES

PACKAGE = Path(__file__).resolve().parent.parent
ROOT = PACKAGE.parent
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "src/doc").rglob("*.md"))]
NODES = [path.stem for path in (PACKAGE / "config").glob("*.yaml")]  # every node has one
START = r"(?:ros2 (?:run|launch|service|lifecycle) |python -m ros2_energy_monitor )"
COMMAND = re.compile(rf"`({START}[^`]+)`|^({START}.+)$", re.MULTILINE)


def commands() -> list[str]:
    """Every ROS command of the documents, in code spans and on lines of their own."""
    found: dict[str, None] = {}
    for path in DOCUMENTS:
        text = path.read_text().replace("\\\n", " ")
        found |= dict.fromkeys(a or b for a, b in COMMAND.findall(text))
    return [one for one in found if " ..." not in one]


def launch_arguments(file: str) -> set[str]:
    """Names that a launch file declares, read without the launch system."""
    text = (PACKAGE / "launch" / file).read_text()
    listed = re.search(r"^ARGUMENTS = \{.*?^\}", text, re.MULTILINE | re.DOTALL)
    if listed:
        return set(re.findall(r'^    "(\w+)":', listed.group(), re.MULTILINE))
    return set(re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text))


def parameters_of(node: str) -> set[str]:
    """Full names of the parameters of a node; its configuration holds them all."""
    document = yaml.safe_load((PACKAGE / "config" / f"{node}.yaml").read_text())

    def flat(values: dict, prefix: str = "") -> set[str]:
        names = set()
        for key, value in values.items():
            is_group = isinstance(value, dict)
            names |= flat(value, f"{prefix}{key}.") if is_group else {prefix + key}
        return names

    return flat(document["/**"]["ros__parameters"])


def check_launch(words: list[str]) -> None:
    package, file, *given = words
    if package == "ros2_energy_monitor":
        names = {one.split(":=")[0] for one in given if one != "--show-args"}
        assert names <= launch_arguments(file)


def check_executable(name: str, words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters are those of the node; the rest is what its own parser takes."""
    assert name in EXECUTABLES
    own, _, ros = " ".join(words).partition("--ros-args")
    given = re.findall(r"(?:-p|--param) (\S+?):=", ros)
    assert set(given) <= (parameters_of(name) if given else set())
    if name in NODES:
        assert not own.strip(), f"{name} takes parameters, not {own}"
        return
    parsed: list[argparse.Namespace] = []
    parse = argparse.ArgumentParser.parse_args

    def stop(self, *_):
        parsed.append(parse(self, shlex.split(own)))
        raise StopIteration

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    with contextlib.suppress(StopIteration):
        import_module(EXECUTABLES[name]).main()
    assert parsed


def check_service(words: list[str]) -> None:
    name, kind, request = words
    node, service = name.strip("/").split("/")
    assert node in {*NODES, "player"}
    folder = PACKAGE / "ros2_energy_monitor"
    sources = [*(folder / "services").glob("*.py"), folder / "base/playback_clock.py"]
    assert any(f'"{service}"' in text or f'"~/{service}"' in text
               for text in (path.read_text() for path in sources))  # fmt: skip
    package, _, type_name = kind.split("/")
    fields = getattr(
        import_module(f"{package}.srv"), type_name
    ).Request.get_fields_and_field_types()
    assert set(yaml.safe_load(request)) <= set(fields)


@pytest.mark.parametrize("command", commands())
def test_a_documented_command_names_what_exists(command, monkeypatch):
    words = shlex.split(command)
    match words[:3]:
        case ["ros2", "launch", _]:
            check_launch(words[2:])
        case ["ros2", "run", package]:
            assert package == "ros2_energy_monitor"
            check_executable(words[3], words[4:], monkeypatch)
        case ["python", "-m", _]:
            check_executable(words[3], words[4:], monkeypatch)
        case ["ros2", "service", "call"]:
            check_service(words[3:])
        case ["ros2", "lifecycle", "set"]:
            assert words[3].strip("/") in NODES
            assert words[4] in ("configure", "activate", "deactivate", "cleanup", "shutdown")
        case _:
            pytest.fail(f"unknown kind of command: {command}")


def test_commands_of_every_kind_are_found():
    found = commands()
    for start in ("ros2 launch", "ros2 run", "ros2 service call", "python -m ros2_energy_monitor"):
        assert any(one.startswith(start) for one in found), start


@pytest.mark.parametrize(
    "wrong",
    [
        "ros2 launch ros2_energy_monitor energy_monitor.launch.py modell:=kr16",
        "python -m ros2_energy_monitor energy_monitr",
        "python -m ros2_energy_monitor energy_monitor --ros-args -p effort:=none",
        "python -m ros2_energy_monitor console --fast",
        "ros2 service call /energy_monitor/reset ros2_energy_msgs/srv/ResetRegisters '{}'",
    ],
)
def test_a_wrong_command_would_be_noticed(wrong, monkeypatch):
    with pytest.raises(AssertionError):
        test_a_documented_command_names_what_exists(wrong, monkeypatch)


@pytest.mark.parametrize("arguments", [[], ["energy_monitr"]])
def test_an_unknown_executable_ends_with_the_list(arguments):
    done = subprocess.run(
        [sys.executable, "-m", "ros2_energy_monitor", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert all(name in done.stderr for name in EXECUTABLES)
    assert not done.stdout


@pytest.mark.parametrize("name", EXECUTABLES)
def test_every_executable_has_a_main(name):
    assert callable(import_module(EXECUTABLES[name]).main)


def test_a_known_executable_gets_its_own_arguments(monkeypatch):
    module = import_module(EXECUTABLES["player"])
    seen: list[list[str]] = []
    monkeypatch.setattr(module, "main", lambda: seen.append(sys.argv[:]) or 3)
    monkeypatch.setattr(sys, "argv", ["ros2_energy_monitor", "player", "bag", "--rate", "5"])
    # Another test may have imported it, which runpy warns of.
    monkeypatch.delitem(sys.modules, "ros2_energy_monitor.__main__", raising=False)
    with pytest.raises(SystemExit) as caught:
        runpy.run_module("ros2_energy_monitor", run_name="__main__")
    assert caught.value.code == 3
    assert seen == [["player", "bag", "--rate", "5"]]
