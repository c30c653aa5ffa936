"""Viscosity of gear oil over temperature.

Walther's law in the form of ASTM D341, ``log10 log10(nu + 0.7) = A - B log10(T)`` with
the kinematic viscosity nu in mm^2/s and T in kelvin, fixed by the two figures of an
oil's data sheet, nu at 40 and at 100 degC.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log10

import numpy as np

from robot_energy.foundation.errors import RigError
from robot_energy.timeline.blocks import Float

KELVIN = 273.15  # K at 0 degC
SHIFT = 0.7  # mm^2/s
MIN_DEGC, MAX_DEGC = -40.0, 200.0


@dataclass(frozen=True)
class Lubricant:
    """One oil.

    Attributes:
        viscosity_40: Kinematic viscosity at 40 degC; an ISO VG grade is this figure
            within 10 %. [mm^2/s]
        viscosity_100: At 100 degC. [mm^2/s]

    Raises:
        RigError: If the oil does not thin with temperature.
    """

    viscosity_40: float
    viscosity_100: float

    def __post_init__(self) -> None:
        if not 2.0 <= self.viscosity_100 < self.viscosity_40:
            raise RigError(
                f"an oil has {self.viscosity_40} mm^2/s at 40 degC and {self.viscosity_100} "
                "at 100 degC",
                "2 <= viscosity_100 < viscosity_40",
            )

    @property
    def constants(self) -> tuple[float, float]:
        """A and B of the law, for T in kelvin. [-]"""
        cold = log10(log10(self.viscosity_40 + SHIFT))
        hot = log10(log10(self.viscosity_100 + SHIFT))
        slope = (cold - hot) / (log10(KELVIN + 100) - log10(KELVIN + 40))
        return cold + slope * log10(KELVIN + 40), slope

    def viscosity(self, gear_temperature_degc: Float | float) -> Float:
        """Return the kinematic viscosity, same shape. [mm^2/s]

        Args:
            gear_temperature_degc: Oil, any shape; limited to -40 to 200 degC. [degC]
        """
        a, b = self.constants
        degc = np.clip(np.asarray(gear_temperature_degc), MIN_DEGC, MAX_DEGC)
        return 10.0 ** (10.0 ** (a - b * np.log10(degc + KELVIN))) - SHIFT

    def friction_factor(self, gear_temperature_degc: Float | float) -> Float:
        """Return viscous friction relative to 40 degC, ``sqrt(nu / nu_40)``. [-]

        The square root stands between churning (nu) and Coulomb-like contact (1): oil
        thins 12 to 15 times from 20 to 80 degC while measured friction falls 3 to 4 times.
        Argument as in `Lubricant.viscosity`.
        """
        return np.sqrt(self.viscosity(gear_temperature_degc) / self.viscosity_40)


OILS = {
    "vg150_mineral": Lubricant(150.0, 14.7),
    "vg220_synthetic": Lubricant(220.0, 25.8),
    "harmonic_gear_grease": Lubricant(180.0, 17.0),
}
"""Oils at catalogue level: viscosity index about 97 (mineral) and 150 (synthetic); base oil of a
harmonic gear's grease."""
