# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Table of the kinds of links, and from a profile to a link."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from robot_energy.foundation.errors import KindError, MeterProfileError
from robot_energy.foundation.kinds import Kind, Kinds
from ros2_energy_monitor.meters.http_link import HttpLink, HttpProfile
from ros2_energy_monitor.meters.link import Endpoint, MeterLink
from ros2_energy_monitor.meters.modbus_link import ModbusLink, ModbusProfile
from ros2_energy_monitor.meters.mqtt_link import MqttLink, MqttProfile
from ros2_energy_monitor.meters.profile import MeterProfile, checked, read_document
from ros2_energy_monitor.meters.sunspec_link import SunSpecLink, SunSpecProfile


@dataclass(frozen=True, kw_only=True)
class MeterLinkKind(Kind):
    """One kind of link."""

    profile: type[MeterProfile[Any]]
    make: Callable[[Any, Endpoint], MeterLink]


METER_LINKS = Kinds(
    "meter link",
    *(
        MeterLinkKind(name=name, label=label, line=line, profile=profile, make=make)
        for name, label, line, profile, make in (
            ("modbus_tcp", "Modbus TCP", "registers whose numbers the profile states",
             ModbusProfile, ModbusLink),
            ("sunspec", "SunSpec over Modbus TCP",
             "meter models 201 to 204 and 211 to 214, found by their headers",
             SunSpecProfile, SunSpecLink),
            ("http_json", "HTTP with JSON", "one request, an answer with all numbers",
             HttpProfile, HttpLink),
            ("mqtt_json", "MQTT with JSON", "messages that the meter sends to a broker by itself",
             MqttProfile, MqttLink),
        )
    ),
)  # fmt: skip


def load_profile(name: str) -> tuple[MeterLinkKind, MeterProfile[Any]]:
    """Return the kind of the link of a profile, and what it holds.

    Args:
        name: Name of a shipped profile, or path of a file of yours.
    """
    source, document = read_document(name)
    link = document.get("link") if isinstance(document, dict) else None
    try:
        kind = METER_LINKS[str(link)]
    except KindError as error:
        raise MeterProfileError(
            f"{source} has the link '{link}'", METER_LINKS.expected, METER_LINKS.remedy(str(link))
        ) from error
    return kind, checked(document, kind.profile, source)
