# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""MQTT: plain JSON, and discovery messages for Home Assistant.

Topics, below ``<topic>/<robot>``: ``status`` (online or offline, retained, also the last will),
``power`` (not retained: an old power must not look like one of now) and ``registers``
(retained: a counter keeps its value, and ``status`` says whether it is current).
"""

from __future__ import annotations

import json
import re
import ssl
import sys
import threading
from dataclasses import dataclass
from typing import Any

from robot_energy import __version__
from robot_energy.foundation.errors import ExporterError
from robot_energy.foundation.files.regular_file import require_private
from robot_energy.inputs.parameters import parameter
from ros2_energy_monitor.base.connection_failure import reason_of
from ros2_energy_monitor.base.credentials import LOOPBACK, read_credentials
from ros2_energy_monitor.base.mqtt_packets import PacketBound
from ros2_energy_monitor.base.optional_packages import require
from ros2_energy_monitor.diagnostics.reporter import ERROR, WARN, StatusBuilder
from ros2_energy_monitor.exporters.values import (
    MAX_JOINTS,
    VALUES,
    Exporter,
    Newest,
    Topic,
    exported,
)

QOS = 1
KEEP_ALIVE = 15  # the broker says offline after one and a half of it [s]
UNSPECIFIED = "Unspecified error"  # what the client says of an end without a reason
AT_ONCE = 20  # messages that may wait to be acknowledged before others are sent
MAX_WAITING = 100  # messages that the broker has not acknowledged
MAX_PACKET, MAX_PACKET_TIME = 100_000, 10.0  # of the broker, which has only answers to send [B, s]
MIN_RECONNECT, MAX_RECONNECT = 1, 60  # [s]
ONLINE, OFFLINE = "online", "offline"
NAME = re.compile(r"[A-Za-z0-9_-]+")
TOPIC = re.compile(r"[^#+\s]+")
DEVICE_CLASS = {"W": "power", "kWh": "energy", "s": "duration", "°C": "temperature"}


@dataclass(frozen=True, kw_only=True)
class MqttParameters:
    """Parameters of the MQTT exporter."""

    host: str = parameter("Name or address of the MQTT broker.", "127.0.0.1")
    port: int = parameter("Port of the broker; 8883 is usual with tls.", 1883, (1, 65535))
    topic: str = parameter(
        "Beginning of the topics; the name of the robot follows.", "robot_energy"
    )
    period: float = parameter(
        "Time from one message of a topic to the next [s].", 1.0, (0.1, 3600.0)
    )
    discovery: str = parameter(
        "Beginning of the discovery topics of Home Assistant; empty for none.", "homeassistant"
    )
    credentials_file: str = parameter(
        "YAML file, readable by its owner only, with username and password; empty for none.", ""
    )
    tls: bool = parameter("Whether the connection to the broker is encrypted.", False)
    ca_file: str = parameter(
        "File of certificates of the authority that signed that of the broker; empty for those of "
        "the system.",
        "",
    )
    cert_file: str = parameter("Certificate of this client; empty for none.", "")
    key_file: str = parameter(
        "Key of that certificate, in a file that only its owner can read; empty for none.", ""
    )
    allow_plain_password: bool = parameter(
        "Whether a password may be sent without tls to a broker that is not on this machine.", False
    )


class MqttExporter(Exporter):
    """Publishes to one broker; reconnects by itself, with growing pauses."""

    def __init__(self, parameters: MqttParameters, robot: str) -> None:
        mqtt = require("paho.mqtt.client", "paho-mqtt", "this exporter", ExporterError)
        self._given, self._robot = parameters, robot
        _check(parameters, robot)
        self._base = f"{parameters.topic}/{robot}"
        self._connected, self._failure, self._losses = threading.Event(), "", 0
        self._announced = False
        self._status, self._parts = "", ((), ())
        self._sent: dict[Topic, tuple[Any, float]] = {}
        self._refused: dict[str, str] = {}  # retained messages that found no room, by topic
        self._dropped = self._published = 0
        self._waiting: list[Any] = []  # messages that are not acknowledged yet
        self._before = 0, 0  # how many of them, and of dropped ones, at the last check
        client = self._client = mqtt.Client(
            mqtt.CallbackAPIVersion.VERSION2, client_id=f"robot_energy_{robot}"
        )
        self._bound = PacketBound(client, MAX_PACKET, MAX_PACKET_TIME)
        client.max_inflight_messages_set(AT_ONCE)
        client.max_queued_messages_set(MAX_WAITING)
        client.reconnect_delay_set(MIN_RECONNECT, MAX_RECONNECT)
        client.will_set(f"{self._base}/status", OFFLINE, QOS, retain=True)
        client.on_connect, client.on_disconnect = self._take_connection, self._take_loss
        client.on_connect_fail = self._take_failure
        self._let_in()

    def _let_in(self) -> None:
        given, client = self._given, self._client
        secret = read_credentials(given.credentials_file)
        if secret is not None:
            if not (given.tls or given.host in LOOPBACK or given.allow_plain_password):
                raise ExporterError(
                    f"a password would be sent to {given.host} in plain text",
                    "tls: true, a broker on this machine, or allow_plain_password: true",
                )
            client.username_pw_set(secret.username, secret.password)
        if not given.tls:
            return
        if given.key_file:
            require_private(given.key_file, "key of the MQTT client")
        try:
            client.tls_set(
                given.ca_file or None,
                given.cert_file or None,
                given.key_file or None,
                tls_version=ssl.PROTOCOL_TLS_CLIENT,
            )
        except (OSError, ValueError) as error:
            raise ExporterError(
                f"the certificates of mqtt cannot be used ({error})", "files in the form PEM"
            ) from error

    def start(self) -> None:
        """Begin to connect; a broker that is not there yet is tried again."""
        try:
            self._client.connect_async(self._given.host, self._given.port, KEEP_ALIVE)
        except ValueError as error:
            raise ExporterError(f"mqtt.host is '{self._given.host}'", "a host name") from error
        self._client.loop_start()

    def publish(self, newest: Newest, now: float) -> None:
        """Publish what is new while connected; nothing waits for a broker that is away.

        Args:
            now: Steady time. [s]
        """
        if not self._connected.is_set():
            return
        if not self._announced:
            self._announce()
        for topic, text in list(self._refused.items()):
            if not self._send(topic, text, retain=True):
                break
        for topic in Topic:
            message = newest.message(topic)
            last, sent = self._sent.get(topic, (None, -1e9))
            if message is None or message is last or now - sent < self._given.period:
                continue
            self._sent[topic] = (message, now)
            if topic is Topic.POWER:
                self._announce_parts(message)
            text = json.dumps(exported(message, topic), allow_nan=False)
            self._send(f"{self._base}/{topic.value}", text, retain=topic is Topic.REGISTERS)
        current = any(newest.is_current(topic, now) for topic in Topic)
        status = ONLINE if current else OFFLINE
        if status != self._status:
            self._status = status
            self._send(f"{self._base}/status", status, retain=True)

    def stop(self) -> None:
        """Say offline, as a clean end sends no last will, and disconnect."""
        if self._connected.is_set():
            sent = self._client.publish(f"{self._base}/status", OFFLINE, QOS, retain=True)
            try:
                sent.wait_for_publish(1.0)
            except (RuntimeError, ValueError):
                pass
        self._client.disconnect()
        self._client.loop_stop()

    def check(self, found: StatusBuilder) -> None:
        connected = self._connected.is_set()
        self._waiting = [one for one in self._waiting if not one.is_published()]
        waiting, before = len(self._waiting), self._before
        self._before = waiting, self._dropped
        found.values |= {
            "connected": int(connected),
            "published": self._published,
            "waiting": waiting,
            "dropped": self._dropped,
            "losses": self._losses,
        }
        if connected and min(waiting, before[0]) > AT_ONCE:
            lost = self._dropped - before[1]
            found.add(
                WARN,
                f"the broker has not acknowledged {waiting} messages, so that others are late"
                + (f" and {lost} were lost in the last second" if lost else ""),
                "look at its log and its limits",
            )
        if not connected:
            where = f"{self._given.host}:{self._given.port}"
            why = self._failure or "no answer yet"
            found.add(ERROR, f"no connection to the MQTT broker at {where}: {why}")

    def _send(self, topic: str, text: str, retain: bool) -> bool:
        """Send a message, unless too many wait; one that is to be retained goes out later."""
        self._refused.pop(topic, None)
        done = self._client.publish(topic, text, QOS, retain)
        if done.rc == 0:
            self._published += 1
            self._waiting.append(done)
        if done.rc != 0 and retain:
            self._refused[topic] = text
        else:
            self._dropped += done.rc != 0
        return done.rc == 0

    # Callbacks of the thread of the client

    def _take_connection(self, _client: Any, _data: Any, _flags: Any, reason: Any, _more: Any):
        if reason.is_failure:
            self._failure = str(reason)
            return
        self._status, self._announced, self._failure = "", False, ""
        self._sent.clear()
        self._refused.clear()
        self._connected.set()

    def _take_loss(self, _client: Any, _data: Any, _flags: Any, reason: Any, _more: Any) -> None:
        self._losses += self._connected.is_set()
        self._connected.clear()
        if self._bound.refused or not self._failure or not reason.is_failure:
            self._failure = self._bound.refused or (
                str(reason) if reason.getName() != UNSPECIFIED else "the connection broke off"
            )
        self._bound.refused = ""

    def _take_failure(self, _client: Any, _data: Any) -> None:
        # The client calls this while it handles the error.
        self._failure = f"it cannot be reached: {reason_of(sys.exception())}"

    # Discovery

    def _announce(self) -> None:
        """Send the discovery messages; once more after each connection, as a broker may forget."""
        self._announced, self._parts = True, ((), ())
        for value in VALUES:
            total = "total_increasing" if value.rises else "total"
            kind = total if value.topic is Topic.REGISTERS else "measurement"
            self._discover(value.name, value.title, value.name, value.unit, kind, value.topic)

    def _announce_parts(self, message: Any) -> None:
        names = tuple(joint.name for joint in message.joints[:MAX_JOINTS])
        loads = tuple(load.name for load in message.auxiliary[:MAX_JOINTS])
        if (names, loads) == self._parts:
            return
        self._parts = names, loads
        temperature = "motor_temperature_degc"
        every = [
            *((one, "auxiliary", "Power of", "power", "W", "measurement") for one in loads),
            *((one, "auxiliary", "Energy of", "energy_kwh", "kWh", "total") for one in loads),
            *((n, "joints", "Motor temperature", temperature, "°C", "measurement") for n in names),
        ]
        for name, parts, title, key, unit, kind in every:
            known = re.sub(r"[^A-Za-z0-9_-]", "_", name)
            of_joint = parts == "joints"
            identity = f"motor_temperature_{known}" if of_joint else f"auxiliary_{known}_{key}"
            topic = Topic.REGISTERS if unit == "kWh" else Topic.POWER
            place = _of_part(parts, name, key)
            self._discover(identity, f"{title} {name}", place, unit, kind, topic)

    def _discover(
        self, name: str, title: str, place: str, unit: str, kind: str, topic: Topic
    ) -> None:
        if not self._given.discovery:
            return
        node = f"robot_energy_{self._robot}"
        config = {
            "name": title,
            "value_template": f"{{{{ value_json.{place} }}}}",
            "unit_of_measurement": unit,
            "device_class": DEVICE_CLASS[unit],
            "state_class": kind,
            "state_topic": f"{self._base}/{topic.value}",
            "availability_topic": f"{self._base}/status",
            "unique_id": f"{node}_{name}",
            "qos": QOS,
            "device": {"identifiers": [node], "name": f"Robot {self._robot}"},
            "origin": {"name": "robot-energy", "sw_version": __version__},
        }
        if topic is Topic.POWER:  # it expires with its message
            config["expire_after"] = max(3, round(3 * self._given.period))
        sensor = f"{self._given.discovery}/sensor/{node}/{name}"
        self._send(f"{sensor}/config", json.dumps(config), retain=True)


def _of_part(parts: str, name: str, key: str) -> str:
    """Return where a template finds a value; of a part that a message lacks it is unknown."""
    of = f"selectattr('name', 'eq', {json.dumps(name)}) | map(attribute='{key}') | first"
    return f"{parts} | {of} | default(none)"


def _check(given: MqttParameters, robot: str) -> None:
    if not NAME.fullmatch(robot):
        raise ExporterError(f"robot_name is '{robot}'", "letters, digits, _ and -")
    for name, value in (("topic", given.topic), ("discovery", given.discovery or "-")):
        if not TOPIC.fullmatch(value):
            raise ExporterError(f"mqtt.{name} is '{value}'", "a topic without #, + and spaces")
    if bool(given.cert_file) != bool(given.key_file):
        raise ExporterError("one of mqtt.cert_file and mqtt.key_file is given", "both, or none")
