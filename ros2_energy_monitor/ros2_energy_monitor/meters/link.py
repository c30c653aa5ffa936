# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What every link to a meter does, whatever it speaks."""

from __future__ import annotations

import ssl
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from robot_energy.foundation.errors import MeterLinkError
from ros2_energy_monitor.base.credentials import Credentials
from ros2_energy_monitor.meters.reading import Exchange

MAX_ANSWER = 1_000_000  # bytes of one answer, with headers and what is refused


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """Where the meter is and how to be let in.

    Attributes:
        host: Name or address of the meter, or of the MQTT broker.
        timeout: Longest time for a connection, and for all answers of one reading. [s]
        unit: Modbus unit (slave) identifier; None for that of the profile.
        device: Name of the meter in the topics of an MQTT broker.
        credentials: Name and password; None for none.
        ca_file: File of certificates of the authority that signed that of the server; empty for
            those of the system.
    """

    host: str
    port: int
    timeout: float
    unit: int | None = None
    device: str = ""
    credentials: Credentials | None = None
    tls: bool = False
    ca_file: str = ""

    def tls_context(self) -> ssl.SSLContext | None:
        """Return what certificates are checked with; None without tls."""
        if not self.tls:
            return None
        try:
            return ssl.create_default_context(cafile=self.ca_file or None)
        except OSError as error:
            raise MeterLinkError(
                f"ca_file {self.ca_file} cannot be used ({error})", "certificates in the form PEM"
            ) from error


class AnswerBound:
    """What the answers of one reading may still bring, and how long they may still take.

    Args:
        timeout: Longest time of one reading. [s]
    """

    def __init__(self, whose: str, timeout: float) -> None:
        self._whose, self._timeout = whose, timeout
        self.begin()

    def begin(self) -> None:
        """Begin a reading."""
        self._end, self._left = time.monotonic() + self._timeout, MAX_ANSWER

    @property
    def left(self) -> float:
        """Time that is left, above 0. [s]"""
        left = self._end - time.monotonic()
        if left <= 0:
            raise self.over()
        return left

    def take(self, count: int) -> None:
        """Count bytes that came."""
        self._left -= count
        if self._left < 0:
            raise self.over()

    def over(self) -> MeterLinkError:
        """Return the error that says that the bound is reached."""
        did = "gives no answer" if self._left == MAX_ANSWER else "does not end its answer"
        return MeterLinkError(
            f"{self._whose} {did}",
            f"{MAX_ANSWER} bytes at most, within {self._timeout:g} s",
            "raise timeout for a slow meter",
        )


class MeterLink(ABC):
    """A connection to one meter, used by one thread."""

    @abstractmethod
    def connect(self) -> None:
        """Connect; what was connected before is given up."""

    @abstractmethod
    def read(self) -> Sequence[Exchange]:
        """Ask for the numbers and return them; empty if the meter sent none in time.

        Raises:
            MeterLinkError: If the connection is lost.
            MeterAnswerError: If the meter refuses or answers something else.
        """

    @abstractmethod
    def close(self) -> None:
        """Disconnect; may be called twice."""

    @property
    def waits(self) -> bool:
        """Whether `read` waits for the meter by itself, so that nothing paces it."""
        return False
