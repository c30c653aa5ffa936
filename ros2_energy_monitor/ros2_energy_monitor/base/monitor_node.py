# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What every monitor shares: a model, a tick, a report once a second, a life cycle."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar, cast

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.foundation.errors import (
    ParameterError,
    RobotDescriptionError,
    RobotEnergyError,
    UrdfAwaitedError,
)
from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.model import RobotModel, load
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.streams import StampOrder
from ros2_energy_monitor.base.entities import EntitySnapshot
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.lifecycle import ManagedNode
from ros2_energy_monitor.base.node_parameters import Common
from ros2_energy_monitor.base.parameter_changes import AT_START, ParameterChanges
from ros2_energy_monitor.base.parameters import declare, parameter_lines, require, reread
from ros2_energy_monitor.base.publishers import PacedPublisher
from ros2_energy_monitor.base.robot_description import AwaitedDescription, ComparedDescription
from ros2_energy_monitor.base.tick_statistics import TickStatistics
from ros2_energy_monitor.diagnostics.node import NodeWatch
from ros2_energy_monitor.diagnostics.reporter import REPORT_PERIOD, Reporter, Source, StatusBuilder

P = TypeVar("P", bound=Common)
ROBOT_DESCRIPTION = "robot_description"


class MonitorNode(ManagedNode, Generic[P]):
    """Base of the monitors.

    configure reads the model and calls `set_up`; while the node is active, `take` runs every
    ``TAKEN_EVERY``, `tick` at the tick rate and `report` once a second; while it is inactive,
    what arrives is discarded and counted. Diagnostics are published in every state. With the
    parameter ``autostart`` the constructor configures and activates.

    Ticks follow the steady clock, so that queues are drained also while simulated time
    stands still.

    Attributes:
        inputs: Every inbox with the account of its messages, from `set_up`.
        orders: Orders of stamps in which becoming active leaves a gap, from `set_up`.
        paced: Where power states are queued, from `set_up`; None where the node has none.
    """

    NAME: ClassVar[str]
    PARAMETERS: ClassVar[type[Common]]
    UNIQUE_TOPIC: ClassVar[str] = ""  # that no other node may publish
    # Queues are emptied at the last tick within it: a step costs as much for few messages. [s]
    TAKEN_EVERY: ClassVar[float] = 0.16
    parameters: P
    model: RobotModel

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        self.inputs: list[tuple[Inbox, RejectionLog]] = []
        self.orders: list[StampOrder] = []
        self.sources: list[Source] = []
        self.paced: PacedPublisher | None = None
        self._description: AwaitedDescription | ComparedDescription | None = None
        self.exit_stack = ExitStack()
        self._inventory: list[str] = []
        try:
            self.parameters = declare(self, self._parameters_type, AT_START)
            _, self._entries = reread(self, self._parameters_type)
            self._steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._reporter = Reporter(self)
            self._tick_statistics = TickStatistics(1.0 / self.parameters.tick_rate)
            self._watch = NodeWatch(self, self._tick_statistics, self.UNIQUE_TOPIC)
            self.create_timer(REPORT_PERIOD, self._report, clock=self._steady)
            ParameterChanges(self, lambda: self._entries, self._parameters_changed)
            self.autostart(enabled=self.parameters.autostart)
        except Exception:
            self.destroy_node()
            raise

    @property
    def _parameters_type(self) -> type[P]:
        return cast("type[P]", self.PARAMETERS)

    @abstractmethod
    def set_up(self) -> None:
        """Make stages, publishers and inboxes; fill `inputs`, `orders`, `sources`."""

    @abstractmethod
    def take(self) -> None:
        """Take what has arrived, run the stage once and publish or queue what it gave."""

    @property
    def taken_ticks(self) -> int:
        """Ticks from one emptying of the queues to the next."""
        return max(1, int(self.TAKEN_EVERY * self.parameters.tick_rate + 1e-9))

    def take_now(self) -> None:
        """Take what has arrived without waiting for the next time, while active."""
        if self.active:
            self.take()

    def tick(self) -> None:
        """Publish what is queued, one after the other."""
        if self.paced is not None:
            self.guard.run("publish.power", self.paced.tick)

    def report(self) -> None:
        """Publish, once a second while active, what has no rate of its own."""

    def configure(self) -> None:
        """Read the model, set up and start to drain, as soon as the robot is described."""
        self.parameters, self._entries = reread(self, self._parameters_type)
        require(self, self._entries)
        name = self.parameters.model
        try:
            model = load(name)
        except UrdfAwaitedError as awaited:
            self._description = AwaitedDescription(
                self,
                awaited.topic,
                lambda urdf_xml: load(name, urdf_xml),
                self._adopt,
                self.resume_autostart,
            )
            self.get_logger().info("; ".join(self._description.sentences()))
        else:
            self._description = ComparedDescription(self, ROBOT_DESCRIPTION, model)
            self._set_up(model)

    def activate(self) -> None:
        """Discard what came before; the time until now is a gap."""
        if not self.ready and self._description is not None:
            raise RobotDescriptionError("; ".join(self._description.sentences()))
        self._discard()
        for order in self.orders:
            order.interrupt()
        robot = self.model.robot
        self.get_logger().info(f"{shown(robot.type)}, model {self._model_id}, is monitored")

    def _parameters_changed(self, names: Sequence[str]) -> None:
        """Let what can change at once count now, and the rest from the next start on."""
        if not self.active:
            self.outdated = True
            try:  # what a new group has is declared, so that it can be set next
                _, self._entries = reread(self, self._parameters_type)
            except ParameterError:
                return  # said by configure, if it is still so then
            return
        values = {name: self.get_parameter(name).value for name in names}
        self.parameters = replace(self.parameters, **values)
        self.parameters_changed()

    def parameters_changed(self) -> None:
        """Use the parameters that can change while active."""
        for inbox, _ in self.inputs:
            inbox.renew_after(self.parameters.resubscribe_after)

    def log_inventory(self, robot: Robot) -> None:
        """Log what of the robot is modelled and what is not, unless it was logged before."""
        lines = [shown(line, MAX_LINE) for line in robot.inventory.sentences()]
        if lines != self._inventory:
            self._inventory = lines
            joints = robot.inventory.joints
            modelled = ", ".join(joint.name for joint in joints if joint.modelled)
            locked = ", ".join(joint.name for joint in joints if not joint.modelled)
            text = f"models {modelled}" + (f"; does not model {locked}" if locked else "")
            self.get_logger().info(shown(text, MAX_LINE))
            for line in lines:
                self.get_logger().debug(line)

    def deactivate(self) -> None:
        """Take and publish what still waits."""
        self.tick()

    def cleanup(self) -> None:
        """Close what is held; forget inputs and sources, whose entities cleanup destroys."""
        self.exit_stack.close()
        self.inputs, self.orders, self.sources, self.paced = [], [], [], None
        self._description = None

    @property
    def ready(self) -> bool:
        """Whether the robot is described."""
        return self._description is None or not self._description.waits

    def _adopt(self, model: RobotModel) -> None:
        """Set up with a model that came late; if that fails, wait on as before."""
        before = EntitySnapshot(self)
        try:
            self._set_up(model)
        except RobotEnergyError:
            self.exit_stack.close()
            before.restore()
            self.inputs, self.orders, self.sources, self.paced = [], [], [], None
            raise

    def _set_up(self, model: RobotModel) -> None:
        self.model, self._model_id = model, model.model_id
        self._hardware_id = hardware_id(model, self.get_namespace())
        self.set_up()
        for line in parameter_lines(self):
            self.get_logger().debug(line)
        self._ticks = 0  # until queues are emptied
        self.create_timer(1.0 / self.parameters.tick_rate, self._tick, clock=self._steady)

    def _tick(self) -> None:
        with self._tick_statistics.tick():
            if due := self._ticks <= 1:
                self._ticks = self.taken_ticks
            else:
                self._ticks -= 1
            if not self.active:
                if due:
                    self._discard()
                return
            if due:
                self.take()
            self.tick()

    def _report(self) -> None:
        if self.active:
            self.guard.run("report", self.report)
        for inbox, _ in self.inputs:
            self.guard.run("subscribing", inbox.resubscribe_if_silent)
        described = [] if self._description is None else self._description.sentences()
        sources = [self.guard.run("diagnostics", source) for source in self.sources]
        node = self.guard.run("diagnostics", lambda: self._watch.check(self.inputs, described))
        if node is None:
            node = StatusBuilder("node")
            self.guard.check(node)
        statuses = [node, *(found for found in sources if found is not None)]
        self._reporter.publish(statuses, self._hardware_id if self.sources else "")

    def drain(self, inboxes: Sequence[Inbox]) -> list[RawBatch]:
        """Return one batch per inbox in which messages wait."""
        batches: list[RawBatch] = []
        for inbox in inboxes:
            if (batch := self.guard.run(f"queue.{inbox.topic}", inbox.drain)) is not None:
                batches.append(batch)
        return batches

    def _discard(self) -> None:
        for inbox, rejections in self.inputs:
            self.guard.run(f"queue.{inbox.topic}", partial(inbox.discard, rejections))


def hardware_id(model: RobotModel, namespace: str) -> str:
    """Return what differs between robots of a type: type, serial number, namespace but the root."""
    robot = model.robot
    place = f"({namespace})" if namespace.strip("/") else ""
    return " ".join(shown(part) for part in (robot.type, robot.serial, place) if part)
