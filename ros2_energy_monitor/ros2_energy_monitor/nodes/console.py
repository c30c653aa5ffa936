# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: a live table of the monitors' topics on the terminal, plain lines without one."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rich.console import Console as Terminal
from rich.live import Live
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, PowerState

from ros2_energy_monitor.base.node_parameters import ConsoleParameters
from ros2_energy_monitor.base.parameters import declare
from ros2_energy_monitor.base.publishers import (
    FRICTION_TOPIC,
    POWER_TOPIC,
    REGISTERS_TOPIC,
    best_effort,
    latched,
)
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.demo.console_view import ConsoleView


class Console(Node):
    """Shows predicted and measured power and energy, and every joint.

    Args:
        write: Prints a line where there is no terminal; None for the standard output.
    """

    NAME = "console"

    def __init__(self, write: Callable[[str], None] | None = None, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        parameters = declare(self, ConsoleParameters)
        self.board = ConsoleView()
        self._write = write or partial(print, flush=True)
        for kind, topic, take, qos in (
            (PowerState, POWER_TOPIC, self._take_power, best_effort(50)),
            (EnergyRegisters, REGISTERS_TOPIC, self._keep("registers"), best_effort(10)),
            (JointFriction, FRICTION_TOPIC, self._keep("friction"), latched(1)),
            (DiagnosticArray, "/diagnostics", self.board.take_diagnostics, best_effort(50)),
        ):
            self.create_subscription(kind, topic, take, qos)
        terminal = Terminal()
        self._live = Live(console=terminal, auto_refresh=False) if terminal.is_terminal else None
        if self._live is not None:
            self._live.start()
        period = 1.0 / parameters.refresh_rate if self._live else parameters.line_period
        self.create_timer(period, self.show, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def show(self) -> None:
        """Draw the table again, or print the next line."""
        now = time.monotonic()
        if self._live is not None:
            self._live.update(self.board.table(now, self._live.console.width), refresh=True)
        else:
            self._write(self.board.line(now))

    def close(self) -> None:
        """Draw a last time and leave the terminal as it was found."""
        self.show()
        if self._live is not None:
            self._live.stop()

    def _take_power(self, message: PowerState) -> None:
        self.board.take_power(message, time.monotonic())

    def _keep(self, name: str) -> Callable[[Any], None]:
        return lambda message: setattr(self.board, name, message)


main = partial(run, Console)
