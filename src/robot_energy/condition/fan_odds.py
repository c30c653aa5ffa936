"""Whether the fan of the cabinet runs, by the power meter.

With r the measured power less the predicted one without the fan, over the newest windows, and s its
deviation, a fan of power P is by

``exp(P (r - P / 2) / s^2)``

more likely to run than not, if the temperature allows both alike. s is what predictions of power
are off anyhow, and the scatter of the windows. What the model is off stays the same from window to
window, so it does not become less with their number.
"""

from __future__ import annotations

from math import exp, isfinite

import numpy as np

from robot_energy.condition.meter_fit import MIN_NOISE, NOISE_SHARE

WINDOWS = 6  # that count, half a minute
OLDEST_NS = 60_000_000_000  # of them
MAX_LOG_ODDS = 20.0


class FanOdds:
    """Odds that a fan runs.

    Args:
        power: While it runs. [W]
    """

    def __init__(self, power: float) -> None:
        self._power = power
        self._windows: list[tuple[int, float, float]] = []

    def step(self, stamp_ns: int, residual: float, measured: float) -> None:
        """Take a window.

        Args:
            stamp_ns: Of its end. [ns]
            residual: Measured less predicted power without the fan. [W]
            measured: Power. [W]
        """
        if isfinite(residual + measured):
            self._windows = [*self._windows, (stamp_ns, residual, measured)][-WINDOWS:]

    def odds(self, now_ns: int) -> float:
        """Return the odds that it runs, by windows that are not too old; 1 without any. [-]

        Args:
            now_ns: Stamp from which they count. [ns]
        """
        since = now_ns - OLDEST_NS
        self._windows = [one for one in self._windows if since < one[0] <= now_ns]
        if not self._windows:
            return 1.0
        residual, measured = np.array([one[1:] for one in self._windows]).T
        variance = float(residual.var()) / len(residual)
        variance += max(MIN_NOISE, NOISE_SHARE * abs(float(measured.mean()))) ** 2
        log_odds = self._power * (float(residual.mean()) - 0.5 * self._power) / variance
        return exp(min(max(log_odds, -MAX_LOG_ODDS), MAX_LOG_ODDS))
