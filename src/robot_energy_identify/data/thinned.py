"""Samples of a recording of any length in bounded memory: all, or every second, fourth, ... one.

Every sample that is kept is as the stages of the monitor made it at the full rate; none is an
average. An hour of motion says more than the fits can use, but they need all of its time:
temperatures change over minutes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Block,
    Float,
    HeldRows,
    MeterBlock,
    PowerBlock,
    TemperatureBlock,
    TorqueBlock,
)

MOST_ROWS = 12_000  # of one regression: an hour has 700 blocks that count as independent
MOST = 120_000  # samples kept of all recordings of a fit; some 1 kB each for six joints
LONGEST_STEP = 0.04  # s between samples that are kept: the fit of friction averages over as much
Kept = TypeVar("Kept", bound=Block)


def few(count: int) -> NDArray[np.bool_]:
    """Return which rows of a regression to use, evenly taken and at most `MOST_ROWS`, (count,)."""
    return np.arange(count) % max(1, -(-count // MOST_ROWS)) == 0


class Thinned:
    """Keeps samples until there are too many, then ``every`` second one of them, and so on.

    Args:
        most: Samples to keep, but at least 25 in a second. [-]
    """

    def __init__(self, most: float = MOST) -> None:
        self.every = 1
        self._most = most
        self._torque: list[TorqueBlock] = []
        self._power: list[PowerBlock] = []
        self._meter: list[MeterBlock] = []
        self._temperatures: list[TemperatureBlock] = []
        self._seen = [0, 0]  # torques and powers, which belong together row by row

    def take(self, output: Output) -> None:
        if output.torque is not None:
            self._torque.append(self._rows(output.torque, 0))
        if output.power is not None:
            self._power.append(without_deviation(self._rows(output.power, 1)))
        if output.meter is not None:
            self._meter.append(output.meter)
        if output.temperatures is not None:
            self._temperatures.append(output.temperatures)
        while self.held > self._most and 2.0 * self._step() <= LONGEST_STEP:
            self.every *= 2
            self._torque, self._power = _halved(self._torque), _halved(self._power)
            if (whole := _joined(self._temperatures)) is not None:
                self._temperatures = [_newest(whole)]

    @property
    def held(self) -> int:
        return sum(map(len, self._torque))

    def blocks(
        self,
    ) -> tuple[TorqueBlock | None, PowerBlock | None, MeterBlock | None, TemperatureBlock | None]:
        """Return what is kept, None for none; the powers without deviations.

        All readings of the meter, and temperatures as they came, one a second of each motor where
        it is thinned.
        """
        degc = _joined(self._temperatures)
        if degc is not None and self.every > 1:
            degc = _newest(degc)
        return _joined(self._torque), _joined(self._power), _joined(self._meter), degc

    def _rows(self, block: Kept, kind: int) -> Kept:
        seen = self._seen[kind]
        self._seen[kind] += len(block)
        if self.every == 1:
            return block
        return block[np.arange(-seen % self.every, len(block), self.every)]

    def _step(self) -> float:
        steps = np.concatenate([np.diff(block.stamp_ns) for block in self._torque])
        return float(np.median(steps)) * NANOSECOND


def _joined(blocks: list[Kept]) -> Kept | None:
    return blocks[0].concatenate(blocks) if blocks else None


def _halved(blocks: list[Kept]) -> list[Kept]:
    whole = _joined(blocks)
    return [] if whole is None else [whole[np.arange(0, len(whole), 2)]]


def _newest(block: TemperatureBlock) -> TemperatureBlock:
    """The newest reading of each motor in every second."""
    second = block.stamp_ns // round(1.0 / NANOSECOND)
    kept = np.zeros(len(block), dtype=np.bool_)
    for degc in block.motor_temperature_degc.T:
        rows = np.flatnonzero(np.isfinite(degc))
        kept[rows[np.append(np.diff(second[rows]) != 0, True)] if len(rows) else rows] = True
    return block[kept]


def without_deviation(block: PowerBlock) -> PowerBlock:
    """Return powers without their deviations, which no fit needs."""
    none: Float = np.empty((1, 0))
    held = HeldRows(none, np.zeros(len(block), dtype=np.int64), np.zeros(len(block), np.bool_))
    return replace(block, deviation=held)
