# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Parameters of the energy recorder."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.inputs.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class RecorderParameters:
    """Parameters of the energy recorder."""

    folder: str = parameter(
        "Folder of the history; $ROS_HOME is ~/.ros where it is not set.",
        "$ROS_HOME/robot_energy/history",
    )
    robots: tuple[str, ...] = parameter(
        "Namespaces of the robots to record; empty records all whose energy/registers is found.",
        (),
    )
    autostart: bool = parameter(
        "Whether the node configures and activates itself; if not, a life cycle manager does.",
        True,
    )
    keep_minutes: float = parameter("How long minutes are kept [days].", 35.0, (1.0, 4000.0))
    keep_quarters: float = parameter(
        "How long quarter hours are kept; 0 for ever, as hours and days are [days].",
        0.0,
        (0.0, 4000.0),
    )
    min_free: int = parameter(
        "Free space to leave on the disk; nothing is written while there is less [MB].",
        200,
        (0, 1_000_000),
    )
    take_period: float = parameter(
        "Time from one processing of waiting messages to the next [s].", 20.0, (0.1, 30.0)
    )
    write_period: float = parameter(
        "Time from one write to the history to the next [s].", 60.0, (1.0, 900.0)
    )
    look_period: float = parameter(
        "Time from one search for robots and job intervals to the next [s].", 20.0, (1.0, 900.0)
    )
