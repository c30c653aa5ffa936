# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Declares parameters at a node, with type, range and meaning, and reads them again."""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Collection, Mapping
from dataclasses import MISSING, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.shown_text import shown_lines
from robot_energy.inputs.parameters import Parameter, assemble
from ros2_energy_monitor.base.parameter_files import files_without_section

TYPES: dict[Any, RosParameter.Type] = {
    bool: RosParameter.Type.BOOL,
    int: RosParameter.Type.INTEGER,
    float: RosParameter.Type.DOUBLE,
    str: RosParameter.Type.STRING,
    tuple[str, ...]: RosParameter.Type.STRING_ARRAY,
    tuple[float, ...]: RosParameter.Type.DOUBLE_ARRAY,
}
ROS_HOME = "$ROS_HOME"
NO_FOLDER = "none"  # `ros2 launch` cannot give an empty argument
# Overrides that rclpy itself declares or reads.
OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides")

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")


def declare(node: Node, cls: type[P], fixed: Collection[str] | None = None) -> P:
    """Return the values of the parameters of a node, declared here.

    Unknown overrides are logged as a warning, with the name that was probably meant, and so
    are parameter files without a section for the node. Where the class has the parameter
    ``strict_parameters`` and it is true, they are refused instead. With ``autostart`` false a
    required text may be missing: it is empty then, and `require` refuses it.

    Args:
        fixed: Parameters that are read-only; None for all.
    """
    complaints = files_without_section(sys.argv, node.get_fully_qualified_name())
    for sentence in complaints:  # at once: it may be why a parameter is missing
        node.get_logger().warning(shown_lines(sentence))
    given = cast("dict[str, RosParameter]", getattr(node, "_parameter_overrides", {}))
    autostart = given.get("autostart") if hasattr(cls, "autostart") else None
    later = autostart is not None and autostart.value is False
    names: list[str] = []

    def value_of(entry: Parameter) -> Any:
        names.append(entry.name)
        if later and entry.default is MISSING and entry.kind is str:
            entry = replace(entry, default="")
        return _declare_one(node, entry, given, read_only=fixed is None or entry.name in fixed)

    values = assemble(cls, value_of, node.get_name())
    unknown = _unknown(node, given, names)
    if getattr(values, "strict_parameters", False) and (complaints or unknown):
        raise ParameterError([*complaints, *unknown][0])
    for sentence in unknown:
        node.get_logger().warning(shown_lines(sentence))
    return values


def parameter_lines(node: Node) -> list[str]:
    """Return every parameter of a node with its value, one line for each group."""
    declared = cast("dict[str, RosParameter]", node.get_parameters_by_prefix(""))
    groups: dict[str, list[str]] = {}
    for name in sorted(declared):
        groups.setdefault(name.rpartition(".")[0], []).append(f"{name} {declared[name].value!r}")
    return [shown_lines(", ".join(entries)) for entries in groups.values()]


def _declare_one(
    node: Node, entry: Parameter, given: dict[str, RosParameter], *, read_only: bool
) -> Any:
    name, override = entry.name, given.get(entry.name)
    if entry.kind is float and override is not None and override.type_ == TYPES[int]:
        given[name] = RosParameter(name, value=float(cast(int, override.value)))  # 50 for 50.0
    if entry.kind == tuple[float, ...] and override is not None:
        if override.type_ == RosParameter.Type.INTEGER_ARRAY:  # [1, -1] for [1.0, -1.0]
            numbers = [float(value) for value in cast("list[int]", override.value)]
            given[name] = RosParameter(name, value=numbers)
    if entry.kind == tuple[str, ...] and override is not None and not override.value:
        given[name] = RosParameter(name, value=[""])  # an empty list has no type
    try:
        node.declare_parameter(name, _start(entry), _descriptor(entry, read_only=read_only))
        value: Any = node.get_parameter(name).value
    except ParameterUninitializedException:
        raise _missing(node, entry) from None
    except (InvalidParameterTypeException, InvalidParameterValueException):
        value = given[name].value if name in given else None
        if value is False and "off" in entry.choices:  # YAML reads the word off as false
            node.declare_parameter(name, "off", _descriptor(entry, read_only=read_only), True)
            return "off"
        raise ParameterError(
            f"parameter '{name}' of {node.get_name()} is {value!r}", entry.expected
        ) from None
    if entry.default is MISSING and value in (None, ""):
        raise _missing(node, entry)
    return entry.check([] if value is None else value, node.get_name())


def require(node: Node, entries: Mapping[str, Parameter]) -> None:
    """Refuse required parameters that are still empty."""
    for entry in entries.values():
        if entry.default is MISSING and not node.get_parameter(entry.name).value:
            raise _missing(node, entry)


def _missing(node: Node, entry: Parameter) -> ParameterError:
    return ParameterError(
        f"{node.get_name()} was started without its parameter '{entry.name}'",
        f"{entry.expected}: {entry.description.rstrip('.')}",
        f"add it to the parameter file or start with --ros-args -p {entry.name}:=VALUE",
    )


def reread(node: Node, cls: type[P]) -> tuple[P, dict[str, Parameter]]:
    """Return the values that the parameters of a node have now, those of new groups declared."""
    given = cast("dict[str, RosParameter]", getattr(node, "_parameter_overrides", {}))
    entries: dict[str, Parameter] = {}

    def value_of(entry: Parameter) -> Any:
        entries[entry.name] = entry
        if not node.has_parameter(entry.name):
            return _declare_one(node, entry, given, read_only=False)
        value: Any = node.get_parameter(entry.name).value
        return entry.check([] if value is None else value, node.get_name())

    return assemble(cls, value_of, node.get_name()), entries


def _start(entry: Parameter) -> Any:
    """What to declare: the default in the type of a ROS parameter, or its type alone."""
    if entry.default is MISSING:
        return TYPES[entry.kind]
    if isinstance(entry.default, tuple):
        return list(cast("tuple[str, ...]", entry.default)) or [""]
    return entry.default


def _descriptor(entry: Parameter, *, read_only: bool) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=entry.name,
        description=entry.description,
        additional_constraints="one of " + ", ".join(entry.choices) if entry.choices else "",
        read_only=read_only,
    )
    if entry.bounds is not None and entry.kind is float:
        low, high = map(float, entry.bounds)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif entry.bounds is not None:
        low, high = map(int, entry.bounds)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return descriptor


def _unknown(node: Node, given: dict[str, RosParameter], names: list[str]) -> list[str]:
    """Return one sentence for each value that was given to no parameter."""
    sentences: list[str] = []
    for name in given:
        if name in names or name.split(".")[0] in OF_RCLPY:
            continue
        near = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"it has {', '.join(names)}"
        sentences.append(f"{node.get_name()} has no parameter '{name}'; {hint}")
    return sentences


def folder_of(parameter: str) -> Path | None:
    """Return the folder that a parameter names.

    Args:
        parameter: A path; ``$ROS_HOME`` at its beginning stands for that variable, or for
            ``~/.ros`` where it is not set. ``none`` for no folder, as empty.

    Raises:
        ParameterError: If it names a variable that is not set.
    """
    if parameter in ("", NO_FOLDER):
        return None
    home = os.environ.get("ROS_HOME") or "~/.ros"
    if parameter == ROS_HOME or parameter.startswith(f"{ROS_HOME}/"):
        parameter = home + parameter[len(ROS_HOME) :]
    path = os.path.expandvars(parameter)
    if "$" in path:
        raise ParameterError(f"the folder '{path}' names a variable that is not set", "a path")
    return Path(path).expanduser()
