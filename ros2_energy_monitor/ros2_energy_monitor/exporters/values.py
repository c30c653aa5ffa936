# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What is exported, for every exporter alike: names, units, values, the newest messages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.units import ENERGY_UNITS, SECOND_NS
from robot_energy.results.base import known
from robot_energy.timeline.blocks import Phase
from ros2_energy_monitor.diagnostics.reporter import StatusBuilder

MAX_JOINTS = 32  # that an exporter lists one by one


class Topic(Enum):
    """The messages that values are of."""

    POWER = "power"
    REGISTERS = "registers"


class ExportedValue(Described):
    """One number."""

    name: Annotated[str, "As a key; also the name of the field of the message, less its unit."]
    title: str
    topic: Topic
    unit: str
    field: str
    rises: Annotated[bool, "Whether it never falls but by a reset."] = False
    size: Annotated[
        float, "One of its unit, in that of the field; a division, so that 7.2 MJ are 2 kWh. [-]"
    ] = 1.0


def _power(field: str, title: str) -> ExportedValue:
    return ExportedValue(field, title, Topic.POWER, "W", field)


def _energy(field: str, title: str, rises: bool) -> ExportedValue:
    size = ENERGY_UNITS["kWh"]
    return ExportedValue(f"{field}_kwh", title, Topic.REGISTERS, "kWh", field, rises, size)


VALUES = (
    _power("predicted_grid_power", "Grid power, predicted"),
    _power("measured_power", "Power, measured"),
    _power("predicted_power_at_meter", "Power at the meter, predicted"),
    _power("residual_power", "Predicted minus measured power"),
    _power("friction_power", "Friction, predicted"),
    _power("drive_loss", "Loss of the drives, predicted"),
    _power("brake_power", "Brake resistor, predicted"),
    _power("returned_power", "Power fed back, predicted"),
    _energy("predicted_import_energy", "Energy from the grid, predicted", True),
    _energy("predicted_return_energy", "Energy fed back, predicted", True),
    _energy("brake_energy", "Energy of the brake resistor, predicted", True),
    _energy("measured_energy", "Energy, measured", False),  # a meter may run backwards
    _energy("predicted_energy_at_meter", "Energy at the meter, predicted", False),
    ExportedValue("observed_time", "Observed time", Topic.REGISTERS, "s", "observed_time", True),
    ExportedValue("gap_time", "Time of gaps", Topic.REGISTERS, "s", "gap_time", True),
    _power("predicted_power_lower", "Grid power, lower end of the 90 % band"),
    _power("predicted_power_upper", "Grid power, upper end of the 90 % band"),
    _energy("predicted_energy_band", "Energy from the grid, half of the 90 % band", False),
    _power("outlet_power", "Power from the outlet, with the loads outside of the cabinet"),
    _energy("outlet_energy", "Energy from the outlet while all loads are known", False),
)


def exported(message: Any, topic: Topic) -> dict[str, Any]:
    """Return all values of a message by name; None where one is unknown."""
    found: dict[str, Any] = {"stamp": stamp_of(message.header.stamp), "model_id": message.model_id}
    for value in VALUES:
        if value.topic is topic:
            raw = known(getattr(message, value.field))
            found[value.name] = None if raw is None else raw / value.size
    if topic is Topic.POWER:
        found["phase"] = Phase(message.phase).name
        found["quality"] = int(message.quality)
        found["joints"] = [
            {
                "name": joint.name,
                "motor_temperature_degc": known(joint.motor_temperature_degc),
                "friction_power": known(joint.friction_power),
                "drive_power": known(joint.drive_power),
            }
            for joint in message.joints[:MAX_JOINTS]
        ]
        found["auxiliary"] = [
            {
                "name": load.name,
                "state": load.states[load.state] if 0 <= load.state < len(load.states) else None,
                "power": known(load.power),
                "remarks": int(load.remarks),
            }
            for load in message.auxiliary[:MAX_JOINTS]
        ]
    else:
        found["energy_start"] = stamp_of(message.energy_start)
        found["persisted"] = bool(message.persisted)
        found["auxiliary"] = [
            {
                "name": load.name,
                "energy_kwh": load.energy / ENERGY_UNITS["kWh"],
                "known_time": load.known_time,
                "missing_time": load.missing_time,
            }
            for load in message.auxiliary[:MAX_JOINTS]
        ]
    return found


def stamp_of(stamp: Any) -> float:
    """Return a builtin_interfaces/Time as seconds since 1970. [s]"""
    return (stamp.sec * SECOND_NS + stamp.nanosec) / SECOND_NS


@dataclass
class Newest:
    """The newest message of each topic.

    Attributes:
        stale_after: Age from which a message is not current. [s]
    """

    stale_after: float
    _held: dict[Topic, tuple[Any, float]] = field(default_factory=lambda: {})

    def take(self, topic: Topic, message: Any, now: float) -> None:
        """Keep a message.

        Args:
            now: Steady time. [s]
        """
        self._held[topic] = (message, now)

    def message(self, topic: Topic) -> Any:
        """Return the newest message of a topic; None before the first."""
        return self._held[topic][0] if topic in self._held else None

    def is_current(self, topic: Topic, now: float) -> bool:
        """Return whether a message of a topic came lately.

        Args:
            now: Steady time. [s]
        """
        return topic in self._held and now - self._held[topic][1] <= self.stale_after


class Exporter(ABC):
    """Hands the newest values to one system. Its methods never wait for the network."""

    @abstractmethod
    def start(self) -> None:
        """Begin to connect or to serve."""

    @abstractmethod
    def publish(self, newest: Newest, now: float) -> None:
        """Hand out what is new, or that nothing is current.

        Args:
            now: Steady time. [s]
        """

    @abstractmethod
    def stop(self) -> None:
        """Say goodbye and disconnect."""

    @abstractmethod
    def check(self, found: StatusBuilder) -> None:
        """Add how it goes to the diagnostics."""
