"""DC bus balance, brake resistor and grid power (paper A, section II).

With the demand ``D = P_dc + P_l,dc`` on the DC bus:

- ``D >= 0``: ``P_grid = D + P_l,grid``, ``P_brake = 0``
- ``D < 0``: ``P_grid = P_l,grid``, ``P_brake = |D|``

A regenerative supply returns the share ``eta`` of ``|D|`` to the grid and loses the
rest, which is counted as loss on the grid side. A DC-link capacitor takes excess first
and gives it back first. In every case
``P_grid = P_dc + P_l,dc + P_l,grid + P_brake + P_capacitor``.
"""

from __future__ import annotations

from bisect import bisect_left
from math import isfinite

import numpy as np

from robot_energy.model.schema import Cabinet
from robot_energy.physics.equations import Balance, grid_balance
from robot_energy.timeline.blocks import NANOSECOND, Float, Int


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

    def step(self, stamp_ns: Int, segment: Int, bus_power: Float) -> Balance:
        """Return the balance of a block.

        Args:
            stamp_ns: Shape (N,); stamps may repeat. [ns]
            segment: Shape (N,). The capacitor is empty at the start of a segment.
            bus_power: P_dc, sum of the drive inputs, shape (N,); NaN gives NaN. [W]
        """
        loss_dc, loss_grid = self._loss_dc + self.offset_dc, self._loss_grid + self.offset_grid
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
