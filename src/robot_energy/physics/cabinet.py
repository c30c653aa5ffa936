"""DC bus balance, brake resistor and grid power (paper A, section II).

With the demand ``D = P_dc + P_l,dc`` on the DC bus:

- ``D >= 0``: ``P_grid = D + P_l,grid``, ``P_brake = 0``
- ``D < 0``: ``P_grid = P_l,grid``, ``P_brake = |D|``

A regenerative supply returns the share ``eta`` of ``|D|`` to the grid and loses the
rest, which is counted as loss on the grid side. A DC-link capacitor takes excess first
and gives it back first. In every case
``P_grid = P_dc + P_l,dc + P_l,grid + P_brake + P_capacitor``.

A fan that the warmest motor switches is a part of ``P_l,grid``: ``p P_fan``, with the probability
``p`` that it runs. At a warmest motor of T this is ``max(min(p, P(T > T_off)), P(T > T_on))``, with
``T_off = T_on - hysteresis``; on the right is the previous ``p``. Start and stop are uniform within
their deviations. Above all possible starts ``p`` is 1. Below all possible stops it is 0. Between
stop and start ``p`` does not change. Before the first temperature it is 1/2. At the first it is
the less of 1/2 and ``1/2 (P(T > T_off) + P(T > T_on))``: of the fans between stop and start half
run. Up to the temperature at which recordings began without the fan it is ``P(T > T_on)``.
"""

from __future__ import annotations

from bisect import bisect_left
from math import hypot, inf, isfinite

import numpy as np

from robot_energy.model.schema import Cabinet
from robot_energy.physics.equations import Balance, grid_balance
from robot_energy.timeline.blocks import NANOSECOND, Float, Int

UNSEEN = 0.5  # probability that a fan runs before any temperature is known
HALF_WIDTH = 3.0**0.5  # of a uniform distribution, over its standard deviation


class FanStage:
    """Power of the fan by the temperature of the warmest motor."""

    def __init__(self, cabinet: Cabinet) -> None:
        fan = cabinet.fan
        self._power = 0.0
        if fan is not None:
            self._power = fan.power.value
            self._on, width = fan.on_above_degc.value, fan.on_above_degc.std or 0.0
            less = fan.hysteresis
            self._off = self._on - (0.0 if less is None else less.value)
            begins = fan.begins_off_to_degc
            self._begins_off = -inf if begins is None else begins.value
            self._widths = width, width if less is None else hypot(width, less.std or 0.0)
        self._runs: float | None = None  # before any temperature

    def step(self, motor_temperature_degc: Float) -> Float | float:
        """Return the power that is to be expected, shape (N,); 0 without a fan. [W]

        Args:
            motor_temperature_degc: NaN where unknown, shape (N, n). [degC]
        """
        if self._power == 0.0:
            return 0.0
        warmest = np.fmax.reduce(motor_temperature_degc, axis=1)
        begins = np.flatnonzero(np.diff(warmest, prepend=np.nan) != 0.0)
        runs = np.empty(len(begins))
        for place, degc in enumerate(warmest[begins].tolist()):
            if isfinite(degc):
                least = _warmer(degc, self._on, self._widths[0])
                most = _warmer(degc, self._off, self._widths[1])
                before = self._runs
                if before is None:
                    before = 0.0 if degc <= self._begins_off else min(UNSEEN, 0.5 * (least + most))
                self._runs = max(min(before, most), least)
            runs[place] = UNSEEN if self._runs is None else self._runs
        return self._power * np.repeat(runs, np.diff(np.append(begins, len(warmest))))


def _warmer(degc: float, limit: float, std: float) -> float:
    """Probability that a temperature is above a limit of some deviation."""
    half = HALF_WIDTH * std
    if half == 0.0:
        return float(degc > limit)
    return min(max(0.5 + 0.5 * (degc - limit) / half, 0.0), 1.0)


class CabinetStage:
    """Balances the bus sample by sample; stateful only with a capacitor.

    Attributes:
        offset_dc: Added to the constant loss of the DC side. [W]
        offset_grid: Added to that of the grid side. [W]
    """

    def __init__(self, cabinet: Cabinet) -> None:
        self._loss_dc = cabinet.loss_dc.value
        self._loss_grid = cabinet.loss_grid.value
        regeneration = cabinet.regeneration_efficiency
        self._returned = None if regeneration is None else regeneration.value
        self._swing = 0.0 if cabinet.capacitor is None else cabinet.capacitor.swing
        self.offset_dc = self.offset_grid = 0.0
        self._stored = 0.0  # J above nominal voltage
        self._last: tuple[int, int] | None = None  # stamp, segment

    def step(
        self, stamp_ns: Int, segment: Int, bus_power: Float, fan_power: Float | float = 0.0
    ) -> Balance:
        """Return the balance of a block.

        Args:
            stamp_ns: Shape (N,); stamps may repeat. [ns]
            segment: Shape (N,). The capacitor is empty at the start of a segment.
            bus_power: P_dc, sum of the drive inputs, shape (N,); NaN gives NaN. [W]
            fan_power: Added to the loss on the grid side, shape (N,). [W]
        """
        loss_dc = self._loss_dc + self.offset_dc
        loss_grid = self._loss_grid + self.offset_grid + fan_power
        demand = bus_power + loss_dc
        capacitor: Float | float = 0.0
        if self._swing > 0:
            capacitor = self._charge(stamp_ns, segment, demand)
        return grid_balance(bus_power, loss_dc, loss_grid, capacitor, self._returned)

    def _charge(self, stamp_ns: Int, segment: Int, demand: Float) -> Float:
        """Power into the capacitor, taken as constant over the interval before a sample."""
        flow = np.zeros_like(demand)
        stamp, part = (stamp_ns[0], segment[0]) if self._last is None else self._last
        duration = np.diff(stamp_ns, prepend=stamp) * NANOSECOND
        fresh = np.diff(segment, prepend=part) != 0
        fresh[0] |= self._last is None
        self._last = int(stamp_ns[-1]), int(segment[-1])
        fed = np.flatnonzero(demand < 0).tolist()
        row, place, stored = 0, 0, self._stored
        while row < len(demand):
            if stored == 0.0:  # nothing happens before the drives feed back again
                place = bisect_left(fed, row, place)
                if place == len(fed):
                    break
                row = fed[place]
            wanted, time = float(demand[row]), float(duration[row])
            if fresh[row]:
                stored = 0.0
            elif isfinite(wanted) and time > 0:
                energy = min(max(-wanted * time, -stored), self._swing - stored)
                stored += energy
                flow[row] = energy / time
            elif isfinite(wanted) and (stored > 0 if wanted > 0 else stored < self._swing):
                flow[row] = -wanted  # at a repeated stamp: what flows as soon as time goes on
            row += 1
        self._stored = stored
        return flow
