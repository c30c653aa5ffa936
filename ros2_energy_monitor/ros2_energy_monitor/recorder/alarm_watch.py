# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Diagnostic statuses of one robot -> events of its history: alarms, their ends, restarts."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from robot_energy.foundation.described import documented
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.units import SECOND_NS
from robot_energy_history.differences import Event
from ros2_energy_monitor.diagnostics.reporter import SEVERITY

LASTING = 10.0  # how long an alarm lasts before it is noted [s]
OVER = 60.0  # how long all is well before it has ended; one that comes again is the same [s]
MAX_STATUSES = 200  # of a robot
MAX_TEXT = 300  # characters
FRAME_AT = 12  # where the frame of a serialised message begins
WORDS = ("ok", "warning", "stale", "error")


@documented
class StatusHead(NamedTuple):
    """What the history needs of a diagnostic status."""

    name: Annotated[str, "Of node and subject."]
    level: Annotated[bytes, "As messages have it."]
    message: Annotated[str, "In words."]
    restarts: Annotated[str, "Value of that name; empty without one."] = ""


def first_name(data: bytes) -> bytes:
    """Return the name of the first status of a serialised ``DiagnosticArray``; empty for none.

    Errors as of `status_heads`.
    """
    count, text = _readers(data)
    statuses, place = count(text(FRAME_AT)[1])
    return text(place + 1)[0] if statuses else b""


def status_heads(data: bytes) -> tuple[int, list[StatusHead]]:
    """Return stamp [ns] and statuses of a serialised ``DiagnosticArray``.

    All values but one are skipped.

    Raises:
        ValueError, IndexError, struct.error: If it is not such a message.
    """
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return seconds * SECOND_NS + nanoseconds, [
        StatusHead(name.decode(errors="replace"), level, message.decode(errors="replace"),
                   restarts.decode(errors="replace"))
        for name, level, message, restarts in _statuses(data)
    ]  # fmt: skip


def _readers(
    data: bytes,
) -> tuple[Callable[[int], tuple[int, int]], Callable[[int], tuple[bytes, int]]]:
    """What reads a count, and a text, at a place, and returns where it ends."""
    count_at = struct.Struct("<I" if data[1] & 1 else ">I").unpack_from

    def count(place: int) -> tuple[int, int]:
        place += -place % 4
        return count_at(data, place)[0], place + 4

    def text(place: int) -> tuple[bytes, int]:
        length, place = count(place)
        end = place + length
        if end > len(data):
            raise ValueError(f"a text up to byte {end} of {len(data)}")
        return data[place : end - 1], end

    return count, text


def _statuses(data: bytes) -> Iterator[tuple[bytes, bytes, bytes, bytes]]:
    """Yield name, level, message and the value named restarts of each status."""
    count, text = _readers(data)
    statuses, place = count(text(FRAME_AT)[1])
    for _ in range(statuses):
        level = data[place : place + 1]
        name, place = text(place + 1)
        message, place = text(place)
        _, place = text(place)
        values, place = count(place)
        restarts = b""
        for _ in range(values):
            key, place = text(place)
            value, place = text(place)
            if key == b"restarts":
                restarts = value
        yield name, level, message, restarts


@documented
@dataclass
class _Alarm:
    """How a status stands."""

    noted: Annotated[int, "Severity of the alarm that was noted; 0 for none."] = 0
    seen: Annotated[int, "Severity that it has now."] = 0
    since: Annotated[float, "When it got it, steady time. [s]"] = 0.0


class AlarmWatch:
    """Notes alarms of one robot that last, and restarts of its monitors."""

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace.strip("/")
        self._alarms: dict[str, _Alarm] = {}
        self._restarts: dict[str, int] = {}

    def take(self, statuses: Iterable[StatusHead], stamp_ns: int, now: float) -> list[Event]:
        """Return what is to be noted.

        Args:
            statuses: Of any robots.
            stamp_ns: Of the message. [ns]
            now: Steady time. [s]
        """
        found: list[tuple[str, str]] = []
        for status in statuses:
            node, _, subject = status.name.partition(": ")
            namespace, _, node = node.strip("/").rpartition("/")
            if namespace != self._namespace or not node.endswith("_monitor") or not subject:
                continue
            name = f"{node}: {subject}"
            if name not in self._alarms and len(self._alarms) >= MAX_STATUSES:
                continue
            found += self._changed(name, status, now)
            if status.restarts.isdecimal():
                count, before = int(status.restarts), self._restarts.get(name)
                self._restarts[name] = count
                if before is not None and count > before:
                    found.append(("restart", f"{node} was started again"))
        return [
            Event(stamp_ns + place, kind, shown(text, MAX_TEXT))
            for place, (kind, text) in enumerate(found)
        ]

    def _changed(self, name: str, status: StatusHead, now: float) -> list[tuple[str, str]]:
        alarm = self._alarms.setdefault(name, _Alarm(since=now))
        severity = SEVERITY.get(status.level, max(SEVERITY.values()))
        if severity != alarm.seen:
            alarm.seen, alarm.since = severity, now
        if severity == alarm.noted or now - alarm.since < (LASTING if severity else OVER):
            return []
        alarm.noted = severity
        if severity:
            return [("alarm", f"{name}: {WORDS[severity]}: {status.message}")]
        return [("alarm_ended", name)]
