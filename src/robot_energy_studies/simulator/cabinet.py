"""Rectifier, DC link with capacitor and brake chopper, and what else the cabinet takes.

While the link is below the voltage that the rectifier gives without load, current flows through
the source resistance, ``C dV/dt = (V0 - V) / R - P / V``, solved exactly over a step for the
current of the step. Above it the diodes block. The chopper closes at one voltage and opens at
another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.timeline.blocks import Float


@dataclass(frozen=True)
class DrawnCabinet:
    """Figures of a cabinet."""

    capacitance: float  # [F]
    open_voltage: float  # of the link without load [V]
    source_resistance: float  # by which the voltage falls with the current [ohm]
    real_share: float  # of that fall that is loss; the rest is commutation [-]
    diode_voltage: float  # of the rectifier [V]
    chopper_on: float  # [V]
    chopper_off: float  # [V]
    brake_resistance: float  # [ohm]
    link_load: float  # supplies that hang on the link [W]
    grid_load: float  # computer and supplies at the grid [W]
    fan: float  # [W]
    fan_on_degc: float  # of the warmest motor housing [degC]
    fan_off_degc: float  # [degC]


@dataclass(frozen=True)
class LinkFlows:
    """Means over every step, shape (N, K) each. [W]"""

    switching_loss: Float  # of all inverters
    brake: Float  # of the resistor
    stored: Float  # into the capacitor
    rectifier_loss: Float  # of source and diodes
    link: Float  # from the rectifier into the link


class DcLink:
    """The links of K equal robots.

    Args:
        step: Between samples. [s]
    """

    def __init__(self, cabinet: DrawnCabinet, robots: int, step: float) -> None:
        self._cabinet = cabinet
        self._step = step
        self._voltage: Float = np.full(robots, cabinet.open_voltage)
        self._braking = np.zeros(robots, dtype=bool)

    def run(self, power: Float, switched: Float) -> LinkFlows:
        """Return the flows of consecutive steps.

        Args:
            power: Of the drives without switching, shape (N, K). [W]
            switched: Their switching loss by voltage, shape (N, K). [W/V]
        """
        cabinet = self._cabinet
        demand = power + cabinet.link_load
        middles, charges, brakes, ends = (np.empty_like(power) for _ in range(4))
        before = voltage = self._voltage
        for row in range(len(power)):
            limit = np.where(self._braking, cabinet.chopper_off, cabinet.chopper_on)
            self._braking = voltage > limit
            middle = voltage
            for _ in range(2):  # the current is that of the mean voltage of the step
                brakes[row] = self._braking * middle / cabinet.brake_resistance
                drawn = demand[row] / middle + switched[row] + brakes[row]
                charges[row], ends[row] = self._settled(voltage, drawn)
                middle = 0.5 * (voltage + ends[row])
            middles[row] = middle
            voltage = ends[row]
        self._voltage = voltage.copy()
        energy = 0.5 * cabinet.capacitance * np.concatenate([before[None], ends]) ** 2
        return LinkFlows(
            switching_loss=switched * middles,
            brake=brakes * middles,
            stored=np.diff(energy, axis=0) / self._step,
            rectifier_loss=charges * cabinet.diode_voltage
            + cabinet.real_share * cabinet.source_resistance * charges**2,
            link=charges * middles,
        )

    def _settled(self, voltage: Float, drawn: Float) -> tuple[Float, Float]:
        """Mean current of the rectifier [A] and voltage [V] after a step in which drives draw."""
        cabinet, step = self._cabinet, self._step
        settled = cabinet.open_voltage - drawn * cabinet.source_resistance
        share = -np.expm1(-step / (cabinet.source_resistance * cabinet.capacitance))
        charged = cabinet.capacitance / step
        current = np.maximum(charged * (settled - voltage) * share + drawn, 0.0)
        return current, voltage + (current - drawn) / charged
