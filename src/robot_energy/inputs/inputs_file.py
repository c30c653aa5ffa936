"""Read the inputs of a replay from the parameter file of a node.

The same file then says, live and in replay, which topics are read and what they mean.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from robot_energy.foundation.config_file import parse_yaml, read_text
from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.parameters import MAX_BYTES, Parameter, assemble
from robot_energy.inputs.sources import Inputs
from robot_energy.presets import ROBOTS, RobotPreset

MISSPELT = 0.85  # likeness of two names above which one is a misspelling of the other
ROS_PARAMETERS = "ros__parameters"


def read_inputs(path: str | Path, robot: RobotPreset | None = None) -> tuple[Inputs, list[str]]:
    """Return the inputs of a file or of a robot in `ROBOTS`, and sentences on misspellings.

    Entries of all nodes in the file count, under their names or under ``/**``; parameters
    that are about no input (rates, the model) are left out.
    """
    if str(path) in ROBOTS and not Path(path).is_file():
        path = ROBOTS[str(path)].inputs
    owner = str(path)
    given = (_values(robot.inputs) if robot is not None else {}) | _values(path)
    asked: list[str] = []

    def value_of(entry: Parameter) -> Any:
        asked.append(entry.name)
        value = given.get(entry.name, entry.default)
        return entry.check([] if value is None else value, owner)

    inputs = assemble(Inputs, value_of, owner)
    return inputs, list(_misspelt(given, asked, owner))


def _values(path: str | Path) -> dict[str, Any]:
    """All parameters by their full names."""
    given: dict[str, Any] = {}
    for node, values in _nodes(path).items():
        for name, value in _flat(values, ""):
            if name in given and given[name] != value:
                raise ParameterError(
                    f"{path} sets {name} to {given[name]!r}, and for {node} to {value!r}",
                    "one value, as a replay is one node",
                )
            given[name] = value
    return given


def _nodes(path: str | Path) -> dict[str, Mapping[str, Any]]:
    """Parameters by node, as they stand in the file."""
    text = read_text(path, ParameterError, "parameter file", MAX_BYTES)
    document = parse_yaml(text, str(path), ParameterError)
    entries = cast("dict[Any, Any]", document) if isinstance(document, dict) else {}
    nodes = {
        str(node): cast("Mapping[str, Any]", entry[ROS_PARAMETERS])
        for node, entry in entries.items()
        if isinstance(entry, dict) and isinstance(entry.get(ROS_PARAMETERS), dict)  # pyright: ignore
    }
    if not nodes:
        raise ParameterError(
            f"{path} holds no ROS parameters",
            f"the parameter file of a node: its name or /**, below it {ROS_PARAMETERS}",
            f"put the lines '/**:' and, indented, '{ROS_PARAMETERS}:' first, and indent the rest",
        )
    return nodes


def _flat(values: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(cast("Mapping[str, Any]", value), f"{prefix}{name}.")
        else:
            yield prefix + str(name), value


def _misspelt(given: Mapping[str, Any], asked: list[str], owner: str) -> Iterator[str]:
    """Names that no input has, but that look like one or lie in a group of one."""
    groups = {name.partition(".")[0] for name in asked if "." in name}
    for name in given:
        if name in asked:
            continue
        near = difflib.get_close_matches(name, asked, n=1, cutoff=MISSPELT)
        if near:
            yield f"{owner}: no input has '{name}'; did you mean '{near[0]}'?"
        elif name.partition(".")[0] in groups:
            yield f"{owner}: no input has '{name}'"
