# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: hands energy and power to the systems of a plant, over MQTT and OPC UA."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyRegisters, PowerState

from robot_energy.foundation.errors import ParameterError
from robot_energy.messages.fields import RECORDING
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.parameters import declare
from ros2_energy_monitor.base.publishers import POWER_TOPIC, REGISTERS_TOPIC, best_effort
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.diagnostics.reporter import REPORT_PERIOD, WARN, Reporter, StatusBuilder
from ros2_energy_monitor.exporters.kinds import EXPORTERS, exporter_parameters
from ros2_energy_monitor.exporters.values import Exporter, Newest, Topic

TICK_PERIOD = 0.1  # [s]


class EnergyExporter(Node):
    """Runs the exporters that are named on ``energy/power`` and ``energy/registers``."""

    NAME = "energy_exporter"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        self.guard = Guard(self.NAME, options.get("context"))
        self.exporters: dict[str, Exporter] = {}
        try:
            self.parameters = declare(self, exporter_parameters())
            if not self.parameters.exporters:
                raise ParameterError("exporters is empty", EXPORTERS.expected)
            for name in self.parameters.exporters:
                kind = EXPORTERS[name]
                made = kind.make(getattr(self.parameters, name), self.parameters.robot_name)
                made.start()
                self.exporters[name] = made
                self.get_logger().info(f"exporting over {kind.label}")
        except Exception:
            self.destroy_node()
            raise
        self.newest = Newest(self.parameters.stale_after)
        for kind, topic, what in (
            (PowerState, POWER_TOPIC, Topic.POWER),
            (EnergyRegisters, REGISTERS_TOPIC, Topic.REGISTERS),
        ):
            self.create_subscription(kind, topic, partial(self._take, what), best_effort(10))
        self._reporter = Reporter(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TICK_PERIOD, self.tick, clock=steady)
        self.create_timer(REPORT_PERIOD, self.report, clock=steady)

    def _take(self, topic: Topic, message: Any) -> None:
        if message.header.frame_id != RECORDING:
            self.newest.take(topic, message, time.monotonic())

    def tick(self) -> None:
        now = time.monotonic()
        for name, exporter in self.exporters.items():
            self.guard.run(name, partial(exporter.publish, self.newest, now))

    def report(self) -> None:
        node = StatusBuilder("node")
        self.guard.check(node)
        now = time.monotonic()
        if not any(self.newest.is_current(topic, now) for topic in Topic):
            node.add(WARN, "neither energy/power nor energy/registers arrives")
        statuses = [node]
        for name, exporter in self.exporters.items():
            statuses.append(StatusBuilder(name))
            self.guard.run("diagnostics", partial(exporter.check, statuses[-1]))
        self._reporter.publish(statuses, "")

    def destroy_node(self) -> None:
        for exporter in self.exporters.values():
            self.guard.run("stop", exporter.stop)
        super().destroy_node()


main = partial(run, EnergyExporter)
