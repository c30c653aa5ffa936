# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Parameters of the exporter node: its own, and a group for each kind of the table."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import Any

from robot_energy.inputs.parameters import group, parameter
from ros2_energy_monitor.exporters.kinds import EXPORTERS


@dataclass(frozen=True, kw_only=True)
class ExporterBase:
    """Parameters that all exporters share."""

    exporters: tuple[str, ...] = parameter(
        "Exporters to run: mqtt, opcua, or both; each has a group of parameters.", ("mqtt",)
    )
    robot_name: str = parameter("Name of the robot in topics and nodes.", "robot")
    stale_after: float = parameter(
        "Age from which the newest message is no longer exported as current [s].",
        5.0,
        (0.5, 3600.0),
    )


def exporter_parameters() -> type[Any]:
    """Return the dataclass of the parameters, for the kinds that the table has now."""
    groups = [(kind.name, kind.parameters, group(kind.parameters)) for kind in EXPORTERS.values()]
    return make_dataclass(
        "ExporterParameters", groups, bases=(ExporterBase,), frozen=True, kw_only=True
    )
