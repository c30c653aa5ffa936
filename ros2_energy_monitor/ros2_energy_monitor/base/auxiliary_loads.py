# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Loads outside of the cabinet in a node: their topics, their account."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.inputs.auxiliary import LoadTopics
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.replay.replay_steps import LoadIngest, LoadReadings
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.inputs import SLOW_DEPTH, wanted_class
from ros2_energy_monitor.base.message_definitions import definitions_of
from ros2_energy_monitor.base.monitor_node import MonitorNode
from ros2_energy_monitor.base.node_parameters import AccountParameters
from ros2_energy_monitor.base.publishers import best_effort, latched

STATES = 10  # that a latched topic keeps


class LoadInput:
    """Topics of one load.

    Args:
        topics: Its sources, with full names; those whose messages are not installed are left out.
        keeps_state: Whether the publisher of the states keeps the last one.
        renew_after: Silence after which a topic is subscribed again. [s]

    Attributes:
        meters: Inboxes of its meter; one, or voltage and current.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        topics: LoadTopics,
        keeps_state: bool,
        renew_after: float,
    ) -> None:
        self.name = name
        known, found = typestore(), dict[str, list[Inbox]]()
        for what, source in (("meter", topics.meter), ("state", topics.state)):
            kind = (
                None if source is None else wanted_class(node, source.type, f"the {what} of {name}")
            )
            found[what] = []
            if source is None or kind is None:
                continue
            known = extended(known, definitions_of(kind))
            quality = (
                latched(STATES) if what == "state" and keeps_state else best_effort(SLOW_DEPTH)
            )
            # States come when they change: their silence is not a fault.
            renewed = renew_after if what == "meter" else None
            found[what] = [
                Inbox(node, kind, topic, quality, renew_after=renewed) for topic in source.topics
            ]
        self.meters, self.states = found["meter"], found["state"]
        self.ingest = LoadIngest(
            LoadTopics(
                topics.meter if self.meters else None, topics.state if self.states else None
            ),
            known,
        )

    @property
    def inboxes(self) -> list[Inbox]:
        """Of meter and states."""
        return [*self.meters, *self.states]

    @property
    def readers(self) -> list[tuple[MeterIngest, list[Inbox]]]:
        """What reads meter and states, with the inboxes of each."""
        both = ((self.ingest.meter, self.meters), (self.ingest.state, self.states))
        return [(reader, inboxes) for reader, inboxes in both if reader is not None]


class AuxiliaryLoads:
    """All loads of a model, counted by the energy account of a node.

    Args:
        account: The energy account, which counts the loads from now on.

    Attributes:
        inputs: The meters with the accounts of their messages. What meters say while the node is
            inactive is of no use; the last state is.
    """

    def __init__(
        self, node: MonitorNode[Any], given: AccountParameters, account: EnergyAccount
    ) -> None:
        self._node, loads = node, node.model.auxiliary or ()
        self.loads: list[LoadInput] = []
        sources: dict[str, LoadTopics] = {}
        resolve = node.resolve_topic_name
        for load in loads:
            meter, state = given.meter_of(load), given.state_of(load)
            wanted = state.source.resolved(resolve) if len(load.states) > 1 else None
            topics = LoadTopics(
                None if meter is None else meter.resolved(resolve), wanted, state.stale_after
            )
            sources[load.name] = topics
            self.loads.append(
                LoadInput(node, load.name, topics, state.latched, given.resubscribe_after)
            )
        self._account = AuxiliaryAccount(loads, sources, given.meter_max_gap) if loads else None
        account.auxiliary = self._account
        for sentence in given.unknown_loads(loads):
            node.get_logger().warning(sentence)
        self.inputs = [
            (inbox, load.ingest.meter.rejections)
            for load in self.loads
            if load.ingest.meter is not None
            for inbox in load.meters
        ]

    def take(self) -> None:
        """Use the messages that wait, each load by itself."""
        for load in self.loads:
            if batches := self._node.drain(load.inboxes):
                part = {batch.topic: batch for batch in batches}
                self._node.guard.feed(
                    f"auxiliary.{load.name}",
                    [
                        (
                            reader.rejections,
                            sum(len(part[i.topic]) for i in inboxes if i.topic in part),
                        )
                        for reader, inboxes in load.readers
                    ],
                    self._taking(load.name, partial(load.ingest.step, part)),
                    load.ingest.restart,
                )

    def flush(self) -> None:
        """Use what still waits, as before the node becomes inactive."""
        for load in self.loads:
            self._node.guard.run(
                f"auxiliary.{load.name}", self._taking(load.name, load.ingest.flush)
            )

    def _taking(self, name: str, read: Callable[[], LoadReadings]) -> Callable[[], None]:
        account = self._account
        return lambda: account.take(name, *read()) if account is not None else None
