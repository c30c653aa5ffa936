# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: a live table of the monitors' topics on the terminal, plain lines without one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rich.console import Console as Terminal
from rich.console import Group
from rich.live import Live
from rich.text import Text
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, PowerState

from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.foundation.units import JOULE_PER_WH
from robot_energy_report.formats import summing
from robot_energy_report.page.stale import is_stale
from robot_energy_report.printing import fitted_table, width_of
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
from ros2_energy_monitor.diagnostics.reporter import ALL_IS_WELL

PHASES = {
    PowerState.PHASE_UNKNOWN: "unknown",
    PowerState.PHASE_HOLD: "holds",
    PowerState.PHASE_MOTION: "moves",
    PowerState.PHASE_GENERATING: "generates",
}
# What predicted_grid_power is the sum of, in the order of the power chain.
PARTS = ("rigid", "friction", "drives", "supply", "brake", "capacitor")
SMOOTHING = 0.5  # time constant of the powers shown [s]
MAX_STATUSES = 64  # kept, so that a topic of ever new names cannot fill the memory
STARTING = 5.0  # trouble of monitors that have sent no power yet is shown after this [s]


class ConsoleView:
    """Keeps the latest of every topic of the monitors.

    Powers are smoothed over about half a second, so that they can be read.
    """

    def __init__(self) -> None:
        self.registers: EnergyRegisters | None = None
        self.friction: JointFriction | None = None
        self._power: PowerState | None = None
        self._powers: dict[str, float] = {}
        self._received = 0.0
        self._begun: float | None = None  # when it was first shown
        self._status: dict[str, DiagnosticStatus] = {}

    def take_power(self, message: PowerState, now: float) -> None:
        """Take a power state.

        Args:
            now: Time of receipt on any steady clock. [s]
        """
        self._power, self._received = message, now
        share = min(1.0, message.period / SMOOTHING) if message.period > 0 else 1.0
        before, self._powers = self._powers, {}  # names that have gone are forgotten
        for key, value in _powers(message):
            old = before.get(key, math.nan)
            self._powers[key] = value if math.isnan(old) else old + share * (value - old)

    def take_diagnostics(self, message: DiagnosticArray) -> None:
        """Take the statuses of the monitors; those of other nodes are left out."""
        for status in message.status:
            known = status.name in self._status or len(self._status) < MAX_STATUSES
            if "_monitor: " in status.name and known:
                self._status[status.name] = status

    @property
    def complete(self) -> bool:
        return None not in (self._power, self.registers, self.friction)

    def line(self, now: float) -> str:
        """Return the state in one line.

        Args:
            now: Time on the clock of `take_power`. [s]
        """
        power, registers = self._power, self.registers
        if power is None or self._silent(power, now):
            return self._waiting(now)
        parts = [
            f"from the grid {self._watts('predicted')} W, friction {self._watts('friction')} W",
            PHASES.get(power.phase, "unknown"),
        ]
        predicted, measured = self._powers["at_meter"], self._powers["measured"]
        if not math.isnan(measured):
            parts.append(
                f"at the meter predicted {_number(predicted, 0)} W, measured "
                f"{_number(measured, 0)} W ({_error(predicted, measured)})"
            )
        if registers is not None and not math.isnan(registers.measured_energy):
            parts.append(_compared(registers))
        degc = [joint.motor_temperature_degc for joint in power.joints]
        parts.append(
            f"motors {_number(min(degc, default=math.nan), 0)} to "
            f"{_number(max(degc, default=math.nan), 0)} degC"
        )
        trouble = self._trouble()
        return ", ".join(parts) + (f"; {trouble}" if trouble else "")

    def energy_error(self) -> str:
        """Return predicted and measured energy of all that was compared, in one line."""
        registers = self.registers
        if registers is None or math.isnan(registers.measured_energy):
            return "no energy was compared with a meter"
        seconds = registers.comparison_time
        return f"Live part, at the meter over {seconds:.0f} s: {_compared(registers)}"

    def table(self, now: float, width: int) -> Group:
        """Return the whole state as tables for the terminal; one line where they do not fit.

        Args:
            now: As of `take_power`. [s]
        """
        power = self._power
        if power is None or self._silent(power, now):
            return Group(Text(self._waiting(now), "" if power is None else "red"))
        state = f"robot {PHASES.get(power.phase, 'unknown')}"
        trouble = self._trouble()
        tables = [self._balance(width), self._meter(width), self._joints(power, width)]
        if max(width_of(table) for table in tables) > width:
            return Group(Text(self.line(now)))  # a live display would cut what is wider
        return Group(
            Text(f"{state}, coverage {_number(power.coverage, 3)}", "italic"),
            Text(trouble or self._notes() or ALL_IS_WELL, "yellow" if trouble else "green"),
            *tables,
        )

    def _balance(self, width: int) -> Group:
        """Predicted power and its parts, which sum to it."""
        parts = [None if math.isnan(self._powers[key]) else self._powers[key] for key in PARTS]
        return fitted_table(
            ("from the grid", "predicted", *PARTS),
            [("power [W]", self._watts("predicted"), *summing(parts, 0))],
            width,
        )

    def _meter(self, width: int) -> Group:
        """Predicted and measured at the meter, over the same intervals."""
        predicted, measured = self._powers["at_meter"], self._powers["measured"]
        rows = [
            (
                "power [W]",
                _number(predicted, 0),
                _number(measured, 0),
                _number(predicted - measured, 0),
                _error(predicted, measured),
            )
        ]
        registers = self.registers
        if registers is not None:
            predicted, measured = registers.predicted_energy_at_meter, registers.measured_energy
            rows.append(
                (
                    "energy [Wh]",
                    _wh(predicted),
                    _wh(measured),
                    _wh(predicted - measured),
                    _error(predicted, measured),
                )
            )
        return fitted_table(("at the meter", "predicted", "measured", "error", ""), rows, width)

    def _joints(self, power: PowerState, width: int) -> Group:
        degc: dict[str, Any] = {}
        if self.friction is not None:
            names = self.friction.joint_names
            degc = dict(zip(names, self.friction.motor_temperature_degc, strict=False))
        return fitted_table(
            ("joint", "drive [W]", "friction [W]", "[degC]", "coulomb [N m]", "viscous [mN m s]"),
            [
                (
                    shown(joint.name),
                    self._watts(f"{joint.name}.drive_power"),
                    self._watts(f"{joint.name}.friction_power"),
                    _number(degc.get(joint.name, joint.motor_temperature_degc), 0),
                    _number(joint.coulomb, 3),
                    _number(1e3 * joint.viscous, 2),
                )
                for joint in power.joints
            ],
            width,
        )

    def _waiting(self, now: float) -> str:
        """What to say without powers; a healthy system is in trouble while it starts."""
        self._begun = now if self._begun is None else self._begun
        totals = "" if self.registers is None else f"; {_totals(self.registers)}"
        if self._power is not None:
            trouble = f"; {trouble}" if (trouble := self._trouble()) else ""
            return f"no power state for {now - self._received:.0f} s{totals}{trouble}"
        if now - self._begun < STARTING:
            return f"waiting for the first power state{totals}"
        if not self._status:
            return (
                "no monitor was found yet: start one, or start the console in the namespace and "
                "ROS_DOMAIN_ID of the monitor"
            )
        return f"no power state yet{totals}; {self._trouble() or self._notes() or ALL_IS_WELL}"

    def _silent(self, power: PowerState, now: float) -> bool:
        """Whether the power that was shown last is too old."""
        return is_stale(now - self._received, power.period)

    def _watts(self, key: str) -> str:
        return _number(self._powers.get(key, math.nan), 0)

    def _notes(self) -> str:
        """What to know though nothing is wrong, such as that there is no meter."""
        said = dict.fromkeys(status.message for status in self._status.values())
        return "; ".join(message for message in said if message != ALL_IS_WELL)

    def _trouble(self) -> str:
        bad = [status for status in self._status.values() if status.level != DiagnosticStatus.OK]
        return "; ".join(shown(f"{status.name}: {status.message}", MAX_LINE) for status in bad)


