# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What the monitors say about themselves on ``/diagnostics``, once a second.

Every status has key values, most of them numbers, whose keys end with the unit where there is
one (``_s``, ``_j``, ``_mb``, ``_degc``), and one sentence. It says all that is wrong, the worst
first and what to do before what was found; else what is worth knowing though nothing is wrong,
or that all is well. The worst finding decides the level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from robot_energy.foundation.shown_text import MAX_LINE, shown, shown_lines
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.stamps import bounded
from robot_energy_report.page.alarms import REMEDY_KEY

Number = float | int
Value = Number | str
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
REPORT_PERIOD = 1.0  # [s]
MAX_REMARKS = 100  # kept, so that a topic of ever new names cannot fill the memory
ALL_IS_WELL = "all is well"
SEVERITY = {OK: 0, WARN: 1, STALE: 2, ERROR: 3}


@dataclass
class StatusBuilder:
    """What one status collects.

    Attributes:
        remarks: Sentences for the log, each logged once in the life of the node.
        notes: What to know though nothing is wrong, one sentence each; shown at level OK.
        remedies: Of the findings that have one; key values of their own, for the page.
    """

    name: str
    values: dict[str, Value] = field(default_factory=lambda: dict[str, Value]())
    remarks: list[str] = field(default_factory=lambda: list[str]())
    notes: list[str] = field(default_factory=lambda: list[str]())
    remedies: list[str] = field(default_factory=lambda: list[str]())
    _found: list[tuple[bytes, str]] = field(default_factory=lambda: list[tuple[bytes, str]]())

    def add(self, level: bytes, message: str, remedy: str = "") -> None:
        """Note something wrong.

        Args:
            remedy: What to do about it, a few words without a full stop. It goes before
                the message: what shows only the beginning of a text, as `ros2 topic echo`
                does, shows it then.
        """
        self._found.append((level, f"{remedy}: {message}" if remedy else message))
        if remedy:
            self.remedies.append(remedy)

    @property
    def level(self) -> bytes:
        return max((level for level, _ in self._found), key=SEVERITY.__getitem__, default=OK)

    @property
    def message(self) -> str:
        """All that is wrong in one sentence, the worst first."""
        worst_first = sorted(self._found, key=lambda one: -SEVERITY[one[0]])
        wrong = [message for _, message in worst_first]
        return "; ".join(wrong or self.notes) or ALL_IS_WELL

    def __len__(self) -> int:
        return len(self._found)


Source = Callable[[], StatusBuilder]


class Reporter:
    """Publishes the findings of a node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._logged: set[str] = set()

    def publish(self, statuses: list[StatusBuilder], hardware_id: str) -> None:
        """Publish the statuses, and log the remarks that are new."""
        message = DiagnosticArray()
        now = bounded(self._node.get_clock().now().nanoseconds)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, SECOND_NS)
        message.status = [self._status(found, hardware_id) for found in statuses]
        self._publisher.publish(message)
        for remark in (remark for found in statuses for remark in found.remarks):
            if remark not in self._logged and len(self._logged) < MAX_REMARKS:
                self._logged.add(remark)
                self._node.get_logger().info(shown_lines(remark))

    def _status(self, found: StatusBuilder, hardware_id: str) -> DiagnosticStatus:
        values = [(shown(key), _text(value)) for key, value in found.values.items()]
        remedies = enumerate(found.remedies, 1)
        values += [(f"{REMEDY_KEY}{number}", shown(text, MAX_LINE)) for number, text in remedies]
        values.append(("findings", str(len(found))))
        return DiagnosticStatus(
            level=found.level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {found.name}",
            message=shown(found.message, MAX_LINE),
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in values],
        )


def _text(value: Value) -> str:
    if isinstance(value, int | str):
        return shown(str(value))
    return f"{value:.0f}" if 1e6 <= abs(value) < 1e15 else f"{value:.6g}"
