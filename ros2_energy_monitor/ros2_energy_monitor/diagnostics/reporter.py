"""What the monitors say about themselves on ``/diagnostics``, once a second.

Every status has numeric key values and one sentence that tells all that is wrong, the
worst first, or that all is well. The worst finding decides the level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

Number = float | int
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
MOST_REMARKS = 100  # kept, so that a topic of ever new names cannot fill the memory
SEVERITY = {OK: 0, WARN: 1, STALE: 2, ERROR: 3}


@dataclass
class Findings:
    """What one status collects.

    Attributes:
        name: What the status is about.
        values: Numeric key values.
        remarks: Sentences for the log, each said once in the life of the node.
    """

    name: str
    values: dict[str, Number] = field(default_factory=lambda: dict[str, Number]())
    remarks: list[str] = field(default_factory=lambda: list[str]())
    _found: list[tuple[bytes, str]] = field(default_factory=lambda: list[tuple[bytes, str]]())

    def add(self, level: bytes, message: str) -> None:
        """Note something wrong."""
        self._found.append((level, message))

    @property
    def level(self) -> bytes:
        """The worst level found."""
        return max((level for level, _ in self._found), key=SEVERITY.__getitem__, default=OK)

    @property
    def message(self) -> str:
        """All that is wrong in one sentence, the worst first."""
        worst_first = sorted(self._found, key=lambda one: -SEVERITY[one[0]])
        return "; ".join(message for _, message in worst_first) or "all is well"

    def __len__(self) -> int:
        """Return how many things are wrong."""
        return len(self._found)


Source = Callable[[], Findings]


class Reporter:
    """Publishes the findings of a node.

    Args:
        node: The node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._said: set[str] = set()

    def publish(self, statuses: list[Findings], model_id: str) -> None:
        """Publish the statuses, and log the remarks that are new.

        Args:
            statuses: What was found, by subject.
            model_id: Identity of the model, which becomes the hardware id; empty for none.
        """
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [self._status(found, model_id) for found in statuses]
        self._publisher.publish(message)
        for remark in (remark for found in statuses for remark in found.remarks):
            if remark not in self._said and len(self._said) < MOST_REMARKS:
                self._said.add(remark)
                self._node.get_logger().info(remark)

    def _status(self, found: Findings, model_id: str) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=found.level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {found.name}",
            message=found.message,
            hardware_id=model_id,
            values=[
                KeyValue(key=key, value=_text(value))
                for key, value in {**found.values, "findings": len(found)}.items()
            ],
        )


def _text(value: Number) -> str:
    return str(value) if isinstance(value, int) else f"{value:.6g}"
