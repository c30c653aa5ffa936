"""Units in which meters and logs state power and energy, and what one of each is in SI."""

from __future__ import annotations

POWER_UNITS = {"W": 1.0, "kW": 1e3, "mW": 1e-3}
ENERGY_UNITS = {"J": 1.0, "kJ": 1e3, "Wh": 3.6e3, "kWh": 3.6e6}
