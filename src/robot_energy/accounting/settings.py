"""Settings of an energy account that are not figures of the robot."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.accounting.power_curve import MAX_POWER

HOLD_NS = 2_000_000_000
"""A reading counts as the newest for so long, or for twice the time it covers."""


@dataclass(frozen=True)
class AccountSettings:
    """How power is averaged and which meter readings count.

    Attributes:
        power_period: Averaging period of the power states; None makes no means. [s]
        meter_max_gap: Longest time between meter readings that is bridged. [s]
        meter_max_power: Readings that say or imply more, either way, are refused. [W]
        meter_wraps_at: Reading at which the meter's counter starts again from zero; None:
            it never does. [J]
        meter_unit: Unit the meter was said to use; empty for W or J.
    """

    power_period: float | None = 0.02
    meter_max_gap: float = 2.0
    meter_max_power: float = MAX_POWER
    meter_wraps_at: float | None = None
    meter_unit: str = ""
