"""Learns from one power meter: one factor on friction, and the constant losses.

One meter cannot distinguish six joints. What it can is regress the residual of each window,

``measured - predicted = (factor - 1) E_friction + offset T``,

on the friction energy of the model file and on time, by least squares whose past fades, with
the model file as the prior. Where the torque of all joints is measured, friction is learned
from that, and the meter says the offset alone.
"""

from __future__ import annotations

import numpy as np

from robot_energy.condition.joint_friction import BOUNDS, GRID
from robot_energy.condition.record import MeterRecord, filled, flat
from robot_energy.timeline.blocks import Float

MEMORY = 400.0  # of the past; a gear that lags its motor makes the residual drift [s]
PRIOR_FACTOR = 0.5  # standard deviation of the factor before any reading [-]
PRIOR_OFFSET = 0.3  # of the offset, share of the constant losses [-]
MAX_OFFSET = 0.5  # share of the constant losses [-]
LEAST_OFFSET = 20.0  # however small the constant losses are [W]
NOISE_SHARE = 0.05  # of the measured power: residual of one window that is not a surprise [-]
MIN_NOISE = 2.0  # W
MAX_SURPRISE = 3.0  # a window further off weighs less (Huber)
MIN_TIME = 60.0  # before the fit is valid [s]


class MeterFit:
    """Factor on friction and offset of the constant losses.

    Args:
        constant_loss: Of the model file, where the meter sees it. [W]

    Attributes:
        information: Normal matrix of (factor - 1, offset), without the prior, shape (2, 2).
        target: Right side, shape (2,).
        power: Mean measured power. [W]
        scale: Mean amount of the residual in standard deviations of the noise. [-]
        time: Time of the windows that were used. [s]
        refused: Windows that were not, as their residual is too large.
    """

    def __init__(self, constant_loss: float) -> None:
        self._loss = constant_loss
        self.information: Float = np.zeros((2, 2))
        self.target: Float = np.zeros(2)
        self.power = 0.0
        self.scale = 1.0
        self.time = 0.0
        self.windows = 0
        self.refused = 0

    def step(self, duration: float, measured: float, residual: float, friction: float) -> None:
        """Learn from one window.

        Args:
            duration: Its length. [s]
            measured: Measured energy. [J]
            residual: Measured minus what the model file predicts. [J]
            friction: Friction energy of the model file that the meter sees. [J]
        """
        if not np.isfinite(measured + residual + friction):
            self.refused += 1
            return
        seen = np.array([friction, duration]) / duration
        self.power += duration / (self.time + duration) * (measured / duration - self.power)
        level = max(MIN_NOISE, NOISE_SHARE * abs(self.power))
        surprise = abs(residual / duration - float(seen @ self._solution())) / level
        known = self.time >= MIN_TIME
        reach = MAX_SURPRISE * max(self.scale, 1.0)
        if known and surprise > reach:
            self.refused += 1
        keep = float(np.exp(-duration / MEMORY))
        weight = duration / level**2 * (min(1.0, reach / surprise) if known and surprise else 1.0)
        self.information = keep * self.information + weight * np.outer(seen, seen)
        self.target = keep * self.target + weight * seen * (residual / duration)
        fading = min(60.0, duration) / 300.0
        self.scale += fading * (min(surprise, 2 * reach) - self.scale)
        self.time += duration
        self.windows += 1

    def state(self) -> MeterRecord:
        """Return what must be kept across a restart."""
        return MeterRecord(
            information=flat(self.information),
            target=flat(self.target),
            power_watt=self.power,
            scale=self.scale,
            time_second=self.time,
            windows=self.windows,
            refused=self.refused,
        )

    def restore(self, record: MeterRecord) -> None:
        """Continue from a record."""
        self.information = filled(record.information, self.information)
        self.target = filled(record.target, self.target)
        self.power, self.scale = record.power_watt, record.scale
        self.time = record.time_second
        self.windows, self.refused = record.windows, record.refused

    def _solution(self) -> Float:
        return np.linalg.solve(self.information + self._prior(), self.target)

    def _prior(self) -> Float:
        offset = max(PRIOR_OFFSET * self._loss, LEAST_OFFSET / 2)
        return np.diag([PRIOR_FACTOR**-2, offset**-2])

    @property
    def raw(self) -> tuple[float, float]:
        """Factor and offset as fitted, without bounds. [-], [W]"""
        factor, offset = self._solution().tolist()
        return 1.0 + factor, offset

    @property
    def std(self) -> tuple[float, float]:
        """Standard deviations of `raw` as far as the spread of the windows shows. [-], [W]"""
        spread = max(self.scale, 1.0) ** 2 * np.linalg.inv(self.information + self._prior())
        factor, offset = np.sqrt(np.diag(spread)).tolist()
        return factor, offset

    @property
    def valid(self) -> bool:
        """Whether factor and offset can be used; they belong together."""
        return self.time >= MIN_TIME

    @property
    def filtered(self) -> tuple[float, float]:
        """Factor and offset within their bounds: the best pair there. [-], [W]"""
        limit = max(MAX_OFFSET * self._loss, LEAST_OFFSET)
        lower = np.array([BOUNDS[0] - 1.0, -limit])
        upper = np.array([BOUNDS[1] - 1.0, limit])
        normal = self.information + self._prior()
        found = self._solution()
        for index in np.flatnonzero((found < lower) | (found > upper)).tolist():
            other = 1 - index
            found[index] = min(max(found[index], lower[index]), upper[index])
            rest = self.target[other] - normal[other, index] * found[index]
            found[other] = min(max(rest / normal[other, other], lower[other]), upper[other])
        factor, offset = found.tolist()
        return round((1.0 + factor) / GRID) * GRID, round(offset / GRID) * GRID
