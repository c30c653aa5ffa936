"""Units in which meters and logs state power, energy and amplitudes, and how far counters count."""

from __future__ import annotations

from typing import Literal

JOULE_PER_WH, JOULE_PER_KWH = 3.6e3, 3.6e6
NANOJOULE_PER_JOULE = 1e9
MICROJOULE = 1e-6  # [J]
# What one of each is in SI.
POWER_UNITS = {"W": 1.0, "kW": 1e3, "mW": 1e-3}
ENERGY_UNITS = {"J": 1.0, "kJ": 1e3, "Wh": JOULE_PER_WH, "kWh": JOULE_PER_KWH}
MAX_COUNTER = 2**63 - 1  # where every counter stays: the largest that int64 and a file hold
DqScaling = Literal["peak", "rms", "power_invariant"]
# Power over the sum of products of current and voltage in the frame of the rotor: of amplitudes
# that are peaks of a phase, RMS values of a phase, or power-invariant.
DQ_FACTORS: dict[DqScaling, float] = {"peak": 1.5, "rms": 3.0, "power_invariant": 1.0}

SECOND_NS = 1_000_000_000  # [ns]
MINUTE_NS = 60 * SECOND_NS  # [ns]
HOUR_NS = 60 * MINUTE_NS  # [ns]
DAY_NS = 24 * HOUR_NS  # [ns]
DAY = 86_400.0  # [s]
