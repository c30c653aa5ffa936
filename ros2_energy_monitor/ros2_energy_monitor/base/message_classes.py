# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Classes of message types that are named by bags, parameters and topics.

Python would import whatever a name says, from the working folder first. So a name is matched
against the grammar of interface names, looked up in the ament index, which lists every interface
that is installed, and its package is loaded from the prefix that the index gives, or not at all.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from ament_index_python import get_resource

from robot_energy.foundation.errors import MessageTypeError
from robot_energy.foundation.shown_text import shown

NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
MAX_NAME = 255  # characters, as much as any file name can have
INDEX = "rosidl_interfaces"


def message_class(msgtype: str) -> type[Any]:
    """Return the class of an installed message type.

    Args:
        msgtype: Its name, such as ``sensor_msgs/msg/JointState``.
    """
    match = NAME.fullmatch(msgtype) if len(msgtype) <= MAX_NAME else None
    if match is None:
        raise MessageTypeError(
            f"'{shown(msgtype)}' is not a message type", "a name such as sensor_msgs/msg/JointState"
        )
    package, short = match.groups()
    try:
        interfaces, prefix = get_resource(INDEX, package)
    except (LookupError, OSError):
        interfaces, prefix = "", ""
    if f"msg/{short}.idl" not in interfaces.split():
        raise MessageTypeError(
            f"the message type {msgtype} is not installed",
            remedy=f"install ros-jazzy-{package.replace('_', '-')} or leave it out",
        )
    return getattr(_module(package, Path(prefix)), short)


def _module(package: str, prefix: Path) -> ModuleType:
    """The Python module of the messages of a package that lies in a prefix."""
    root = prefix.resolve()
    if package not in sys.modules:
        folders = [folder for folder in sys.path if folder and _within(folder, root)]
        spec = PathFinder.find_spec(package, folders)
        if spec is not None and spec.loader is not None:
            sys.modules[package] = module = importlib.util.module_from_spec(spec)
            try:
                spec.loader.exec_module(module)
            except BaseException:
                del sys.modules[package]
                raise
    found = sys.modules.get(package)
    path = getattr(found, "__file__", None)
    if path is None or not (_within(path, prefix.absolute()) or _within(path, root)):
        raise MessageTypeError(
            f"Python has {path or 'no module'} for the messages of {package}",
            f"the package in {prefix}",
            "start in another folder, or take the other module out of PYTHONPATH",
        )
    return importlib.import_module(f"{package}.msg")


def _within(path: str, folder: Path) -> bool:
    """Whether a path lies in a folder, by its name or where it leads."""
    return folder in Path(path).absolute().parents or folder in Path(path).resolve().parents
