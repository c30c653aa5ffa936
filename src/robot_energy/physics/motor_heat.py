"""Temperature of motors and gears from their heat: motor - structure - ambient, solved exactly.

``C_m dT_m/dt = P_m - G_m (T_m - T_s)``,
``C_s dT_s/dt = P_s + G_m (T_m - T_s) - G_s (T_s - T_a)``, heat held over a step; and of a gear
``C dT_g/dt = P_f - G_m (T_g - T_m) - G_a (T_g - T_a)``, its motor taken at the middle of the step.

Source: heat balances of two bodies; lumped-parameter networks of motors as in P. Mellor,
D. Roberts, D. Turner, IEE Proc. B 138 (1991) 205.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model.joint import JointGear, JointThermal
from robot_energy.timeline.blocks import Float

AT_ONCE = 1.0  # s, in which the structure follows the ambient where there is none
HELD = 1e12  # s, in which a motor cools whose temperature is held


class MotorHeat(Described):
    """Rates of the networks of some motors; shape (n,) each."""

    inner: Annotated[Float, "G_m / C_m. [1/s]"]
    back: Annotated[Float, "G_m / C_s; 0 without structure. [1/s]"]
    outer: Annotated[Float, "G_s / C_s. [1/s]"]
    motor: Annotated[Float, "1 / C_m. [K/J]"]
    structure: Annotated[Float, "1 / C_s; 0 without structure. [K/J]"]
    share: Annotated[Float, "Of the friction power that heats the motor. [-]"]
    idle: Annotated[Float, "Heat of the motor beyond its losses. [W]"]

    @classmethod
    def of(cls, entries: Sequence[JointThermal | None], cooling: float = HELD) -> MotorHeat:
        """Return the networks that a model file describes.

        Args:
            entries: One per motor; None for a motor that its sensor alone measures.
            cooling: Time constant towards the ambient of such a motor. [s]
        """
        rows: list[tuple[float, ...]] = []
        for entry in entries:
            if entry is None:
                rows.append((1.0 / cooling, 0.0, 1.0 / AT_ONCE, 0.0, 0.0, 1.0, 0.0))
                continue
            inner, capacity = entry.conductance.value, entry.capacity.value
            share = 1.0 if entry.friction_to_motor is None else entry.friction_to_motor.value
            idle = 0.0 if entry.idle is None else entry.idle.value
            if entry.structure_capacity is None or entry.structure_conductance is None:
                back, outer, structure = 0.0, 1.0 / AT_ONCE, 0.0
            else:
                structure = 1.0 / entry.structure_capacity.value
                back, outer = inner * structure, entry.structure_conductance.value * structure
            rows.append((inner / capacity, back, outer, 1.0 / capacity, structure, share, idle))
        return cls(*np.array(rows, dtype=np.float64).reshape(-1, 7).T)

    def step(self, duration: float) -> tuple[Float, Float]:
        """Return what a step does to motor and structure, relative to the ambient.

        ``T' - T_a = transition (T - T_a) + gain P`` with T of motor and structure and
        P the heat of both, held.

        Args:
            duration: > 0. [s]

        Returns:
            Transition, shape (n, 2, 2) [-]; gain, shape (n, 2, 2) [K/W].
        """
        rates = np.empty((len(self.inner), 2, 2))
        rates[:, 0, 0], rates[:, 0, 1] = -self.inner, self.inner
        rates[:, 1, 0], rates[:, 1, 1] = self.back, -(self.back + self.outer)
        values, vectors = np.linalg.eig(rates)  # real: off the diagonal nothing is below 0
        inverse = np.linalg.inv(vectors)
        decay = np.expm1(values * duration)
        grown = (vectors * (decay / values)[:, None, :]) @ inverse
        transition = np.eye(2) + (vectors * decay[:, None, :]) @ inverse
        return transition, grown * np.stack([self.motor, self.structure], axis=-1)[:, None, :]


class GearHeat(Described):
    """Rates of some gears; shape (n,) each."""

    time: Annotated[Float, "Time constant C / (G_m + G_a). [s]"]
    to_motor: Annotated[Float, "G_m / (G_m + G_a). [-]"]
    per_watt: Annotated[Float, "1 / (G_m + G_a). [K/W]"]
    std: Annotated[Float, "Deviation of the temperature that the figures leave open. [K]"]
    offset: Annotated[
        Float, "What thermometers of motors show of the air, above its temperature. [K]"
    ]

    @classmethod
    def of(cls, entries: Sequence[JointGear | None]) -> GearHeat:
        """Return the gears that a model file describes; None for one that follows its motor."""
        none = np.inf, 0.0, 0.0, 0.0, 0.0
        rows = [none if entry is None else _gear_row(entry) for entry in entries]
        return cls(*np.array(rows, dtype=np.float64).reshape(-1, len(none)).T)


def _gear_row(entry: JointGear) -> tuple[float, ...]:
    total = entry.motor_conductance.value + entry.ambient_conductance.value
    time = entry.capacity.value / total
    to_motor = entry.motor_conductance.value / total
    return time, to_motor, 1.0 / total, entry.std or 0.0, entry.ambient_offset or 0.0
