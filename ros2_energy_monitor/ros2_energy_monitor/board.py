"""What the console and the demo show: the latest messages as a table or as one line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rich import box
from rich.table import Table
from rich.text import Text
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, PowerState

PHASES = {
    PowerState.PHASE_UNKNOWN: "unknown",
    PowerState.PHASE_HOLD: "holds",
    PowerState.PHASE_MOTION: "moves",
    PowerState.PHASE_GENERATING: "generates",
}
JOULE_PER_WH = 3600.0
SMOOTHING = 0.5  # time constant of the powers shown [s]
STALE_AFTER = 1.5  # without power states the table says so [s]


class Board:
    """Keeps the latest of every topic of the monitors.

    Powers are smoothed over about half a second, so that they can be read.

    Attributes:
        registers: Latest energy registers.
        friction: Latest friction coefficients.
    """

    def __init__(self) -> None:
        self.registers: EnergyRegisters | None = None
        self.friction: JointFriction | None = None
        self._power: PowerState | None = None
        self._powers: dict[str, float] = {}
        self._received = 0.0
        self._status: dict[str, DiagnosticStatus] = {}

    def take_power(self, message: PowerState, now: float) -> None:
        """Take a power state.

        Args:
            message: The message.
            now: Time of receipt on any steady clock. [s]
        """
        self._power, self._received = message, now
        share = min(1.0, message.period / SMOOTHING) if message.period > 0 else 1.0
        for key, value in _powers(message):
            old = self._powers.get(key, math.nan)
            self._powers[key] = value if math.isnan(old) else old + share * (value - old)

    def take_diagnostics(self, message: DiagnosticArray) -> None:
        """Take the statuses of the monitors; those of other nodes are left out."""
        for status in message.status:
            if "_monitor: " in status.name:
                self._status[status.name] = status

    @property
    def complete(self) -> bool:
        """Whether power, registers and friction have arrived."""
        return None not in (self._power, self.registers, self.friction)

    def line(self, now: float) -> str:
        """Return the state in one line."""
        power, registers = self._power, self.registers
        if power is None:
            return f"no power state yet; {self._trouble()}"
        parts = [
            f"predicted {self._watts('predicted_power')} W",
            f"measured {self._watts('measured_power')} W",
            f"friction {self._watts('friction_power')} W",
            PHASES[power.phase] if now - self._received < STALE_AFTER else "no news",
        ]
        if registers is not None:
            parts.append(f"{_wh(registers.predicted_energy_at_meter)} Wh predicted")
            parts.append(f"{_wh(registers.measured_energy)} Wh measured ({_error(registers)})")
        degc = [joint.motor_temperature_degc for joint in power.joints]
        parts.append(f"motors {_number(min(degc), 0)} to {_number(max(degc), 0)} degC")
        trouble = self._trouble()
        return ", ".join(parts) + (f"; {trouble}" if trouble else "")

    def table(self, now: float) -> Table:
        """Return the whole state as a table for the terminal."""
        power = self._power
        outer = Table.grid(padding=(0, 0))
        if power is None:
            outer.add_row(Text(f"no power state yet; {self._trouble()}"))
            return outer
        silent = now - self._received >= STALE_AFTER
        outer.add_row(self._totals(power, silent))
        outer.add_row(self._joints(power))
        trouble = self._trouble()
        outer.add_row(Text(trouble or "all is well", style="yellow" if trouble else "green"))
        return outer

    def _totals(self, power: PowerState, silent: bool) -> Table:
        state = "[red]no news[/red]" if silent else f"robot {PHASES[power.phase]}"
        table = _new_table()
        table.title = f"{state}, coverage {_number(power.coverage, 3)}"
        table.add_column("cabinet")
        for heading in (
            "predicted",
            "measured",
            "residual",
            "friction",
            "drives",
            "supply",
            "brake",
        ):
            table.add_column(heading, justify="right")
        table.add_row(
            Text("power [W]"),
            self._watts("predicted_power"),
            self._watts("measured_power"),
            self._watts("residual_power"),
            self._watts("friction_power"),
            self._watts("drive_loss"),
            self._watts("supply"),
            self._watts("brake_power"),
        )
        registers = self.registers
        if registers is not None:
            table.add_row(
                Text("energy [Wh]"),
                _wh(registers.predicted_energy_at_meter),
                _wh(registers.measured_energy),
                _error(registers),
            )
        return table

    def _joints(self, power: PowerState) -> Table:
        table = _new_table()
        table.add_column("joint")
        for heading in (
            "drive [W]",
            "friction [W]",
            "[degC]",
            "coulomb [N m]",
            "viscous [mN m s]",
        ):
            table.add_column(Text(heading), justify="right")
        degc: dict[str, Any] = {}
        if self.friction is not None:
            names = self.friction.joint_names
            degc = dict(zip(names, self.friction.motor_temperature_degc, strict=True))
        for joint in power.joints:
            table.add_row(
                joint.name,
                self._watts(f"{joint.name}.drive_power"),
                self._watts(f"{joint.name}.friction_power"),
                _number(degc.get(joint.name, joint.motor_temperature_degc), 0),
                _number(joint.coulomb, 3),
                _number(1e3 * joint.viscous, 2),
            )
        return table

    def _watts(self, key: str) -> str:
        return _number(self._powers.get(key, math.nan), 0)

    def _trouble(self) -> str:
        bad = [status for status in self._status.values() if status.level != DiagnosticStatus.OK]
        return "; ".join(f"{status.name}: {status.message}" for status in bad)


def _new_table() -> Table:
    return Table(box=box.SIMPLE_HEAD, pad_edge=False, expand=False)


def _powers(message: PowerState) -> Iterator[tuple[str, float]]:
    at_meter = message.predicted_power_at_meter  # over the same time as the measured power
    yield "predicted_power", message.predicted_grid_power if math.isnan(at_meter) else at_meter
    for key in ("measured_power", "residual_power", "friction_power", "drive_loss", "brake_power"):
        yield key, getattr(message, key)
    yield "supply", message.loss_dc + message.loss_grid
    joint: Any
    for joint in message.joints:
        yield f"{joint.name}.drive_power", joint.drive_power
        yield f"{joint.name}.friction_power", joint.friction_power


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _wh(joule: float) -> str:
    return _number(joule / JOULE_PER_WH, 2)


def _error(registers: EnergyRegisters) -> str:
    measured = registers.measured_energy
    if math.isnan(measured) or not measured:
        return "-"
    return f"{100.0 * (registers.predicted_energy_at_meter / measured - 1.0):+.1f} %"
