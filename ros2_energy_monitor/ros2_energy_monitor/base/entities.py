# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The ROS entities of a node, so that all created after a moment can be destroyed again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node


class EntitySnapshot:
    """Remembers what a node consists of.

    Args:
        node: The node; what it has now is kept by `restore`.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._kept = {id(entity) for entity in self._all()}

    def restore(self) -> None:
        """Destroy every publisher, subscription, service, timer and guard that came later."""
        for entities, destroy in self._kinds():
            for entity in entities:
                if id(entity) not in self._kept:
                    destroy(entity)
        group = self._node.default_callback_group  # keeps a dead reference to each of them
        group.entities = {reference for reference in group.entities if reference() is not None}

    def __len__(self) -> int:
        """Return how many entities the node has now."""
        return len(self._all())

    def _all(self) -> list[object]:
        return [entity for entities, _ in self._kinds() for entity in entities]

    def _kinds(self) -> list[tuple[list[Any], Callable[[Any], bool]]]:
        """Entities of each kind, and what destroys one."""
        node = self._node
        return [
            (list(node.timers), node.destroy_timer),
            (list(node.services), node.destroy_service),
            (list(node.clients), node.destroy_client),
            (list(node.subscriptions), node.destroy_subscription),
            (list(node.publishers), node.destroy_publisher),
            (list(node.guards), node.destroy_guard_condition),
        ]
