"""Gathers windows of the power meter into records of the friction of the whole robot.

Over a record the residual is a line in friction power: its slope is how far friction lies
above the model's, whatever the constant losses do meanwhile.
"""

from __future__ import annotations

from math import log

import numpy as np

from robot_energy.blocks import Float
from robot_energy.condition.buckets import SPEED_BUCKETS
from robot_energy.condition.wear_records import (
    DIGITS,
    HUBER,
    MIN_RATIO,
    NUISANCES,
    RECORD_TIME,
    WearRecord,
    degc_shares,
    features_of,
)
from robot_energy.uncertainty.band import MEDIAN_TO_STD

LONGEST = 3600.0  # of a record; the slope of one that is no surer by then is dropped [s]
MAX_STD = 0.1  # of the slope [-]
MIN_NOISE = 1.0  # W


class MeterGatherer:
    """Gathers windows until the slope is known well enough.

    Attributes:
        hours: Time of all windows so far. [h]
    """

    def __init__(self) -> None:
        self.hours = 0.0
        self._rows: list[tuple[float, float, float, float, int]] = []

    def step(
        self, stamp_ns: int, duration: float, residual: float, friction: float, degc: float
    ) -> WearRecord | None:
        """Take a window.

        Args:
            stamp_ns: Its end. [ns]
            duration: [s]
            residual: Measured less what the model file predicts. [J]
            friction: Friction energy of the model file that the meter sees. [J]
            degc: Mean motor temperature. [degC]

        Returns:
            A record that became complete, or None.
        """
        if not np.isfinite(residual + friction + degc):
            return None
        self.hours += duration / 3600.0
        self._rows.append((duration, residual / duration, friction / duration, degc, stamp_ns))
        time = sum(row[0] for row in self._rows)
        if time < RECORD_TIME:
            return None
        found = self._record(time)
        if found is not None or time >= LONGEST:
            self._rows.clear()
        return found

    def _record(self, time: float) -> WearRecord | None:
        rows: Float = np.array([row[:4] for row in self._rows])
        duration, residual, friction, degc = rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3]
        slope, off, noise, weight = 0.0, residual, np.inf, duration
        for _ in range(4):
            near = np.minimum(1.0, HUBER * noise / np.maximum(np.abs(off), 1e-9))
            weight = duration * near
            slope, off = _line(friction, residual, weight)
            noise = max(MEDIAN_TO_STD * float(np.median(np.abs(off))), MIN_NOISE)
        spread = float(weight @ (friction - weight @ friction / weight.sum()) ** 2)
        variance = noise**2 * float(np.mean(duration)) / max(spread, 1e-9)
        if not variance < MAX_STD**2:
            return None
        ratio = max(1.0 + slope, MIN_RATIO)
        return WearRecord(
            round(np.mean([row[4] for row in self._rows])),
            round(self.hours - time / 7200.0, DIGITS),
            time,
            round(log(ratio), DIGITS),
            variance / ratio**2,
            features_of(degc_shares(degc).mean(axis=0), np.zeros(SPEED_BUCKETS), [0.0] * NUISANCES),
        )


def _line(friction: Float, residual: Float, weight: Float) -> tuple[float, Float]:
    """Slope of the residual over friction power, and how far each point is off the line."""
    total = weight.sum()
    x = friction - weight @ friction / total
    y = residual - weight @ residual / total
    slope = float((weight * x) @ y / max(float((weight * x) @ x), 1e-9))
    return slope, y - slope * x
