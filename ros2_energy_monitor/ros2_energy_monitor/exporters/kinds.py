# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Table of the exporters, and parameters of the node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, make_dataclass
from typing import Any

from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy.inputs.parameters import group, parameter
from ros2_energy_monitor.exporters.mqtt import MqttExporter, MqttParameters
from ros2_energy_monitor.exporters.opcua import OpcUaExporter, OpcUaParameters
from ros2_energy_monitor.exporters.values import Exporter


@dataclass(frozen=True, kw_only=True)
class ExporterKind(Kind):
    """One kind of exporter; its name is also that of its group of parameters.

    Attributes:
        make: Makes it of its parameters and the name of the robot.
    """

    parameters: type[Any]
    make: Callable[[Any, str], Exporter]


EXPORTERS = Kinds(
    "exporter",
    ExporterKind(
        name="mqtt",
        label="MQTT",
        line="plain JSON, with discovery for Home Assistant",
        parameters=MqttParameters,
        make=MqttExporter,
    ),
    ExporterKind(
        name="opcua",
        label="OPC UA",
        line="a server with the variables of OPC 34100, profile E1, and imported energy",
        parameters=OpcUaParameters,
        make=OpcUaExporter,
    ),
)


@dataclass(frozen=True, kw_only=True)
class ExporterBase:
    """Parameters that all exporters share."""

    exporters: tuple[str, ...] = parameter(
        "Exporters to run: mqtt, opcua, or both; each has a group of parameters.", ("mqtt",)
    )
    robot_name: str = parameter("Name of the robot in topics and nodes.", "robot")
    stale_after: float = parameter(
        "Age from which the newest message is not exported as current [s].",
        5.0,
        (0.5, 3600.0),
    )


def exporter_parameters() -> type[Any]:
    """Return the dataclass of the parameters, for the kinds that the table has now."""
    groups = [(kind.name, kind.parameters, group(kind.parameters)) for kind in EXPORTERS.values()]
    return make_dataclass(
        "ExporterParameters", groups, bases=(ExporterBase,), frozen=True, kw_only=True
    )
