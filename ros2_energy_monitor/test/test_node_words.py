# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""A node speaks of its parameters, not of the options that the command `robot-energy` has."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from robot_energy_identify.check.finding import OF_THE_COMMAND
from ros2_energy_monitor.executables import EXECUTABLES

LOADED = """
import importlib, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
for name, module in sorted(sys.modules.items()):
    if name.startswith("robot_energy"):
        print(name, module.__file__)
"""
NODES = ("torque_monitor", "friction_monitor", "power_monitor", "energy_monitor")
OPTION = re.compile(r"(?<![\w-])--[a-z]")
# What reads bags and writes files for the command, what is said of such files, and the options of
# `replay`, which the check of a model loads with it. Of an option that is a parameter as well, a
# node takes the sentence and the choices, not what its absence means.
OF_RECORDINGS = (
    *("robot_energy.replay.options", "robot_energy.inputs.options"),
    *("robot_energy.bag.", "robot_energy.foundation.files.", "robot_energy.inputs.bag_topics"),
    *("robot_energy.replay.read_ahead", "robot_energy.replay.setup"),
)
COMMAND = re.compile(r"(^|`)[^`]*`")  # a whole command is one whoever reads the sentence


def texts(path: Path) -> Iterator[str]:
    """All texts of a module but its docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    statements = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) not in statements:
                yield node.value


def test_what_nodes_load_names_no_option_of_the_command(child_environment):
    names = [*(EXECUTABLES[node] for node in NODES), "robot_energy_identify.check.process"]
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *names],
        env=child_environment, capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    loaded = dict(line.split(maxsplit=1) for line in done.stdout.splitlines())
    assert "robot_energy_identify.check.torque" in loaded
    assert "robot_energy.pipeline.energy_pipeline" in loaded
    found = {
        name: text
        for name, path in loaded.items()
        if path.endswith(".py") and not name.startswith(OF_RECORDINGS)
        for text in texts(Path(path))
        if OPTION.search(OF_THE_COMMAND.sub("", COMMAND.sub("", text)))
    }
    assert found == {}
