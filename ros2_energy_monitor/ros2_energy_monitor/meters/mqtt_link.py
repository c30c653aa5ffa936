# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters that publish JSON at an MQTT broker."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from robot_energy.foundation.errors import MeterLinkError, MeterProfileError
from ros2_energy_monitor.base.connection_failure import reason_of
from ros2_energy_monitor.base.mqtt_packets import PacketBound
from ros2_energy_monitor.base.optional_packages import require
from ros2_energy_monitor.meters.link import (
    MAX_ANSWER,
    Endpoint,
    JsonFlag,
    JsonNumber,
    MeterLink,
    is_good,
    parse,
    terms_at,
)
from ros2_energy_monitor.meters.profile import MeterProfile
from ros2_energy_monitor.meters.reading import Exchange

MAX_WAITING = 50  # messages
KEEP_ALIVE = 30  # [s]
Message = tuple[str, bytes, float]  # topic, payload, time of receipt [s]


class MqttNumber(JsonNumber):
    """A number in the messages of a topic.

    Attributes:
        topic: The topic; ``{device}`` stands for the name of the meter.
    """

    topic: Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^#+\s]+$")]


class MqttProfile(MeterProfile[MqttNumber]):
    """Profile of a meter that sends by itself; numbers that add up are of one topic.

    Attributes:
        flags: Faults that make the numbers of a message invalid.
    """

    port: Annotated[int, Field(ge=1, le=65535)] = 1883
    flags: tuple[JsonFlag, ...] = ()

    @model_validator(mode="after")
    def _check_topics(self) -> Self:
        for numbers in (self.energy, self.power):
            if len({number.topic for number in numbers}) > 1:
                raise ValueError("numbers that add up are of several topics; expected one topic")
        return self


class MqttLink(MeterLink):
    """Subscribes a meter's topics. A retained message is left out: nobody knows its age."""

    def __init__(self, profile: MqttProfile, endpoint: Endpoint) -> None:
        self._mqtt = require("paho.mqtt.client", "paho-mqtt", "this meter", MeterProfileError)
        self._endpoint, self._flags = endpoint, profile.flags
        self._numbers = profile.quantities
        self._topic = {
            quantity: numbers[0].topic.replace("{device}", endpoint.device)
            for quantity, numbers in self._numbers.items()
        }
        self._topics = sorted(set(self._topic.values()))
        self._waiting: queue.Queue[Message | None] = queue.Queue()  # None: the connection is lost
        self._client: Any = None
        self._settled = threading.Event()
        self._failure = ""  # why we are not subscribed, or no longer
        self._bound: PacketBound | None = None

    @property
    def waits(self) -> bool:
        """The meter sends when it likes."""
        return True

    @property
    def _where(self) -> str:
        return f"the MQTT broker at {self._endpoint.host}:{self._endpoint.port}"

    def connect(self) -> None:
        self.close()
        self._settled.clear()
        self._failure = ""
        self._waiting = queue.Queue()
        end = time.monotonic() + self._endpoint.timeout
        client = self._mqtt.Client(
            self._mqtt.CallbackAPIVersion.VERSION2, reconnect_on_failure=False
        )
        self._bound = PacketBound(client, MAX_ANSWER, self._endpoint.timeout)
        client.connect_timeout = self._endpoint.timeout
        if self._endpoint.credentials is not None:
            given = self._endpoint.credentials
            client.username_pw_set(given.username, given.password)
        if context := self._endpoint.tls_context():
            client.tls_set_context(context)
        client.on_connect = self._take_connection
        client.on_subscribe = self._take_subscription
        client.on_disconnect = self._take_loss
        client.on_message = self._take_message
        try:
            client.connect(self._endpoint.host, self._endpoint.port, KEEP_ALIVE)
        except (OSError, ValueError) as error:
            raise MeterLinkError(
                f"{self._where} cannot be reached ({reason_of(error)})", "a broker there"
            ) from error
        self._client = client
        client.loop_start()
        settled = self._settled.wait(max(0.0, end - time.monotonic()))
        if self._failure or not settled:
            why = f" ({self._failure})" if self._failure else ""
            self.close()
            raise MeterLinkError(
                f"{self._where} does not accept us{why}",
                f"a subscription within {self._endpoint.timeout:g} s",
                "check credentials_file, tls and the broker's access rules",
            )

    def close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()

    def read(self) -> Sequence[Exchange]:
        """Return what the next message says; empty if none comes in time."""
        if self._client is None:
            raise MeterLinkError(f"{self._where} is not connected", "connect first")
        try:
            message = self._waiting.get(timeout=self._endpoint.timeout)
        except queue.Empty:
            return ()
        if message is None:
            self.close()
            raise MeterLinkError(
                f"{self._where} is lost ({self._failure})", "a connection that is kept"
            )
        topic, payload, at = message
        document = parse(payload.decode("utf-8", errors="replace"), f"the meter on {topic}")
        good = is_good(document, self._flags)
        return [
            Exchange(what, terms_at(document, numbers, topic, good=good), at, at)
            for what, numbers in self._numbers.items()
            if self._topic[what] == topic
        ]

    # Callbacks of the thread of the client

    def _take_connection(self, client: Any, _data: Any, _flags: Any, reason: Any, _more: Any):
        if reason.is_failure:
            self._failure = str(reason)
        else:
            client.subscribe([(topic, 1) for topic in self._topics])

    def _take_subscription(self, _client: Any, _data: Any, _mid: Any, codes: Any, _more: Any):
        pairs = zip(self._topics, codes, strict=False)
        refused = [topic for topic, code in pairs if code.is_failure]
        if refused:
            self._failure = f"it refuses the subscription of {', '.join(refused)}"
        self._settled.set()

    def _take_loss(self, _client: Any, _data: Any, _flags: Any, reason: Any, _more: Any):
        refused = self._bound.refused if self._bound else ""
        self._failure = self._failure or refused or str(reason)
        self._settled.set()
        self._waiting.put(None)

    def _take_message(self, _client: Any, _data: Any, message: Any) -> None:
        try:
            topic = str(message.topic)
        except UnicodeDecodeError:  # it would end the thread of the client
            return
        if not message.retain and self._waiting.qsize() < MAX_WAITING:
            self._waiting.put((topic, message.payload, time.monotonic()))
