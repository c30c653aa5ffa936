"""Settings of the pipeline that are not figures of the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robot_energy.accounting.account import AccountSettings
from robot_energy.timeline.blocks import EffortMeaning, Learning
from robot_energy.timeline.stamps import BY_PERIOD


@dataclass(frozen=True)
class Settings(AccountSettings):
    """How samples are differentiated, joined and averaged.

    Attributes:
        derivative_window: Length of the window of the derivative; longer without velocities, see
            `Derivative`. [s]
        derivative_lag: How far it reaches ahead; None: half the window. [s]
        max_gap: Longest time between two joint states that is bridged; 0: five median periods,
            0.1 s to 1 s. [s]
        effort: What the effort in the joint states means.
        temperature_wait: How long torque waits for temperatures that arrive late. [s]
        temperature_assumed: Temperatures are assumed, as in a prediction: they never become
            stale and are never taken for stuck, and nothing is learned.
        learning: What is learned of the robot while it runs, and whether it is used.
        deviations: Whether those of the power are computed; else they are 0, as for a fit.
    """

    derivative_window: float = 0.02
    derivative_lag: float | None = None
    max_gap: float = BY_PERIOD
    effort: EffortMeaning = EffortMeaning.NONE
    temperature_wait: float = 0.1
    temperature_assumed: bool = False
    learning: Learning = Learning.OBSERVE
    deviations: bool = True

    def with_meter(self, max_power: float, wraps_at: float | None, unit: str) -> Settings:
        """Return the settings with what a source says of its meter.

        Args:
            max_power: Readings that say or imply more, either way, are refused. [W]
            wraps_at: Reading at which the counter starts again; None: it never does. [J]
            unit: Unit the meter was said to use; empty for W or J.
        """
        return replace(self, meter_max_power=max_power, meter_wraps_at=wraps_at, meter_unit=unit)
