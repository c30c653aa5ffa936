"""Several robots on one DC bus: what the drives of one feed back, those of another use.

With ``D_i = P_dc,i + P_l,dc,i`` of each robot, its own rectifier gives ``max(D_i, 0)`` and its own
resistor takes ``max(-D_i, 0)`` (paper A, section II). On one bus the rectifiers give
``max(sum_i D_i, 0)``, as diodes feed nothing back, and the resistor takes what is left below 0.
Capacitors are in parallel, ``C = sum_i C_i``. Saved is ``S = sum_i E_i - E``; without capacitors
and regenerative supplies losses are the same, and S is what the resistors no longer take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.schema import Cabinet, Capacitor
from robot_energy.physics.cabinet import CabinetStage
from robot_energy.physics.equations import Balance
from robot_energy.timeline.blocks import NANOSECOND, Float, Int

ROOM = 0.8  # of the energy of their capacitors, on one bus of robots with other voltages [-]


@dataclass(frozen=True)
class BusExchange:
    """Power flows of the same robots on supplies of their own and on one bus.

    Attributes:
        stamp_ns: Shape (N,). [ns]
        tight: As `shared`, but with `ROOM` of the capacitors.
    """

    stamp_ns: Int
    own: tuple[Balance, ...]
    shared: Balance
    tight: Balance

    @property
    def duration(self) -> float:
        """Over which all powers are known. [s]"""
        return float(self._energy(np.ones_like(self.shared.grid_power)))

    def grid_energy(self, flows: Balance) -> float:
        """Return the energy from the grid, less what a regenerative supply returns. [J]"""
        return self._energy(flows.grid_power)

    def brake_energy(self, flows: Balance) -> float:
        """Return the energy into the brake resistor. [J]"""
        return self._energy(flows.brake_power)

    def peak_power(self, flows: Sequence[Balance]) -> float:
        """Return the greatest power from the grid of several supplies together. [W]"""
        return float(np.nanmax(sum(one.grid_power for one in flows)))

    def after(self, start_ns: int) -> BusExchange:
        """Return the part from an instant on, such as a cycle after one that charged capacitors."""
        rows = np.flatnonzero(self.stamp_ns >= start_ns)
        own = tuple(one.at(rows) for one in self.own)
        return BusExchange(self.stamp_ns[rows], own, self.shared.at(rows), self.tight.at(rows))

    @property
    def saved(self) -> float:
        """S, the energy that one bus saves. [J]"""
        return sum(map(self.grid_energy, self.own)) - self.grid_energy(self.shared)

    @property
    def for_want_of_room(self) -> float:
        """What the bus saves less where its capacitors have `ROOM`. [J]"""
        return self.grid_energy(self.tight) - self.grid_energy(self.shared)

    def _energy(self, power: Float) -> float:
        """Trapezoids between samples at which every robot is known (paper A, eq. 7)."""
        power = np.where(np.isfinite(self.shared.grid_power), power, np.nan)
        time = np.diff(self.stamp_ns) * NANOSECOND
        return float(np.nansum(0.5 * (power[1:] + power[:-1]) * time))


def shared_cabinet(cabinets: Sequence[Cabinet], room: float = 1.0) -> Cabinet:
    """Return the cabinet of one bus for several robots.

    Constant losses add up, as each robot keeps its controller; capacitances add up between the
    highest rectified voltage, at which the bus stands, and the lowest chopper voltage, at which the
    first resistor starts. Where some supply is regenerative, the best one returns what is left.

    Args:
        room: Share of the capacitances that is there. [-]
    """
    capacitors = [one.capacitor for one in cabinets if one.capacitor is not None]
    capacitor = None
    if capacitors:
        nominal = max(one.nominal_voltage.value for one in capacitors)
        chopper = min(one.chopper_voltage.value for one in capacitors)
        if nominal >= chopper:
            raise MotionError(
                f"one rectifier gives {nominal:g} V, and another chopper starts at {chopper:g} V",
                "robots whose DC links have about the same voltage",
            )
        capacitor = Capacitor(
            capacitance=_derived(room * sum(one.capacitance.value for one in capacitors)),
            nominal_voltage=_derived(nominal),
            chopper_voltage=_derived(chopper),
        )
    returned = [
        one.regeneration_efficiency.value
        for one in cabinets
        if one.regeneration_efficiency is not None
    ]
    return Cabinet(
        loss_grid=_derived(sum(one.loss_grid.value for one in cabinets)),
        loss_dc=_derived(sum(one.loss_dc.value for one in cabinets)),
        regeneration_efficiency=_derived(max(returned)) if returned else None,
        capacitor=capacitor,
    )


def exchange(stamp_ns: Int, bus_power: Float, cabinets: Sequence[Cabinet]) -> BusExchange:
    """Return the flows of robots on supplies of their own, and on one bus.

    Args:
        stamp_ns: Rising, shape (N,). [ns]
        bus_power: P_dc of each robot, drive inputs without constant losses, shape (R, N); NaN
            where one is not known, which is not counted for any. [W]
        cabinets: Of each robot; capacitors are empty at the start.
    """
    known = bus_power + 0.0 * bus_power.sum(axis=0)  # NaN for all where one is
    segment, total = np.zeros(len(stamp_ns), dtype=np.int64), known.sum(axis=0)
    shared, tight = (
        CabinetStage(shared_cabinet(cabinets, room)).step(stamp_ns, segment, total)
        for room in (1.0, ROOM)
    )
    own = tuple(
        CabinetStage(cabinet).step(stamp_ns, segment, power)
        for cabinet, power in zip(cabinets, known, strict=True)
    )
    return BusExchange(stamp_ns, own, shared, tight)


def _derived(value: float) -> PositiveFigure:
    return PositiveFigure(value=value, tag="derived", source="of the robots on one bus")
