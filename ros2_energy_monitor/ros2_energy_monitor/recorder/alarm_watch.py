# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Diagnostic statuses of one robot -> events of its history: alarms, their ends, restarts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus

from robot_energy.foundation.shown_text import shown
from robot_energy.history.differences import Event
from ros2_energy_monitor.diagnostics.reporter import SEVERITY

LASTING = 10.0  # how long an alarm lasts before it is noted [s]
OVER = 60.0  # how long all is well before it has ended; one that comes again is the same [s]
MAX_STATUSES = 200  # of a robot
MAX_TEXT = 300  # characters
WORDS = ("ok", "warning", "stale", "error")


@dataclass
class _Alarm:
    """How a status stands.

    Attributes:
        noted: Severity of the alarm that was noted; 0 for none.
        seen: Severity that it has now.
        since: When it got it, steady time. [s]
    """

    noted: int = 0
    seen: int = 0
    since: float = 0.0


class AlarmWatch:
    """Notes alarms of one robot that last, and restarts of its monitors.

    Args:
        namespace: Of the robot's monitors, with or without slashes.
    """

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace.strip("/")
        self._alarms: dict[str, _Alarm] = {}
        self._restarts: dict[str, int] = {}

    def take(self, statuses: Iterable[DiagnosticStatus], stamp_ns: int, now: float) -> list[Event]:
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
            found += self._restarted(name, status)
        return [
            Event(stamp_ns + place, kind, shown(text, MAX_TEXT))
            for place, (kind, text) in enumerate(found)
        ]

    def _changed(self, name: str, status: DiagnosticStatus, now: float) -> list[tuple[str, str]]:
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

    def _restarted(self, name: str, status: DiagnosticStatus) -> list[tuple[str, str]]:
        for pair in status.values:
            if pair.key == "restarts" and pair.value.isdecimal():
                count, before = int(pair.value), self._restarts.get(name)
                self._restarts[name] = count
                if before is not None and count > before:
                    return [("restart", f"{name.partition(':')[0]} was started again")]
        return []
