# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Checks the node itself: state, pace, memory, clock, name, and whether its accounts add up."""

from __future__ import annotations

import time
from collections.abc import Iterable

from lifecycle_msgs.msg import State

from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.timeline.stamps import RANGE
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.lifecycle import ManagedNode
from ros2_energy_monitor.base.tick_statistics import TickStatistics, resident_memory
from ros2_energy_monitor.diagnostics.reporter import ERROR, WARN, StatusBuilder
from ros2_energy_monitor.diagnostics.topic_publishers import LOOK_PERIOD

BUSY = 0.8  # share of the time beyond which a node will soon not keep up


class NodeWatch:
    """Checks one node.

    Args:
        unique_topic: Topic that only one node may publish; empty for none.
    """

    def __init__(
        self, node: ManagedNode, tick_statistics: TickStatistics, unique_topic: str = ""
    ) -> None:
        self._node, self._tick_statistics, self._topic = node, tick_statistics, unique_topic
        self._looked: float | None = None
        self._twins: list[str] = []
        self._bad_clocks = 0

    def check(
        self, inputs: Iterable[tuple[Inbox, RejectionLog]], warnings: Iterable[str] = ()
    ) -> StatusBuilder:
        found = StatusBuilder("node")
        number, label = self._node._state_machine.current_state
        pace = self._tick_statistics.take()
        self._node.guard.check(found)
        found.values |= {
            "lifecycle_state": label,
            **pace,
            "memory_mb": resident_memory() * 1e-6,
        }
        for sentence in unbalanced(inputs):
            found.add(ERROR, sentence)
        for sentence in warnings:
            found.add(WARN, sentence)
        resting = f"the node is {label}: nothing is counted or published"
        if number == State.PRIMARY_STATE_INACTIVE:  # as asked for
            found.notes.append(resting)
        elif number != State.PRIMARY_STATE_ACTIVE:
            found.add(WARN, resting, "configure and activate it")
        if pace["busy_share"] > BUSY:
            share = f"{100 * pace['busy_share']:.0f} %"
            found.add(WARN, f"ticks take {share} of the time", "lower tick_rate")
        if self._node.bad_clocks > self._bad_clocks:
            new, self._bad_clocks = self._node.bad_clocks - self._bad_clocks, self._node.bad_clocks
            found.add(WARN, f"{new} times on /clock were ignored: not {RANGE}")
        if not self._node.get_clock().now().nanoseconds:
            found.add(
                WARN,
                "use_sim_time is on and /clock is silent: waiting for clock",
                "start the simulation",
            )
        if twins := self._look():
            found.add(
                WARN,
                "; ".join(twins),
                "stop one of them, or give each robot a namespace of its own",
            )
        return found

    def _look(self) -> list[str]:
        """Look for a second node of this name or purpose, at most every five seconds."""
        now = time.monotonic()
        if self._looked is not None and now - self._looked < LOOK_PERIOD:
            return self._twins
        self._looked = now
        node, name = self._node, self._node.get_fully_qualified_name()
        nodes = [
            f"{namespace.rstrip('/')}/{one}"
            for one, namespace in node.get_node_names_and_namespaces()
        ]
        self._twins = [f"{nodes.count(name)} nodes are named {name}"] * (nodes.count(name) > 1)
        if self._topic:
            endpoints = node.get_publishers_info_by_topic(self._topic)
            names = sorted(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in endpoints)
            if len(names) > 1:
                self._twins.append(f"{self._topic} is published by {' and '.join(names)}")
        return self._twins


def unbalanced(inputs: Iterable[tuple[Inbox, RejectionLog]]) -> list[str]:
    """Return one sentence for each account that does not add up; there must never be one."""
    accounts: dict[int, tuple[RejectionLog, list[Inbox]]] = {}
    for inbox, rejections in inputs:
        accounts.setdefault(id(rejections), (rejections, []))[1].append(inbox)
    sentences: list[str] = []
    for rejections, inboxes in accounts.values():
        drained, rejected = sum(inbox.received for inbox in inboxes), rejections.rejected.total()
        if not (rejections.balanced and drained == rejections.received):
            sentences.append(
                f"accounting of {', '.join(inbox.topic for inbox in inboxes)} does not add up: "
                f"{drained} messages taken, {rejections.received} received, "
                f"{rejections.accepted} accepted, {rejected} rejected, {rejections.waiting} waiting"
            )
    return sentences
