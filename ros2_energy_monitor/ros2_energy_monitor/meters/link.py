# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What every link to a meter does, whatever it speaks; numbers in JSON that meters send."""

from __future__ import annotations

import json
import math
import re
import ssl
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, cast

from pydantic import Field

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError
from ros2_energy_monitor.base.credentials import Credentials
from ros2_energy_monitor.meters.profile import MAX_TERMS, NumberEntry, ProfileEntry
from ros2_energy_monitor.meters.reading import Exchange, MeterTerm

EACH = "*"  # at the end of a path: every number of a list, as of three phases
NUMBER = re.compile(r"[+-]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][+-]?\d{1,3})?", re.ASCII)

JsonPath = Annotated[tuple[str | int, ...], Field(min_length=1, max_length=20)]


class JsonNumber(NumberEntry):
    """A number in a document.

    Attributes:
        path: Keys and positions that lead to it. ``*`` at the end: a list of numbers that add up,
            or one number.
    """

    path: JsonPath


class JsonFlag(ProfileEntry):
    """A list of faults in a document."""

    path: JsonPath
    without: str


def parse(text: str, whose: str) -> Any:
    """Return the plain values of a document."""
    if len(text) > MAX_ANSWER:
        raise MeterAnswerError(
            f"{whose} answers with {len(text)} characters", f"at most {MAX_ANSWER}"
        )
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MeterAnswerError(f"{whose} answers with no JSON", "a JSON document") from error


def terms_at(
    document: Any, numbers: Sequence[JsonNumber], whose: str, *, good: bool
) -> tuple[MeterTerm, ...]:
    """Return the numbers that entries name; NaN where the document says null or is not good."""
    return tuple(
        MeterTerm(value * number.factor if good else math.nan, number.wraps_at_joule)
        for number in numbers
        for value in _values_at(document, number, whose)
    )


def _values_at(document: Any, number: JsonNumber, whose: str) -> list[float]:
    *path, last = number.path
    each = last == EACH
    found = at(document, path if each else number.path)
    where = ".".join(map(str, number.path))
    if each and isinstance(found, list):
        phases = cast("list[Any]", found)
        if not 1 <= len(phases) <= MAX_TERMS:
            raise MeterAnswerError(
                f"{whose} sends a list of {len(phases)} at {where}", f"1 to {MAX_TERMS} numbers"
            )
        return [_value(phase, whose, where) for phase in phases]
    if isinstance(found, list):
        raise MeterAnswerError(
            f"{whose} sends a list at {where}",
            "a number",
            f'end the path with a position, as 0, or with "{EACH}" to add all up',
        )
    return [_value(found, whose, where)]


def _value(found: Any, whose: str, where: str) -> float:
    if found is None:
        return math.nan
    if isinstance(found, str) and NUMBER.fullmatch(found.strip()):
        return float(found)
    if isinstance(found, str):
        raise MeterAnswerError(
            f"{whose} sends the text '{found[:40]}' at {where}",
            "a number, with a decimal point and without a unit",
        )
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise MeterAnswerError(
            f"{whose} sends no number at {where}", "one there, or another profile"
        )
    try:
        return float(found)
    except OverflowError:
        return math.inf


def is_good(document: Any, flags: Sequence[JsonFlag]) -> bool:
    """Return whether a document states none of the faults."""
    lists = ((at(document, flag.path), flag.without) for flag in flags)
    return not any(isinstance(found, list) and fault in found for found, fault in lists)


def at(document: Any, path: Sequence[str | int]) -> Any:
    """Return what stands at a path; ``...`` where nothing does."""
    here = document
    for step in path:
        if isinstance(here, dict) and step in here:
            here = cast("dict[Any, Any]", here)[step]
        elif isinstance(here, list) and isinstance(step, int) and 0 <= step < len(here):
            here = cast("list[Any]", here)[step]
        else:
            return ...
    return here


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
        self._end, self._left = time.monotonic() + self._timeout, MAX_ANSWER

    @property
    def left(self) -> float:
        """Time that is left, above 0. [s]"""
        left = self._end - time.monotonic()
        if left <= 0:
            raise self.over()
        return left

    def take(self, count: int) -> None:
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
