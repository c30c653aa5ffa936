# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: motor temperatures in, friction coefficients of every joint out."""

from __future__ import annotations

from functools import partial

from robot_energy.messages.friction import FrictionWriter
from robot_energy.pipeline import FrictionStage
from robot_energy.timeline.blocks import FrictionBlock, TemperatureBlock
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.inputs import (
    temperature_inboxes,
    temperature_ingest,
    temperature_inputs,
)
from ros2_energy_monitor.base.monitor_node import MonitorNode
from ros2_energy_monitor.base.node_parameters import FrictionParameters
from ros2_energy_monitor.base.publishers import FRICTION_TOPIC, friction_publisher
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.diagnostics.energy import temperature_source


class FrictionMonitor(MonitorNode[FrictionParameters]):
    """Publishes ``energy/joint_friction`` at the start and at every new temperature."""

    NAME = "friction_monitor"
    PARAMETERS = FrictionParameters
    UNIQUE_TOPIC = FRICTION_TOPIC

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        self.ingest = temperature_ingest(self, self.parameters, self.model)
        self._stage = FrictionStage(self.model)
        self._writer = FrictionWriter(self.model)
        self._publisher = friction_publisher(self)
        self.temperatures: list[Inbox] = temperature_inboxes(
            self, self.ingest, self.parameters.resubscribe_after
        )
        self.inputs = temperature_inputs(self.ingest, self.temperatures)
        self.sources = [
            temperature_source(
                self.temperatures,
                self.ingest,
                self._stage,
                self.model,
                wanted=bool(self.parameters.temperature_sources),
            )
        ]

    def activate(self) -> None:
        """Publish the friction as it stands, also before the first temperature."""
        super().activate()
        self._publisher.publish(self._writer.encode(self._stage.latest()))

    def take(self) -> None:
        """Drain the temperatures and publish the friction from each of them onward."""
        temperatures = self.drain(self.temperatures)
        if not temperatures:
            return
        self._publish(
            self.guard.feed(
                "motor_temperatures",
                self.ingest.arrivals(temperatures),
                lambda: self._friction(self.ingest.step(temperatures)),
                self.ingest.restart,
            )
        )

    def deactivate(self) -> None:
        """Publish what still waits."""
        self.take()
        self._publish(
            self.guard.run("motor_temperatures", lambda: self._friction(self.ingest.flush()))
        )
        self.guard.run("publish.joint_friction", self._publisher.finish)

    def _friction(self, temperatures: TemperatureBlock | None) -> FrictionBlock | None:
        return None if temperatures is None else self._stage.step(temperatures)

    def _publish(self, block: FrictionBlock | None) -> None:
        if block is not None:
            publish, encode = self._publisher.publish, self._writer.encode
            self.guard.run("publish.joint_friction", lambda: publish(encode(block)))


main = partial(run, FrictionMonitor)
