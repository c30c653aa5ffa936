# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Table of the kinds of links, from a profile to a link, and parameters of the driver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_energy.foundation.config_file import parse_yaml, read_text, validated
from robot_energy.foundation.errors import KindError, MeterProfileError
from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy.inputs.meter.source import LOAD_NEGATIVE, LOAD_POSITIVE, LOCATIONS
from robot_energy.inputs.parameters import parameter
from ros2_energy_monitor.meters.http_link import HttpLink, HttpProfile
from ros2_energy_monitor.meters.link import Endpoint, MeterLink
from ros2_energy_monitor.meters.modbus_link import ModbusLink, ModbusProfile
from ros2_energy_monitor.meters.mqtt_link import MqttLink, MqttProfile
from ros2_energy_monitor.meters.profile import FOLDER, MeterProfile
from ros2_energy_monitor.meters.sunspec_link import SunSpecLink, SunSpecProfile


@dataclass(frozen=True, kw_only=True)
class MeterDriverParameters:
    """Parameters of the meter driver."""

    profile: str = parameter(
        "Profile of the meter: name of a shipped one, such as siemens_pac2200, or a YAML file."
    )
    host: str = parameter("Name or address of the meter; for MQTT, of the broker.")
    port: int = parameter("Its port; 0 for that of the profile.", 0, (0, 65535))
    unit: int = parameter(
        "Modbus unit (slave) identifier; -1 for that of the profile.", -1, (-1, 255)
    )
    device: str = parameter("Name of the meter in MQTT topics; unused otherwise.", "")
    location: str = parameter(
        "Where the meter sits: mains supply of the cabinet, or DC bus between rectifier "
        "and drives.",
        "grid",
        choices=LOCATIONS,
    )
    sign: str = parameter(
        "Sign of the power while the robot draws some.",
        LOAD_POSITIVE,
        choices=(LOAD_POSITIVE, LOAD_NEGATIVE),
    )
    scale: float = parameter(
        "Factor on power and energy, as of a current transformer that the meter does not know [-].",
        1.0,
        (1e-9, 1e9),
    )
    max_power: float = parameter(
        "Highest plausible power: readings above it are refused, and a fall of the counter that "
        "implies more is not a wrap [W].",
        1e6,
        (1.0, 1e9),
    )
    period: float = parameter(
        "Time from one request to the next; 0 for that of the profile [s].", 0.0, (0.0, 3600.0)
    )
    timeout: float = parameter(
        "Longest time for a connection, and for all answers of one reading [s].", 2.0, (0.05, 60.0)
    )
    max_round_trip: float = parameter(
        "Longest time from a request to its answer; the stamp is the middle of it, and slower "
        "readings are refused [s].",
        0.5,
        (0.001, 60.0),
    )
    max_backoff: float = parameter(
        "Longest time between two attempts to connect [s].", 30.0, (0.5, 3600.0)
    )
    credentials_file: str = parameter(
        "YAML file, readable by its owner only, with username and password; empty for none.", ""
    )
    allow_plain_password: bool = parameter(
        "Whether a password may be sent unencrypted to a host that is not this machine.", False
    )
    tls: bool = parameter("Whether the connection is encrypted (HTTP and MQTT).", False)
    ca_file: str = parameter(
        "File of certificates of the authority that signed that of the server; empty for those of "
        "the system.",
        "",
    )


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
    """Return the kind of the link of a profile, shipped or a file of yours, and what it holds."""
    shipped = {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}
    path = shipped.get(name) or Path(name)
    if name not in shipped and path.suffix not in (".yaml", ".yml"):
        raise MeterProfileError(
            f"there is no meter profile '{name}'",
            f"one of {', '.join(shipped)}, or the path of a YAML file",
        )
    source = str(path)
    text = read_text(path, MeterProfileError, "meter profile")
    document: object = parse_yaml(text, source, MeterProfileError)
    link = document.get("link") if isinstance(document, dict) else None
    try:
        kind = METER_LINKS[str(link)]
    except KindError as error:
        raise MeterProfileError(
            f"{source} has the link '{link}'", METER_LINKS.expected, METER_LINKS.remedy(str(link))
        ) from error
    return kind, validated(document, kind.profile, source, MeterProfileError)
