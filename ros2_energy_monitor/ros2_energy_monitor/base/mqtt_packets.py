# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Bounds on what a broker may make an MQTT client hold.

paho-mqtt takes packets of up to 256 MB. MQTT 3.1.1 has no way to give the broker a bound, that of
MQTT 5 is only a request: the client itself must refuse.
"""

from __future__ import annotations

import time
from typing import Any

MAX_UNSENT = 1000  # packets that the broker does not take
PUBLISH_QOS_2 = 0x34  # a message that the client would hold until the broker releases it


class PacketBound:
    """Ends the connection of a client whose broker sends a packet that is too large or too slow.

    Args:
        seconds: Longest time from its first byte to its last. [s]

    Attributes:
        refused: What was refused last, in words; empty for nothing.
    """

    def __init__(self, client: Any, size: int, seconds: float) -> None:
        self.refused = ""
        self._client, self._size, self._seconds = client, size, seconds
        self._receive, client._sock_recv = client._sock_recv, self._bounded
        self._began = 0.0

    def _bounded(self, count: int) -> bytes:
        packet = self._client._in_packet
        if packet["command"] == 0:
            self._began = time.monotonic()
        elif time.monotonic() - self._began > self._seconds:
            self._refuse(f"a packet that does not end within {self._seconds:g} s")
        elif packet["remaining_length"] > self._size:
            self._refuse(f"a packet of more than {self._size} bytes")
        elif packet["command"] & 0xF6 == PUBLISH_QOS_2:
            self._refuse("a message of QoS 2, which was not asked for")
        elif len(self._client._out_packet) > MAX_UNSENT:
            self._refuse(f"requests but does not read the answers: {MAX_UNSENT} are waiting")
        return self._receive(count)

    def _refuse(self, what: str) -> None:
        self.refused = f"the broker sends {what}"
        raise ConnectionError(self.refused)  # paho-mqtt then closes the connection
