# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Feeds the history with registers, job intervals, alarms and learned friction of one robot."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyInterval, EnergyRegisters, FrictionCondition
from ros2_energy_msgs.srv import ListIntervals

from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.foundation.described import documented
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.units import SECOND_NS
from robot_energy_history.differences import Event
from robot_energy_history.readings import FrictionDecoder, ReadingDecoder
from robot_energy_history.store import HistoryStore
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.played_recording import Change, PlayedRecording
from ros2_energy_monitor.base.publishers import CONDITION_TOPIC, REGISTERS_TOPIC, latched, reliable
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


DEPTH = 120  # registers that wait for the next look: a minute and more [messages]
SILENCE = 30.0  # of a robot, after which it is subscribed and asked again [s]
LIST = "list_intervals"


class WhileAsked(CallbackGroup):
    """A group whose clients enter the wait set of an executor while an answer is awaited.

    An executor looks at all that it waits for each time that it wakes, at hundreds of clients.
    """

    asked = False

    def can_execute(self, entity: Any) -> bool:
        """Return whether an answer is awaited.

        Argument as in `rclpy.callback_groups.CallbackGroup.can_execute`.
        """
        return self.asked

    def beginning_execution(self, entity: Any) -> bool:
        """Return True; as in `rclpy.callback_groups.CallbackGroup.beginning_execution`."""
        return True

    def ending_execution(self, entity: Any) -> None:
        """Do nothing; as in `rclpy.callback_groups.CallbackGroup.ending_execution`."""


class RecordedRobot:
    """One robot whose registers are recorded, by the namespace of its monitors."""

    def __init__(self, node: Node, namespace: str, store: HistoryStore) -> None:
        self._node, self._store = node, store
        self.namespace = namespace.strip("/")
        self.name = self.namespace or "robot"
        self._prefix = f"/{self.namespace}/" if self.namespace else "/"
        topic = f"{self._prefix}{REGISTERS_TOPIC}"
        self._inbox = Inbox(node, EnergyRegisters, topic, reliable(DEPTH), renew_after=SILENCE)
        self._played = PlayedRecording([self._inbox])
        self._decoder = ReadingDecoder()
        condition = f"{self._prefix}{CONDITION_TOPIC}"
        self._condition = Inbox(node, FrictionCondition, condition, latched(1))
        self._friction = FrictionDecoder()
        self._jobs: list[dict[str, Any]] = []  # of the newest answer
        self._recorded = 0  # registers left out since a player published them
        self._alarms = AlarmWatch(namespace)
        self._client: Client | None = None
        self._group = WhileAsked()
        self._listing: Any = None  # the answer that is awaited
        self._asked = 0.0  # when, steady time [s]
        self.heard = math.nan  # when registers came last, steady time [s]

    @property
    def malformed(self) -> int:
        """Messages that could not be read."""
        return self._decoder.malformed

    @property
    def played(self) -> int:
        """Messages left out, as they come from a recording that is played."""
        return self._recorded + self._decoder.recorded

    @property
    def lost(self) -> int:
        """Messages that were published and did not arrive."""
        return self._inbox.lost

    def take(self) -> None:
        """Hand what has arrived to the store, but for what comes from a recording."""
        met = [self._inbox.met()]
        change = Change.NONE if met == self._played.met else self._played.look(met)
        if change is Change.UNKNOWN:
            return
        batch = self._inbox.drain()
        if batch is None:
            return
        self.heard = time.monotonic()
        if self._played.players or change is Change.MIXED:
            self._recorded += len(batch)
        else:
            self._store.add(self.name, self._decoder.decode(batch))
        self._add_jobs()

    def take_statuses(self, statuses: Iterable[StatusHead], stamp_ns: int) -> None:
        """Hand alarms and restarts among diagnostic statuses to the store, but for played ones."""
        if self._recording:
            return
        events = self._alarms.take(statuses, stamp_ns, time.monotonic())
        if events:
            self._store.add_events(self.name, events)

    def look_after(self, services: Iterable[str]) -> None:
        """Take learned friction, ask for the job intervals, and subscribe again what is silent."""
        batch = self._condition.drain()
        if batch is not None and not self._recording:
            self._store.add_friction(self.name, self._friction.decode(batch))
        self._inbox.resubscribe_if_silent()
        if self._listing is not None and not self._listing.done():
            if time.monotonic() - self._asked < SILENCE:
                return
            self._listing.cancel()
        if self._client is None:
            for name in services:
                node, _, service = name.removeprefix(self._prefix).partition("/")
                if name.startswith(self._prefix) and node and service == LIST:
                    self._client = self._node.create_client(
                        ListIntervals, name, callback_group=self._group
                    )
                    break
        if self._client is not None and self._client.service_is_ready():
            self._asked = time.monotonic()
            self._group.asked = True
            self._listing = self._client.call_async(ListIntervals.Request())
            self._listing.add_done_callback(self._take_jobs)

    def _take_jobs(self, future: Any) -> None:
        self._group.asked = False
        response = None if future.cancelled() else future.result()
        if response is not None:
            self._add_jobs()
            self._jobs = [_job(one) for one in response.intervals if not one.is_open]

    def _add_jobs(self) -> None:
        """Hand jobs to the store, unless registers have shown since that they are a recording's."""
        jobs, self._jobs = self._jobs, []
        if not self._recording:
            self._store.add_jobs(self.name, jobs)

    @property
    def _recording(self) -> bool:
        """Whether what arrives is of a recording that is played, not of the robot."""
        return self._decoder.recording or bool(self._played.players)


def _job(interval: EnergyInterval) -> dict[str, Any]:
    """The row of a job; a job has far less than the energy that a float64 in J cannot resolve."""
    peak = interval.predicted_peak_power
    return {
        "id": interval.id,
        "start": interval.start.sec * SECOND_NS + interval.start.nanosec,
        "stop": interval.end.sec * SECOND_NS + interval.end.nanosec,
        "name": interval.name,
        "observed_ns": _whole(interval.observed_time * SECOND_NS),
        "gap_ns": _whole(interval.gap_time * SECOND_NS),
        "compared_ns": _whole(interval.comparison_time * SECOND_NS),
        "predicted_import_microjoule": _whole(interval.predicted_import_energy * PER_JOULE),
        "predicted_return_microjoule": _whole(interval.predicted_return_energy * PER_JOULE),
        "measured_microjoule": _whole(interval.measured_energy * PER_JOULE),
        "predicted_microjoule_at_meter": _whole(interval.predicted_energy_at_meter * PER_JOULE),
        "peak_power": peak if math.isfinite(peak) else None,
    }


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) and abs(value) < 2.0**53 else 0
