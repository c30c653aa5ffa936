# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Who publishes a topic, and why nothing may arrive from them.

The graph is asked at most every five seconds: that is expensive, and has leaked before.
"""

from __future__ import annotations

import time
from collections import Counter

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

LOOK_PERIOD = 5.0  # [s]
UNKNOWN = "_NODE_NAME_UNKNOWN_"
NOT_YET_KNOWN = "a node not yet known"


class TopicPublishers:
    """The publishers of one topic as the graph knows them.

    Attributes:
        names: Publishers by the full name of their node, with their number.
        complaints: Why nothing arrives from some of them, one sentence part for each reason.
    """

    def __init__(self, node: Node, topic: str, msgtype: str, qos: QoSProfile) -> None:
        self.names: Counter[str] = Counter()
        self.complaints: list[str] = []
        self._node, self._topic, self._msgtype, self._qos = node, topic, msgtype, qos
        self._looked: float | None = None

    def look(self, *, now: bool = False) -> None:
        """Ask the graph, unless it was asked within five seconds and nothing has changed since."""
        at = time.monotonic()
        if not now and self._looked is not None and at - self._looked < LOOK_PERIOD:
            return
        self._looked = at
        self.names.clear()
        self.complaints.clear()
        for endpoint in self._node.get_publishers_info_by_topic(self._topic):
            name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
            if UNKNOWN in name:  # its endpoint was discovered first
                name, self._looked = NOT_YET_KNOWN, None
            self.names[name] += 1
            if endpoint.topic_type != self._msgtype:
                self.complaints.append(
                    f"{name} publishes {self._topic} as {endpoint.topic_type}, not {self._msgtype}"
                )
                continue
            verdict, reason = qos_check_compatible(endpoint.qos_profile, self._qos)
            if verdict == QoSCompatibility.ERROR:
                self.complaints.append(
                    f"the quality of service of {self._topic} from {name} does not fit: "
                    f"{policies(reason)}"
                )


def policies(reason: str) -> str:
    """Return the mismatched policies from what the middleware says about them.

    Args:
        reason: Text of `rclpy.qos.qos_check_compatible`: parts between semicolons, the mismatches
            after ``ERROR:``.
    """
    parts = [part.strip() for part in reason.split(";")]
    found = [part.removeprefix("ERROR: ") for part in parts if part.startswith("ERROR: ")]
    return ", ".join(found).lower()
