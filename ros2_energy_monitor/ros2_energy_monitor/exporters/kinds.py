"""Table of the exporters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from robot_energy.kinds import Kind, Kinds
from ros2_energy_monitor.exporters.exporter import Exporter
from ros2_energy_monitor.exporters.mqtt import MqttExporter, MqttParameters
from ros2_energy_monitor.exporters.opcua import OpcUaExporter, OpcUaParameters


@dataclass(frozen=True, kw_only=True)
class ExporterKind(Kind):
    """One kind of exporter; its name is also that of its group of parameters.

    Attributes:
        parameters: Dataclass of its parameters.
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
