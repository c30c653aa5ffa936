# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Definitions of messages as they are installed, for types that are unknown to the library."""

from __future__ import annotations

import re
from typing import Any

from ros2_energy_monitor.base import message_classes as interfaces

PLAIN = {"double": "float64", "float": "float32", "boolean": "bool", "octet": "byte"}
SEQUENCE = re.compile(r"sequence<(?P<item>.+?)(?:, (?P<most>\d+))?>")
ARRAY = re.compile(r"(?P<item>.+)\[(?P<size>\d+)\]")
BOUNDED = re.compile(r"(?P<kind>w?string)<(?P<most>\d+)>")


def definitions_of(message_class: type[Any]) -> dict[str, tuple[str, str]]:
    """Return encoding and text of a message, and of all it is made of, by type.

    Args:
        message_class: Class of the message, such as ``std_msgs.msg.Header``.
    """
    found: dict[str, tuple[str, str]] = {}
    _add(message_class, found)
    return found


def _add(message_class: type[Any], found: dict[str, tuple[str, str]]) -> None:
    package = message_class.__module__.split(".")[0]
    name = f"{package}/msg/{message_class.__name__}"
    if name in found:
        return
    lines: list[str] = []
    found[name] = ("ros2msg", "")
    for field, kind in message_class.get_fields_and_field_types().items():
        item, suffix = _item(kind)
        if "/" in item:
            inner, _, inner_name = item.partition("/")
            _add(interfaces.message_class(f"{inner}/msg/{inner_name}"), found)
        lines.append(f"{PLAIN.get(item, item)}{suffix} {field}")
    found[name] = ("ros2msg", "\n".join(lines) + "\n")


def _item(kind: str) -> tuple[str, str]:
    """Split a type into what one element is and how many there are."""
    suffix = ""
    if (match := SEQUENCE.fullmatch(kind)) is not None:
        most = match["most"]
        kind, suffix = match["item"], f"[<={most}]" if most else "[]"
    elif (match := ARRAY.fullmatch(kind)) is not None:
        kind, suffix = match["item"], f"[{match['size']}]"
    if (match := BOUNDED.fullmatch(kind)) is not None:
        kind, suffix = match["kind"], f"<={match['most']}{suffix}"
    return kind, suffix