def _powers(message: PowerState) -> Iterator[tuple[str, float]]:
    yield "predicted", message.predicted_grid_power
    yield "at_meter", message.predicted_power_at_meter
    yield "measured", message.measured_power
    yield "rigid", message.rigid_power
    yield "friction", message.friction_power
    yield "drives", message.drive_loss
    yield "supply", message.loss_dc + message.loss_grid
    yield "brake", message.brake_power
    yield "capacitor", message.capacitor_power
    joint: Any
    for joint in message.joints:
        yield f"{joint.name}.drive_power", joint.drive_power
        yield f"{joint.name}.friction_power", joint.friction_power


def _totals(registers: EnergyRegisters) -> str:
    """What was counted so far, as a robot that is switched off leaves it."""
    if not registers.observed_time > 0.0:
        return "nothing counted yet"
    net = registers.predicted_import_energy - registers.predicted_return_energy
    text = f"counted {_wh(net)} Wh from the grid"
    if math.isnan(registers.measured_energy):
        return text
    return f"{text}, at the meter {_compared(registers)}"


def _compared(registers: EnergyRegisters) -> str:
    predicted, measured = registers.predicted_energy_at_meter, registers.measured_energy
    return (
        f"{_wh(predicted)} Wh predicted, {_wh(measured)} Wh measured "
        f"({_error(predicted, measured)})"
    )


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _wh(joule: float) -> str:
    return _number(joule / JOULE_PER_WH, 2)


def _error(predicted: float, measured: float) -> str:
    """Predicted minus measured, over measured."""
    if not measured or math.isnan(predicted - measured):
        return "-"
    return f"{100.0 * (predicted - measured) / abs(measured):+.1f} %"


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
