"""Units in which meters and logs state power and energy, and how far counters count."""

from __future__ import annotations

# What one of each is in SI.
POWER_UNITS = {"W": 1.0, "kW": 1e3, "mW": 1e-3}
ENERGY_UNITS = {"J": 1.0, "kJ": 1e3, "Wh": 3.6e3, "kWh": 3.6e6}
MAX_COUNTER = 2**63 - 1  # where every counter stays: the largest that int64 and a file hold
