"""Judges the node itself: state, pace, memory, clock, name, and whether its accounts add up."""

from __future__ import annotations

import time
from collections.abc import Iterable

from lifecycle_msgs.msg import State
from rclpy.lifecycle import LifecycleNode

from robot_energy.ingest import Accounting
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.findings import ERROR, WARN, Findings
from ros2_energy_monitor.suppliers import LOOK_PERIOD
from ros2_energy_monitor.tempo import Tempo, resident_memory

BUSY = 0.8  # share of the time beyond which a node will soon not keep up


class NodeWatch:
    """Judges one node.

    Args:
        node: The node.
        tempo: Pace of its ticks.
        unique_topic: Topic that only one node may publish; empty for none.
    """

    def __init__(self, node: LifecycleNode, tempo: Tempo, unique_topic: str = "") -> None:
        self._node, self._tempo, self._topic = node, tempo, unique_topic
        self._looked: float | None = None
        self._twins: list[str] = []

    def judge(
        self, inputs: Iterable[tuple[Inbox, Accounting]], warnings: Iterable[str] = ()
    ) -> Findings:
        """Return the status of the node.

        Args:
            inputs: Every inbox with the account of its messages.
            warnings: What else is to be said.
        """
        found = Findings("node")
        number, label = self._node._state_machine.current_state
        pace = self._tempo.take()
        found.values |= {"lifecycle_state": number, **pace, "memory": resident_memory()}
        for sentence in unbalanced(inputs):
            found.add(ERROR, sentence)
        for sentence in warnings:
            found.add(WARN, sentence)
        if number != State.PRIMARY_STATE_ACTIVE:
            found.add(WARN, f"the node is {label}: nothing is counted or published")
        if pace["busy_share"] > BUSY:
            found.add(WARN, f"ticks take {pace['busy_share']:.0%} of the time")
        if not self._node.get_clock().now().nanoseconds:
            found.add(WARN, "use_sim_time is on and /clock is silent: waiting for clock")
        for sentence in self._look():
            found.add(WARN, sentence)
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


def unbalanced(inputs: Iterable[tuple[Inbox, Accounting]]) -> list[str]:
    """Return one sentence for each account that does not add up; there must never be one.

    Args:
        inputs: Every inbox with its account; several inboxes may share one.
    """
    accounts: dict[int, tuple[Accounting, list[Inbox]]] = {}
    for inbox, account in inputs:
        accounts.setdefault(id(account), (account, []))[1].append(inbox)
    sentences: list[str] = []
    for account, inboxes in accounts.values():
        drained, rejected = sum(inbox.received for inbox in inboxes), account.rejected.total()
        if not (account.balanced and drained == account.received):
            sentences.append(
                f"accounting of {', '.join(inbox.topic for inbox in inboxes)} does not add up: "
                f"{drained} messages taken, {account.received} received, "
                f"{account.accepted} accepted, {rejected} rejected, {account.waiting} waiting"
            )
    return sentences
