"""Heat of an arm: winding, housing, oil and casting of every axis, and the hall.

Housings and castings give heat to the hall by natural convection, ``G dT (|dT| / 30 K)^0.25``;
castings of neighbours touch each other. Explicit steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.timeline.blocks import Float

REFERENCE_RISE = 30.0  # K
LONGEST_STEP = 10.0  # s
WINDING, HOUSING, OIL, CASTING = range(4)


@dataclass(frozen=True)
class HeatNetwork:
    """Figures of one arm, shape (n,) each."""

    capacity: Float  # of the four nodes of every axis, shape (4, n) [J/K]
    winding_housing: Float  # [W/K]
    housing_casting: Float  # [W/K]
    housing_oil: Float  # along the shaft [W/K]
    oil_casting: Float  # [W/K]
    neighbours: Float  # from one casting to the next, shape (n - 1,) [W/K]
    housing_hall: Float  # at 30 K [W/K]
    casting_hall: Float  # at 30 K [W/K]

    def step(self, degc: Float, heat: Float, hall_degc: float | Float, duration: float) -> Float:
        """Return the temperatures after a while of constant heat, same shape. [degC]

        Args:
            degc: Before, shape (..., 4, n). [degC]
            heat: Into each node, same shape. [W]
            hall_degc: One value, or shape (..., 1). [degC]
            duration: [s]
        """
        steps = max(1, int(np.ceil(duration / LONGEST_STEP)))
        for _ in range(steps):
            winding, housing, oil, casting = (degc[..., node, :] for node in range(4))
            flow = np.zeros_like(degc)  # into each node
            for first, second, power in (
                (WINDING, HOUSING, self.winding_housing * (winding - housing)),
                (HOUSING, CASTING, self.housing_casting * (housing - casting)),
                (HOUSING, OIL, self.housing_oil * (housing - oil)),
                (OIL, CASTING, self.oil_casting * (oil - casting)),
            ):
                flow[..., first, :] -= power
                flow[..., second, :] += power
            along = self.neighbours * (casting[..., :-1] - casting[..., 1:])
            flow[..., CASTING, :-1] -= along
            flow[..., CASTING, 1:] += along
            flow[..., HOUSING, :] -= _convection(self.housing_hall, housing - hall_degc)
            flow[..., CASTING, :] -= _convection(self.casting_hall, casting - hall_degc)
            degc = degc + (duration / steps) * (flow + heat) / self.capacity
        return degc


def _convection(conductance: Float, rise: Float) -> Float:
    return conductance * rise * (np.abs(rise) / REFERENCE_RISE) ** 0.25
