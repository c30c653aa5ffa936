"""Settings of the pipeline that are not figures of the robot."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.blocks import EffortMeaning


@dataclass(frozen=True)
class Settings:
    """How samples are differentiated, joined and averaged.

    Attributes:
        derivative_window: Length of the window of the derivative. [s]
        derivative_lag: How far it reaches ahead; None: half the window. [s]
        derivative_neighbours: Least number of samples in the window.
        effort: What the effort in the joint states means.
        settle: How long torque waits for temperatures that arrive late. [s]
        power_period: Averaging period of the power states; None makes no means. [s]
        meter_max_gap: Longest time between meter readings that is bridged. [s]
    """

    derivative_window: float = 0.02
    derivative_lag: float | None = None
    derivative_neighbours: int = 5
    effort: EffortMeaning = EffortMeaning.NONE
    settle: float = 0.1
    power_period: float | None = 0.02
    meter_max_gap: float = 2.0
