# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Finds parameter files that were given to a node and hold nothing for it.

ROS reads such a file without a word and leaves the node with its defaults: a wrong name
of the node in the file is one letter away.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, cast

import yaml

from robot_energy.foundation.files.regular_file import read_regular_text
from robot_energy.inputs.parameters import MAX_BYTES

OPTION = "--params-file"
KEY = "ros__parameters"


def files_without_section(arguments: Sequence[str], node_name: str) -> list[str]:
    """Return one sentence for every parameter file that has no section for a node.

    Files that cannot be read are left to ROS, which refuses them.

    Args:
        node_name: Full name of the node, such as ``/cell/energy_monitor``.
    """
    sentences: list[str] = []
    for option, path in pairwise(arguments):
        if option != OPTION:
            continue
        names = list(sections(path))
        if names and not any(matches(name, node_name) for name in names):
            sentences.append(
                f"the parameter file {path} holds nothing for {node_name}, only for "
                f"{', '.join(names)}; name its section {node_name} or /**"
            )
    return sentences


def sections(path: str) -> Iterator[str]:
    """Yield the full names of the nodes that a parameter file is for, wildcards as they are.

    Args:
        path: The file; one that cannot be read gives no names.
    """
    try:
        document = yaml.safe_load(read_regular_text(path, MAX_BYTES))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return
    yield from _walk(document, "")


def _walk(entry: Any, name: str) -> Iterator[str]:
    if not isinstance(entry, Mapping):
        return
    for key, value in cast("Mapping[Any, Any]", entry).items():
        if key == KEY:
            yield name or "/"
        else:
            yield from _walk(value, f"{name}/{str(key).strip('/')}")


def matches(pattern: str, node_name: str) -> bool:
    """Whether a section of a parameter file is for a node.

    Args:
        pattern: Full name; ``*`` stands for one part of it, ``**`` for any number.
    """
    parts = [
        "(/[^/]+)*" if part == "**" else "/[^/]+" if part == "*" else "/" + re.escape(part)
        for part in pattern.strip("/").split("/")
    ]
    return re.fullmatch("".join(parts), node_name) is not None
